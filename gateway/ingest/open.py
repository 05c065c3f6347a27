"""Opens a recording by its content. `FORMATS` is the one table of formats."""

from collections.abc import Sequence
from filecmp import cmp
from functools import lru_cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING

from gateway.errors import BadInput
from gateway.ingest import HEAD, LogFormat, csv, dataflash, mavlink, mcap, parquet, read_bytes, ulog

if TYPE_CHECKING:
    from gateway.ingest.log import Log

FORMATS: tuple[LogFormat, ...] = (  # in the order in which they are asked
    mcap.FORMAT,
    dataflash.FORMAT,
    ulog.FORMAT,
    parquet.FORMAT,
    csv.FORMAT,
    mavlink.FORMAT,  # last: it takes everything but text
)


@lru_cache(maxsize=1)
def known_formats() -> tuple[LogFormat, ...]:
    """The table, and before its last line what installed plug-ins add (`shadow.log_formats`)."""
    plugged = (point.load() for point in entry_points(group="shadow.log_formats"))
    found = tuple(one for one in plugged if isinstance(one, LogFormat))
    return (*FORMATS[:-1], *found, FORMATS[-1])


def names_of(formats: Sequence[LogFormat]) -> str:
    """Formats in words, the most usual first: "a .tlog, an MCAP recording, … or a .csv table"."""
    names = [one.name for one in (formats[-1], *formats[:-1])]
    return f"{', '.join(names[:-1])} or {names[-1]}"


def suffixes() -> frozenset[str]:
    """Small suffixes that files of the known formats have."""
    return frozenset(suffix.lower() for one in known_formats() for suffix in one.suffixes)


def check_each_once(paths: Sequence[str | Path]) -> None:
    """BadInput where a recording is given twice, under whatever name.

    It would count as new evidence: every interval too narrow, every validation too good.
    """
    files = [Path(path) for path in paths]
    for i, second in enumerate(files):
        for first in files[:i]:
            if _same_content(first, second):
                raise BadInput(
                    f"{second}: is the same recording as {first}: counted twice it would only seem "
                    "surer: give each once"
                )


def _same_content(one: Path, other: Path) -> bool:
    """Whether two paths lead to the same bytes; what is no file is left to whoever opens it."""
    if one.resolve() == other.resolve():
        return True
    try:
        return cmp(one, other, shallow=False)
    except OSError:
        return False


def takes_mapping(path: str | Path) -> bool:
    """May a mapping file be of use for a recording? Also said of what cannot be read."""
    try:
        with Path(path).open("rb") as stream:
            head = stream.read(HEAD)
    except OSError:
        return True
    found = (one.mapped for one in known_formats() if one.recognises(head, Path(path)))
    return next(found, True)


def open_log(path: str | Path, mapping: str | Path | None = None) -> "Log":
    """Any recording that can be read; `mapping` names what the columns of a table are."""
    raw = read_bytes(path)
    for one in known_formats():
        if one.recognises(raw[:HEAD], Path(path)):
            return one.open(str(path), raw, mapping)
    raise BadInput(f"{path} is a text file: a recording is {names_of(known_formats())}")
