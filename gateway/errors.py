"""What can go wrong, as one tree. The command line turns each into one line and an exit status."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shlex import quote

import numpy as np

# Arithmetic without a result: a singular matrix, an overflow, a division by zero.
NUMERICAL_ERRORS = (np.linalg.LinAlgError, ArithmeticError)


# What a terminal would obey or show in another place: control characters but line break and
# tabulator, changes of direction, and bytes of a file name that are no text.
_UNPRINTABLE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")


def printable(text: str) -> str:
    """A text as a terminal may show it: names in logs, files and messages are not ours."""
    return _UNPRINTABLE.sub(_escaped, text)


def _escaped(found: re.Match[str]) -> str:
    """A character by its number; a byte that is no text (U+DC80 … U+DCFF in a name) by its own."""
    number = ord(found[0])
    return f"\\x{number - 0xDC00 if 0xDC80 <= number <= 0xDCFF else number:02x}"


def shell_word(text: str) -> str:
    """A word for a command line, as a shell reads it, also where bytes of a name are no text."""
    if printable(text) == text:
        return quote(text)
    plain = text.replace("\\", "\\\\").replace("'", "\\'").replace("\n", "\\n")
    return f"$'{printable(plain)}'"


def shell_path(path: str | Path) -> str:
    """A file as a word for a command line: a name that begins with a dash is no option."""
    text = str(path)
    return shell_word(f"./{text}" if text.startswith("-") else text)


def one_line(text: str) -> str:
    """The same of a text that may not begin a line of its own: what a boat says is not ours."""
    return printable(text).replace("\n", "\\x0a")


def counted(count: int, what: str) -> str:
    """A number of things: 1 recording, 2 recordings."""
    return f"{count} {what}{'' if count == 1 else 's'}"


class ShadowError(Exception):
    """The work failed: exit status 1. The message says what, where and what to do."""

    exit_status = 1


class BadInput(ShadowError):
    """A file, option or value that cannot be used: exit status 2."""

    exit_status = 2


@contextmanager
def numerical_errors(
    recording: str | Path, vessel: str | Path | None = None, advice: str = ""
) -> Iterator[None]:
    """Raise a ShadowError that names recording and vessel where arithmetic fails in the block."""
    try:
        yield
    except NUMERICAL_ERRORS as error:
        subject = str(recording) if vessel is None else f"{recording} with {vessel}"
        raise ShadowError(numerical_message(subject, error, advice)) from error


def numerical_message(subject: str, error: BaseException, advice: str = "") -> str:
    """What failed on which recording and vessel, and what to do about it."""
    text = " ".join(str(error).split()) or type(error).__name__
    advice = advice or "look at the recording with `shadow info` and check the vessel's numbers"
    return f"{subject}: the computation came to no result ({text}): {advice}"
