"""Thruster imbalance: the thrusters to port pull more, or less, than those to starboard.

    F → port_gain F   for thrusters with y < 0        port_gain [-]

Valid for: a damaged propeller, a worn motor, weed on one side; ahead and astern alike. Source:
Fossen, Handbook of Marine Craft Hydrodynamics, 2nd ed. 2021, ch. 9 (thrust coefficient matrix).
"""

from typing import Any

from sim.body import Flow, ThrusterParameters
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Need, Parameter, Scope, Separation
from sim.effects.words import THAN, FittedValues


def thrust(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> float:
    """Thrust -> thrust [N]."""
    return F * (1.0 + (drive.y < 0.0) * (p.port_gain - 1.0))


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return "beside the starboard motor, the port motor pushes " + p.size(
        "port_gain", "%", 100.0, 1.0, p.side("port_gain", " harder", " weaker", 1.0) + THAN
    )


EFFECT = Effect(
    name="thruster_imbalance",
    scope=Scope.BOAT,
    thrust=thrust,
    needs=(Need.PORT_THRUSTER,),
    parameters=(
        Parameter("port_gain", "-", lower=0.0, upper=2.0, start=1.0, scale=0.02, neutral=1.0),
    ),
    looks_like="pulls to one side in proportion to the throttle, on every heading, and to the "
    "other side astern",
    mistaken_for=("thruster_misalignment", "steering_offset", "cg_offset", "steady_wind"),
    evidence=EvidenceAxis(ForceAxis.YAW, "throttle"),
    separated={
        "thruster_misalignment": Separation(
            "spin on the spot to the left and to the right, and go astern", "reversals"
        )
    },
    in_words=in_words,
)
