"""A file written whole or not at all."""

from contextlib import suppress
from pathlib import Path

from gateway.errors import ShadowError


def write_whole(file: Path, content: bytes, what: str, folders: bool = False) -> None:
    """Write a file, or raise a ShadowError that names `what` and leave the old file as it was.

    `folders`: make the folders that are missing.
    """
    part = file.with_name(f".{file.name}.part")
    try:
        if folders:
            file.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(content)
        part.replace(file)
    except OSError as error:
        raise ShadowError(f"{file}: cannot write {what}: {error.strerror}") from None
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)
