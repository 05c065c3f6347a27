"""TOML files: read within bounds, checked against a typed table, mistakes in one line.

What a stranger wrote may be meant to harm: a file is refused above `MAX_BYTES`, where tables or
arrays nest too deeply, or where a number has thousands of digits. Keys of many parts (`a.a.a…`) are
found before tomllib sees them: it takes time and memory by the square of their number.
"""

import json
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from gateway.errors import BadInput

T = TypeVar("T")
MAX_BYTES = 1_000_000  # of a file that people write; the longest that ships has 3,000
MAX_SHOWN = 60  # characters of a value that a message quotes
MAX_TOLD = 500  # … and of what others say of one
MAX_KEY_PARTS = 20  # `provenance."hull.mass".value` has three; chosen
MAX_NESTING = 50  # of tables and arrays; a vessel file has four, and JSON readers end at 200
_PART = r"""(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"?|'[^'\n]*+'?)"""
_TOKEN = re.compile(  # each ends where a text or a comment is left open: one pass whatever it holds
    rf"""
    \"{{3}} (?:[^"\\]|\\.|"(?!""))*+ (?:\"{{3}})?
    | '{{3}} (?:[^']|'(?!''))*+ (?:'{{3}})?
    | \#[^\n]*+
    | (?P<deep> (?:{_PART}[ \t]*+\.[ \t]*+){{{MAX_KEY_PARTS}}})
    | {_PART}
    | [^\w"'\#-]++
    """,
    re.VERBOSE | re.DOTALL,
)


def read_toml(file: Path, what: str, kind: str = "a TOML file") -> dict[str, Any]:
    """The tables of a TOML file; BadInput names `what` cannot be read, or that it is not `kind`."""
    try:
        with file.open("rb") as stream:
            raw = stream.read(MAX_BYTES + 1)
    except OSError as error:
        raise BadInput(f"{file}: cannot read {what}: {error.strerror}") from None
    return parse_toml(file, raw, what, kind)


def parse_toml(file: Path, raw: bytes, what: str, kind: str = "a TOML file") -> dict[str, Any]:
    """The tables of what was read from a file, refused as `read_toml` does."""
    if len(raw) > MAX_BYTES:
        raise BadInput(f"{file}: larger than {MAX_BYTES:,} bytes (MAX_BYTES): not {kind}")
    try:  # Notepad begins a file with a byte order mark
        text = raw.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError:
        raise BadInput(f"{file}: not a text file; {what} is TOML") from None
    if any(token["deep"] for token in _TOKEN.finditer(text)):
        raise BadInput(f"{file}: not {kind}: a key has more than {MAX_KEY_PARTS} parts (a.a.a.…)")
    try:
        tables = tomllib.loads(text)
        if _nest_deeper(tables, MAX_NESTING):
            raise RecursionError
    except tomllib.TOMLDecodeError as error:
        raise BadInput(f"{file}: not {kind}: {shortened(str(error), 200)}") from None
    except RecursionError:
        raise BadInput(f"{file}: not {kind}: tables or arrays nest too deeply") from None
    except ValueError:  # of int(): it takes no thousands of digits
        raise BadInput(f"{file}: not {kind}: a number in it has too many digits") from None
    return tables


def _nest_deeper(tables: dict[str, Any], most: int) -> bool:
    """Whether tables or arrays stand within each other more than so often."""
    level: list[Any] = [tables]
    for _ in range(most):
        held = (v for one in level for v in (one.values() if isinstance(one, dict) else one))
        level = [value for value in held if isinstance(value, dict | list)]
    return bool(level)


def validated(kind: TypeAdapter[T], tables: Mapping[str, Any]) -> T:
    """TOML tables as a validated object: a number in quotes or a bool for a number is a mistake.

    pydantic's strict rules for JSON hold for TOML too: there are no tuples and no enums in either.
    """
    return kind.validate_json(json.dumps(tables, default=str), strict=True)


def explain(error: ValidationError) -> str:
    """The mistakes of a pydantic error in one line: key and what was expected."""
    mistakes = error.errors()
    unknown = [_key(m["loc"]) for m in mistakes if m["type"] in _UNKNOWN]
    missing = [_key(m["loc"]) for m in mistakes if m["type"] == "missing"]
    keys = {"unknown key": unknown, "missing key": missing}
    if unknown or missing:
        return "; ".join(
            f"{what} {shortened(', '.join(found), 200)}" for what, found in keys.items() if found
        )
    message = mistakes[0]["msg"].removeprefix("Value error, ")
    more = f" (and {len(mistakes) - 1} more)" if len(mistakes) > 1 else ""
    key, value = _key(mistakes[0]["loc"]), mistakes[0]["input"]
    # a whole table is too long
    shown = "" if isinstance(value, dict) else f" = {shortened(repr(value))}"
    return f"{key}{shown}: {message[0].lower()}{message[1:]}{more}"


def shortened(text: str, most: int = MAX_SHOWN) -> str:
    """A text as a message may quote it: its beginning, where it is long."""
    return text if len(text) <= most else f"{text[:most]}…"


_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")


def _key(location: tuple[int | str, ...]) -> str:
    parts = "".join(f"[{p}]" if isinstance(p, int) else f".{shortened(p)}" for p in location)
    return parts.lstrip(".")
