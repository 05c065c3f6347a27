"""Links of the site to files outside docs/ are shown as names."""

import re
from typing import Any


def on_page_markdown(markdown: str, **_: Any) -> str:
    """`[text](../sim/body.py)` -> the text: the site holds documentation, not code."""
    return re.sub(r"\[([^\]]+)\]\(\s*\.\./[^)]*\)", r"\1", markdown)
