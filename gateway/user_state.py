"""What the program remembers between commands, in the user's state folder, one small file each.

`$XDG_STATE_HOME/shadow-gateway` (else `~/.local/state/shadow-gateway`). Only the user may write
there: an entry that belongs to someone else, or that others may write, is as if it were not there.
"""

import hashlib
import json
import os
import stat
from contextlib import suppress
from pathlib import Path
from typing import Any

OTHERS_MAY_WRITE = stat.S_IWGRP | stat.S_IWOTH


def state_folder() -> Path:
    """The folder that entries are kept in; it may not exist yet."""
    base = os.environ.get("XDG_STATE_HOME")
    return (Path(base) if base else Path.home() / ".local" / "state") / "shadow-gateway"


def remember(kind: str, key: str, entry: dict[str, Any]) -> bool:
    """Keep an entry under a key -> whether that was possible."""
    file = _file(kind, key)
    part = file.with_name(f"{file.name}.{os.getpid()}.part")
    try:
        file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        part.touch(mode=0o600)
        part.chmod(0o600)  # whatever the umask: an entry that others may write counts for nothing
        part.write_text(json.dumps({"key": key, **entry}), encoding="utf-8")
        part.replace(file)
    except OSError:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        return False
    return private(file)


def recall(kind: str, key: str) -> dict[str, Any] | None:
    """The entry under a key; None where there is none that only the user can have written."""
    file = _file(kind, key)
    try:
        if not (private(file.parent) and private(file)):
            return None
        entry = json.loads(file.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    return entry if isinstance(entry, dict) and entry.get("key") == key else None


def private(path: Path) -> bool:
    """Whether a file or folder belongs to the user, and nobody else may write it.

    The administrator's count as the user's own: whoever is root can do all of it anyway. A system
    without owners (Windows) has nothing to ask.
    """
    try:
        found = path.stat()
    except OSError:
        return False
    if not hasattr(os, "getuid"):
        return True
    return found.st_uid in (os.getuid(), 0) and not found.st_mode & OTHERS_MAY_WRITE


def _file(kind: str, key: str) -> Path:
    return state_folder() / kind / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.json"
