"""Effects from outside the package: a Python file named by its user, or an installed plug-in.

A plug-in registers its `Effect` objects under the entry point group `shadow.effects`.
"""

import hashlib
import importlib.util
import sys
from functools import lru_cache
from importlib.metadata import entry_points
from pathlib import Path

from gateway.errors import BadInput
from sim.effects.catalogue import EFFECTS
from sim.effects.effect import Effect


@lru_cache(maxsize=1)
def known_effects() -> tuple[Effect, ...]:
    """The catalogue, then what installed plug-ins add."""
    plugged = (point.load() for point in entry_points(group="shadow.effects"))
    return (*EFFECTS, *(effect for effect in plugged if isinstance(effect, Effect)))


def load_effects(path: str | Path) -> tuple[Effect, ...]:
    """All effects that a Python file defines at its top level, as it stands now."""
    file = Path(path)
    try:
        text = file.read_bytes()
    except OSError as error:
        raise BadInput(f"{file}: cannot read the effect file: {error.strerror}") from None
    # the content is in the name: an edited file is another module, and its kernel another kernel
    name = f"effect_file_{hashlib.sha256(text).hexdigest()[:16]}"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, file)
        if spec is None or spec.loader is None:
            raise BadInput(f"{file}: not a Python file (.py)")
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        try:
            spec.loader.exec_module(module)
        except Exception as error:  # whatever a user's file does wrong is one line for its user
            del sys.modules[name]
            raise BadInput(f"{file}: {type(error).__name__}: {error}") from None
    found = tuple(v for v in vars(sys.modules[name]).values() if isinstance(v, Effect))
    if not found:
        raise BadInput(f"{file}: defines no Effect (see docs/effects.md for one in twenty lines)")
    return found
