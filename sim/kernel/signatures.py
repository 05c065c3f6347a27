"""Types of the functions that `sim.kernel.generator` writes for one vessel, for the type checker.

A state is a tuple of floats, or of arrays over a batch: north, east, yaw, u, v, r, then the memory
of actuators and effects. Commands are a row, thrusters first, then rudders.
"""

from collections.abc import Callable
from typing import Any

from sim.body import Flow, HeldInputs, Report
from sim.state import Floats, Inertia, Pose, Water, Wrench

State = tuple[Any, ...]
Numbers = Any  # all parameters of the vessel by name
Rates = Callable[[State, float, HeldInputs, Numbers], State]
Balance = Callable[[State, float, float, float, float, HeldInputs, Numbers], Wrench]

NX: int  # length of a state
unpack: Callable[[Floats], Numbers]  # parameters (P,) or (P, B) by name
delay_of: Callable[[Numbers], float]  # how much later all commands act [s]
latency_of: Callable[[Numbers], float]  # age of reported position and velocity over ground [s]
state_from: Callable[[Floats], State]  # of a row (nx,) or (nx, B)
axpy: Callable[[State, float, State], State]  # x + h k
# commands (na,) -> static thrusts [N], then rudder angles [rad]: once per interval of held inputs
static_actuation: Callable[[Floats, Numbers], tuple[Any, ...]]
settle_memory: Rates  # the state with the memory that constant inputs lead to
state_rates: Rates  # ẋ under the commands at a time [s]
# ẋ under the commands and a force beside them
state_rates_with_force: Callable[[State, float, HeldInputs, Wrench, Numbers], State]
# ẋ under a force instead of the commands: actuators keep their memory
state_rates_under_force: Callable[[State, float, HeldInputs, Wrench, Numbers], State]
water_at: Callable[[float, Pose, Numbers], Water]  # motion of the water at a time [s] and place
flow_at: Callable[[State, float, HeldInputs, Water, Numbers], Flow]
# M and balance(ν̇, ν) of an actuators' wrench: (x, u̇, v̇, ṙ, water, flow, τ, numbers)
balance: Callable[
    [State, float, float, float, Water, Flow, Wrench, Numbers], tuple[Inertia, Wrench]
]
commanded_wrench: Callable[[State, float, HeldInputs, Numbers], Wrench]  # τ(commands)
missing_wrench: Balance  # at this ν̇ and time: what the vessel needs beside its commanded forces
required_wrench: Balance  # the same with no commanded forces: what this ν̇ takes
observe: Callable[[Report, Numbers], Report]  # true motion -> what the sensors report
observe_undelayed: Callable[[Report, Numbers], Report]  # … if none of them were late
