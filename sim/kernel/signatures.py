"""What `sim.kernel.cache` composes for one vessel: the functions that the drivers run on.

Only the signatures stand here. The bodies are written per combination of thrusters, rudders and
effects. A state is a tuple of floats (or arrays): north, east, yaw, u, v, r, then the memory of
actuators and effects. Commands are a tuple, thrusters first, then rudders.
"""

from typing import Any, NamedTuple

from sim.body import Report
from sim.state import Floats, Wrench

State = tuple[Any, ...]
Numbers = Any  # all parameters of the vessel, unpacked by `unpack`
NX = 6  # length of a state


class Inputs(NamedTuple):
    """What acts from outside during one step."""

    acting: tuple[Any, ...]  # what `actuated` makes of the commands [N, rad]
    voltage: float  # V
    wind_north: float  # m/s
    wind_east: float  # m/s
    wind_known: float  # 1 where the wind was measured


def unpack(theta: Floats) -> Numbers:
    """(P,) or (P, B) -> the numbers by name."""
    raise NotImplementedError


def delay_of(p: Numbers) -> float:
    """How much later all commands act [s]."""
    raise NotImplementedError


def latency_of(p: Numbers) -> float:
    """Age of reported position and velocity over ground [s]."""
    raise NotImplementedError


def state_from(row: Floats) -> State:
    """(nx,) or (nx, B) -> a state."""
    raise NotImplementedError


def actuated(row: Floats, p: Numbers) -> tuple[Any, ...]:
    """Commands (na,) or (na, B) -> static thrusts [N], then rudder angles [rad].

    All that does not depend on motion: worked out once per interval, not at every stage.
    """
    raise NotImplementedError


def axpy(x: State, h: float, k: State) -> State:
    """x + h k."""
    raise NotImplementedError


def at_rest(x: State, time: float, inputs: Inputs, p: Numbers) -> State:
    """The state with its memory set to what long constant commands leave there."""
    raise NotImplementedError


def rates(x: State, time: float, inputs: Inputs, p: Numbers) -> State:
    """Time derivative of the state, driven by the commands."""
    raise NotImplementedError


def pushed(x: State, time: float, inputs: Inputs, tau: Wrench, p: Numbers) -> State:
    """Time derivative of the state, driven by a force; the actuators' memory rests."""
    raise NotImplementedError


def commanded(x: State, time: float, inputs: Inputs, p: Numbers) -> Wrench:
    """τ(commands): the wrench of thrusters and rudders [N, N, N m]."""
    raise NotImplementedError


def missing(
    x: State, u_dot: float, v_dot: float, r_dot: float, time: float, inputs: Inputs, p: Numbers
) -> Wrench:
    """The balance: what the vessel would need on top of its commanded forces [N, N, N m]."""
    raise NotImplementedError


def required(
    x: State, u_dot: float, v_dot: float, r_dot: float, time: float, inputs: Inputs, p: Numbers
) -> Wrench:
    """The balance without the thrusters: the force that this ν̇ takes [N, N, N m]."""
    raise NotImplementedError


def observe(report: Report, p: Numbers) -> Report:
    """True motion -> what the sensors report."""
    raise NotImplementedError


def observe_now(report: Report, p: Numbers) -> Report:
    """True motion -> what the sensors would report if none of them were late."""
    raise NotImplementedError
