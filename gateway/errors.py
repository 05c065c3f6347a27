"""What can go wrong, as one tree. The command line turns each into one line and an exit status."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

# Arithmetic without a result: a singular matrix, an overflow, a division by zero.
NUMERICAL_ERRORS = (np.linalg.LinAlgError, ArithmeticError)


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
