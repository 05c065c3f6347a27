"""What an effect is: one physical cause that a model may or may not contain.

A law is a module-level function on floats or arrays, ufuncs only (`np.maximum`, never `if`), so
that the very same function runs on arrays in numpy and compiled on scalars. `p` is a tuple of the
effect's parameters by name. `command` and `angle` are asked once per interval of held commands,
all others at every stage of a step. An effect acts in one or more places:

    wiring(commands, place, p) -> c      of all commands, that of the actuator at `place` (0, 1, …)
    command(c, drive, p) -> c            the command of a thruster, before its thrust curve
    thrust(F, drive, flow, p) -> F       the thrust of a thruster [N]
    thrust_rate(F, state, drive, p)      the thrust that acts becomes a state with this rate [N/s]
    turn(azimuth, drive, flow, p)        the direction of a thruster [rad]
    angle(δ, blade, p) -> δ              the angle of a rudder or steered motor [rad]
    angle_rate(δ, state, blade, p)       the angle that acts becomes a state with this rate [rad/s]
    delay(p) -> s                        all commands act that much later
    water(time, pose, p) -> Water        motion of the water
    force(flow, p) -> Wrench             force on the hull
    inertia(M, flow, p) -> Inertia       mass matrix
    observe(report, p) -> Report         what the sensors report
    latency(p) -> s                      reported position and velocity over ground are that old;
                                         `observe` stands for it where nothing earlier is known
    rate(flow, state, p), start          a state of its own; `force` is then force(flow, state, p)

Everything else that the software needs to know of an effect is declared beside its laws, in the
same file: what its evidence is drawn against, where a search for its parameters begins, which
manoeuvre tells it from another effect, which values show it.
"""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from enum import Enum, IntEnum
from pathlib import PurePath
from typing import Any, NamedTuple

import numpy as np

from sim.state import Floats

Law = Callable[..., Any]


class LawError(ValueError):
    """A law of an effect does not work: what went wrong, in one line."""


class Scope(Enum):
    """Where the parameters of an effect hold."""

    BOAT = "boat"  # true of the boat wherever it goes
    VOYAGE = "voyage"  # of one day: current, wind, the moment of a fault


class Kind(Enum):
    """How a parameter can be searched for."""

    NUMBER = "number"  # a small step makes a small difference
    CIRCLE = "circle"  # an angle [rad]: all around is the same place
    MOMENT = "moment"  # of an event [s]: nothing changes until it passes a sample
    CHOICE = "choice"  # a whole number


class Need(Enum):
    """What a vessel must have for an effect to act on it."""

    WIND_AREA = "hull.wind_area, the frontal and lateral area above water [m²]"
    PORT_THRUSTER = "a thruster to port of the centre line"
    STEERING = "a rudder or a steered motor"


class Shown(Enum):
    """What a recording must hold for an effect to be told from it."""

    COMMANDS = "commands several times a second"
    VELOCITY = "velocities several times a second"
    CHANGE = "minutes, for what changes as time goes by"
    ASTERN = "motors that ran astern"
    OPPOSITE = "opposite headings"
    CIRCLES = "headings all around"
    VOLTAGE = "a voltage that changes"


class Role(Enum):
    """What a parameter means beyond being a number."""

    PERIOD = "period"  # [s]: searched from half a minute to twice the recording, in ratios
    TIME_CONSTANT = "time constant"  # [s] of a first-order lag: integration steps stay below it


class Symptom(Enum):
    """What a fit of the base alone may notice without knowing its cause."""

    LATE_COMMANDS = "the boat answers later than telemetry can explain"
    LATE_VELOCITY = "velocities are later than telemetry can explain"


class ForceAxis(IntEnum):
    """Component of the missing force that an effect shows in."""

    SURGE = 0  # X [N]
    SWAY = 1  # Y [N]
    YAW = 2  # N [N m]
    ALONG = 3  # horizontal force in the direction, over the ground, of the effect itself [N]


class EvidenceAxis(NamedTuple):
    """What the evidence for an effect is drawn against: the missing force over one variable.

    by        name of the variable (`sim.diagnosis.evidence.VARIABLES`), or of an own one
    variable  the own one: (time (T,) [s], north (T,), east (T,) [m], values by name) -> (T,)
              [rad, 0 … 2π]
    """

    axis: ForceAxis
    by: str
    variable: Callable[..., Floats] | None = None


class Separation(NamedTuple):
    """What tells two effects apart: what to do, and the excitation that comes nearest to it."""

    description: str
    excitation: str


# separations that several effects declare
COAST_DOWN = Separation(
    "accelerate to full speed, then coast to a stop: without thrust only drag is left", "steps"
)
TURN_SLOW_AND_FAST = Separation("turn on the spot, then the same turns at speed", "spin")


class ResidualForce(NamedTuple):
    """What a model leaves of a recording, usable rows: time (T,), place and force (T, 2) [s, m, N].

    Place and horizontal missing force are north and east; the force has no mean.
    """

    time: Floats
    place: Floats
    force: Floats


Values = Mapping[str, float]
QUARTERS = (0.0, 0.5 * np.pi, np.pi, 1.5 * np.pi)  # rad, of a circle
THIRDS = (0.0, 2.0 * np.pi / 3.0, 4.0 * np.pi / 3.0)  # rad


@dataclass(frozen=True)
class Parameter:
    """One number of an effect: unit, bounds, and how it is searched for.

    start      where a fit begins
    scale      size of a change that matters; left out: a tenth of the range
    neutral    with all parameters that have one there, the effect does nothing
    role       what it means beyond being a number: a period, a time constant
    starts     where a search begins; none: `start`, on both sides of a symmetric zero, the four
               quarters of a circle, moments along the recording, a choice among the thrusters
    direction  name of the angle that this magnitude belongs to, the next parameter: the two are
               fitted as north and east parts
    """

    name: str
    unit: str
    lower: float
    upper: float
    start: float
    scale: float = 0.0
    description: str = ""
    kind: Kind = Kind.NUMBER
    neutral: float | None = None
    role: Role | None = None
    starts: tuple[float, ...] = ()
    direction: str = ""

    def __post_init__(self) -> None:
        if not self.lower <= self.start <= self.upper:
            raise ValueError(
                f"parameter {self.name}: start {self.start} is outside {self.lower} … {self.upper}"
            )
        if self.scale == 0.0:
            object.__setattr__(self, "scale", 0.1 * (self.upper - self.lower))


def circular_parameter(
    name: str, description: str, scale: float = 0.1, starts: tuple[float, ...] = ()
) -> Parameter:
    """An angle [rad] all around; bounds beyond one turn, so that no search stops at them."""
    return Parameter(
        name, "rad", lower=-7.0, upper=7.0, start=0.0, scale=scale, description=description,
        kind=Kind.CIRCLE, starts=starts,
    )  # fmt: skip


TIME_OF_CHANGE = Parameter(
    "time", "s", lower=0.0, upper=1e5, start=60.0, scale=5.0, description="after the first sample",
    kind=Kind.MOMENT,
)  # fmt: skip


LAWS = (
    "wiring", "command", "thrust", "thrust_rate", "turn", "angle", "angle_rate",
    "delay", "water", "force", "inertia", "observe", "latency", "rate",
)  # fmt: skip


def _source_of(laws: Sequence[Law]) -> str:
    """Text of the file that the laws stand in; of the laws themselves where there is no file."""
    try:
        return inspect.getsource(inspect.getmodule(laws[0]) or laws[0])
    except (OSError, TypeError):
        return "\n".join(inspect.getsource(law) for law in laws)


@dataclass(frozen=True)
class Effect:
    """One physical cause: where it acts, its parameters, and what it looks like in the data.

    needs         what a vessel must have for it
    looks_like    in the data, in plain words
    mistaken_for  effects that look alike
    shown_by      what a recording must hold to tell it
    general_of    the simpler effect that this one can always stand in for: that one comes first
    partial       one such effect follows only part of what nature does: a sea has many waves
    evidence      what its evidence is drawn against; None: found from the data
    separated     other effect -> what tells the two apart; one of a pair declares it
    explains      what a fit of the base notices where this effect is missing
    search        (vessel, residual) -> where a search begins, if its parameters' own starts do not
                  serve; `residual()` is what the model leaves of the longest recording
    example       values that show it, if no number can be made stronger step by step
    pattern_for   what an error may depend on (`sim.diagnosis.force_terms.GROUPS`): this file is
                  then proposed as the pattern for an effect of one's own
    """

    name: str
    scope: Scope
    parameters: tuple[Parameter, ...]
    looks_like: str
    mistaken_for: tuple[str, ...] = ()
    needs: tuple[Need, ...] = ()
    shown_by: tuple[Shown, ...] = ()
    general_of: str = ""
    partial: bool = False
    evidence: EvidenceAxis | None = None
    separated: Mapping[str, Separation] = field(default_factory=dict, compare=False)
    explains: tuple[Symptom, ...] = ()
    search: Callable[[Any, Callable[[], ResidualForce]], Sequence[Values]] | None = None
    example: Values | None = field(default=None, compare=False)
    pattern_for: tuple[str, ...] = ()
    wiring: Law | None = None
    command: Law | None = None
    thrust: Law | None = None
    thrust_rate: Law | None = None
    turn: Law | None = None
    angle: Law | None = None
    angle_rate: Law | None = None
    delay: Law | None = None
    water: Law | None = None
    force: Law | None = None
    inertia: Law | None = None
    observe: Law | None = None
    latency: Law | None = None
    rate: Law | None = None
    start: float = 0.0
    source_code: str = field(init=False, repr=False, compare=False)  # the kernel's name holds it

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", tuple(self.parameters))
        if not self.name.isidentifier():
            raise ValueError(f"effect name {self.name!r} must be a plain identifier")
        if not self.laws:
            raise ValueError(f"effect {self.name} declares no law: give one of {', '.join(LAWS)}")
        # read now: should the file change later, these are still the laws that were loaded
        object.__setattr__(self, "source_code", _source_of(tuple(self.laws.values())))

    @property
    def laws(self) -> dict[str, Law]:
        """Place -> law, for the places where the effect acts."""
        return {
            f.name: getattr(self, f.name)
            for f in fields(self)
            if f.name in LAWS and getattr(self, f.name) is not None
        }

    @property
    def fit_parameters(self) -> tuple[str, ...]:
        """Names of the parameters that a fit moves: those where a small step changes a little."""
        return tuple(p.name for p in self.parameters if p.kind in (Kind.NUMBER, Kind.CIRCLE))

    @property
    def module(self) -> str:
        """Name of the module that the laws stand in."""
        return next(iter(self.laws.values())).__module__

    @property
    def explanation(self) -> str:
        """The docstring of the effect's file: equation, symbols, validity, source."""
        return inspect.getdoc(inspect.getmodule(next(iter(self.laws.values())))) or ""

    @property
    def file(self) -> str:
        """Name of the file that the laws stand in."""
        return PurePath(inspect.getfile(next(iter(self.laws.values())))).name
