"""Physics and inference: arrays in, arrays out.

Nothing here knows of sockets, files, buses or clocks, and nothing here imports `gateway`. The names
in `__all__` are kept and documented (docs/python.md); everything else is private and may change.
They are imported when they are first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sim.api import Simulation as Simulation
    from sim.api import add as add
    from sim.api import compare as compare
    from sim.api import simulate as simulate
    from sim.comparison.compare import Comparison as Comparison
    from sim.diagnosis.answer import Diagnosis as Diagnosis
    from sim.diagnosis.answer import Verdict as Verdict
    from sim.diagnosis.diagnose import DiagnoseSettings as DiagnoseSettings
    from sim.diagnosis.diagnose import diagnose as diagnose
    from sim.effects.catalogue import EFFECTS as EFFECTS
    from sim.effects.effect import Effect as Effect
    from sim.effects.effect import Parameter as Parameter
    from sim.effects.effect import Scope as Scope
    from sim.identification import IdentifySettings as IdentifySettings
    from sim.identification.identify import Identification as Identification
    from sim.identification.identify import identify as identify
    from sim.model import Model as Model
    from sim.prediction import MissingForce as MissingForce
    from sim.prediction import missing_force as missing_force
    from sim.prediction.segments import CompareSettings as CompareSettings
    from sim.trial import Trial as Trial
    from sim.vessel import AddedEffect as AddedEffect
    from sim.vessel import Dynamics as Dynamics
    from sim.vessel import Hull as Hull
    from sim.vessel import Rudder as Rudder
    from sim.vessel import Sensors as Sensors
    from sim.vessel import Servo as Servo
    from sim.vessel import Thruster as Thruster
    from sim.vessel import Vessel as Vessel

_HOMES = {
    "api": ("Simulation", "add", "compare", "simulate"),
    "comparison.compare": ("Comparison",),
    "diagnosis.answer": ("Diagnosis", "Verdict"),
    "diagnosis.diagnose": ("DiagnoseSettings", "diagnose"),
    "effects.catalogue": ("EFFECTS",),
    "effects.effect": ("Effect", "Parameter", "Scope"),
    "identification.identify": ("Identification", "identify"),
    "identification": ("IdentifySettings",),
    "model": ("Model",),
    "prediction": ("MissingForce", "missing_force"),
    "prediction.segments": ("CompareSettings",),
    "trial": ("Trial",),
    "vessel": (
        "AddedEffect", "Dynamics", "Hull", "Rudder", "Sensors", "Servo", "Thruster", "Vessel",
    ),
}  # fmt: skip
_MODULES = {name: f"sim.{home}" for home, names in _HOMES.items() for name in names}
__all__ = list(_MODULES)  # what TYPE_CHECKING imports above: a test holds the two together


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'sim' has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
