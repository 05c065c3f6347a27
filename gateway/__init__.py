"""Everything that touches the world: links, logs, filter, bus, recorder, commands.

The names in `__all__` are kept and documented (docs/python.md); everything else is private and may
change. They are imported when they are first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gateway.api import example_log as example_log
    from gateway.api import plot as plot
    from gateway.api import save_vessel as save_vessel
    from gateway.files import vessel_names as vessel_names
    from gateway.ingest.open import open_log as open_log
    from gateway.offline.replay import ReplayOptions as ReplayOptions
    from gateway.offline.replay import replay as replay
    from gateway.offline.trials import TrialOptions as TrialOptions
    from gateway.offline.trials import load_trials as load_trials
    from gateway.user_effects import load_effects as load_effects
    from gateway.vessel_file import load_vessel as load_vessel

_HOMES = {
    "api": ("example_log", "plot", "save_vessel"),
    "ingest.open": ("open_log",),
    "offline.replay": ("ReplayOptions", "replay"),
    "offline.trials": ("TrialOptions", "load_trials"),
    "files": ("vessel_names",),
    "user_effects": ("load_effects",),
    "vessel_file": ("load_vessel",),
}
_MODULES = {name: f"gateway.{home}" for home, names in _HOMES.items() for name in names}
__all__ = list(_MODULES)  # what TYPE_CHECKING imports above: a test holds the two together


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'gateway' has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
