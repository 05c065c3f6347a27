"""Effects from outside the package: a Python file named by its user, or an installed plug-in.

A plug-in registers its `Effect` objects under the entry point group `shadow.effects`.
"""

import hashlib
import linecache
import sys
from functools import lru_cache
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType

from gateway.errors import BadInput
from gateway.files import write_whole
from sim.effects.catalogue import EFFECTS
from sim.effects.effect import Effect


@lru_cache(maxsize=1)
def known_effects() -> tuple[Effect, ...]:
    """The catalogue, then what installed plug-ins add."""
    plugged = (point.load() for point in entry_points(group="shadow.effects"))
    return (*EFFECTS, *(effect for effect in plugged if isinstance(effect, Effect)))


def load_effects(path: str | Path) -> tuple[Effect, ...]:
    """All effects that a Python file defines at its top level; BadInput where it cannot be run."""
    file = Path(path)
    try:
        text = file.read_bytes().decode("utf-8")
    except OSError as error:
        raise BadInput(f"{file}: cannot read the effect file: {error.strerror}") from None
    except UnicodeDecodeError:
        raise BadInput(f"{file}: not a Python file: its text is not UTF-8") from None
    found = tuple(v for v in vars(_module_of(file, text)).values() if isinstance(v, Effect))
    if not found:
        raise BadInput(f"{file}: defines no Effect (see docs/effects.md for one in twenty lines)")
    return found


def write_effect_copy(like: Effect, file: Path) -> None:
    """Write the source of an effect under another name, as a pattern for an effect of one's own."""
    name = file.stem
    if not name.isidentifier() or file.suffix != ".py":
        raise BadInput(f"{file}: a Python file whose name is that of the new effect: keel.py")
    if name in {effect.name for effect in known_effects()}:
        raise BadInput(f"{file}: there is an effect {name}: choose another name")
    if file.exists():
        raise BadInput(f"{file}: is there already, and may hold your work")
    text = like.source_code.replace(f'name="{like.name}"', f'name="{name}"')
    write_whole(file, text.encode(), "the effect")


def _module_of(file: Path, text: str) -> ModuleType:
    """Run an effect file's text as a module.

    Python's own loader would take stale bytecode for a file edited twice within a second. The
    content is in the module's name: an edited file is another module, its kernel another kernel.
    """
    name = f"effect_file_{hashlib.sha256(text.encode()).hexdigest()[:16]}"
    if name in sys.modules:
        return sys.modules[name]
    module = ModuleType(name)
    module.__file__ = str(file)
    # None for its time of change: `inspect` and tracebacks then quote what was run
    linecache.cache[str(file)] = (len(text), None, text.splitlines(keepends=True), str(file))
    sys.modules[name] = module
    try:
        exec(compile(text, str(file), "exec"), module.__dict__)
    except (Exception, SystemExit) as error:  # whatever a user's file raises is one line
        del sys.modules[name]
        message = " ".join(str(error).split())
        raise BadInput(f"{file}: {type(error).__name__}: {message}") from None
    return module
