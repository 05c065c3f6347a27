"""A command's result as JSON: indented, and UTF-8 whatever it quotes."""

from collections.abc import Mapping
from typing import Any

import orjson

from gateway.errors import printable

OPTIONS = orjson.OPT_INDENT_2 | orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_APPEND_NEWLINE


def result_json(result: Any) -> bytes:
    """Values of dictionaries, lists, numpy and text -> one line each.

    JSON is Unicode and a file name need not be: its bytes that are no text are shown as `printable`
    shows them.
    """
    try:
        return orjson.dumps(result, option=OPTIONS)
    except TypeError:  # seldom: text is looked through only where it has to be
        return orjson.dumps(_shown(result), option=OPTIONS)


def _shown(value: Any) -> Any:
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, Mapping):
        return {_shown(key): _shown(one) for key, one in value.items()}
    return [_shown(one) for one in value] if isinstance(value, list | tuple) else value
