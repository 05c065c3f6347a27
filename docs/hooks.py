"""What the site shows of links to files outside docs/: on a forge they open, here they are names."""

import re
from typing import Any


def on_page_markdown(markdown: str, **_: Any) -> str:
    """`[text](../sim/body.py)` -> the text alone: the site holds the documentation, not the code."""
    return re.sub(r"\[([^\]]+)\]\(\.\./[^)]*\)", r"\1", markdown)
