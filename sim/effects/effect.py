"""What an effect is: one physical cause that a model may or may not contain.

A law is a module-level function on floats or arrays, ufuncs only (`np.maximum`, never `if`), so
that the very same function runs on arrays in numpy and compiled on scalars. `p` holds the effect's
parameters by name. `command` and `angle` are evaluated once per interval of held commands, all
others at every stage of a step. An effect acts in one or more places:

    wiring(commands, place, p) -> c      of all commands, that of the actuator at `place` (0, 1, …)
    command(c, drive, p) -> c            the command of a thruster, before its thrust curve
    thrust(F, drive, flow, p) -> F       the thrust of a thruster [N]
    thrust_rate(F, state, drive, p)      the thrust that acts becomes a state with this rate [N/s]
    turn(azimuth, drive, flow, p)        the direction of a thruster [rad]
    reaction(F, drive, flow, p)          -> Wrench: force on the hull beside a thruster's own;
                                         drive.azimuth as it points just then
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
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import InitVar, dataclass, field, fields, replace
from enum import Enum, IntEnum
from pathlib import PurePath
from typing import Any, NamedTuple

import numpy as np

from sim.effects.tables import Formula, MapField
from sim.effects.words import FittedValues
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
    FIXED = "fixed"  # no search moves it: the range of a table


class Need(Enum):
    """What a vessel must have for an effect to act on it."""

    WIND_AREA = "hull.wind_area, the frontal and lateral area above water [m²]"  # else assumed
    PORT_THRUSTER = "a thruster to port of the centre line"
    ARM = "a motor off the centre line, or one that is steered or points aside"
    STEERING = "a rudder or a steered motor"
    FIXED_MOTOR = "a motor that is not steered"


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
TURN_SLOW_AND_FAST = Separation(
    "turn on the spot, or as slowly as she will, then the same turns at speed", "spin"
)


class ResidualForce(NamedTuple):
    """What a model leaves of a recording, usable rows: time (T,), place and force (T, 2) [s, m, N].

    Place and horizontal missing force are north and east; the force has no mean.

    body      the same on board, X, Y, N as it is (T, 3) [N, N, N m]
    nu        velocities (T, 3) [m/s, m/s, rad/s]
    commands  of the thrusters (T, n), full astern −1 … full ahead 1
    yaw       heading (T,) [rad]
    """

    time: Floats
    place: Floats
    force: Floats
    body: Floats = np.zeros((0, 3))
    nu: Floats = np.zeros((0, 3))
    commands: Floats = np.zeros((0, 0))
    yaw: Floats = np.zeros(0)


Values = Mapping[str, float]
Intervals = Mapping[str, tuple[float, float]]
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
    default    what stands where a vessel file says nothing; None: it must say it
    prior      standard deviation of what is known beforehand, about `start`: a search for the
               effect keeps to it; 0: anything within the bounds
    sided      in a mirror, where port and starboard are exchanged, it changes its sign
    least      what a good sensor, or what is known of a boat, is off by anyway: of a smaller size
               the effect is not told
    reached    a limit that nature reaches, beside zero and neutral: of a motor that is dead
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
    prior: float = 0.0
    default: float | None = None
    sided: bool = False
    least: float = 0.0
    reached: float | None = None
    says: InitVar[str | None] = None  # the name of `description` in 0.1

    def __post_init__(self, says: str | None) -> None:
        if says is not None:
            warnings.warn(
                f"parameter {self.name}: write description= instead of says=",
                DeprecationWarning,
                stacklevel=3,  # the line of the effect's file
            )
            object.__setattr__(self, "description", self.description or says)
        if not self.lower <= self.start <= self.upper:
            raise ValueError(
                f"parameter {self.name}: start {self.start} is outside {self.lower} … {self.upper}"
            )
        if self.scale == 0.0:
            object.__setattr__(self, "scale", 0.1 * (self.upper - self.lower))

    @property
    def is_fitted(self) -> bool:
        """Whether a fit moves it: a small step changes a little."""
        return self.kind in (Kind.NUMBER, Kind.CIRCLE)


def circular_parameter(
    name: str, description: str, scale: float = 0.1, starts: tuple[float, ...] = (),
    sided: bool = False,
) -> Parameter:  # fmt: skip
    """An angle [rad] all around; bounds beyond one turn, so that no search stops at them."""
    return Parameter(
        name, "rad", lower=-7.0, upper=7.0, start=0.0, scale=scale, description=description,
        kind=Kind.CIRCLE, starts=starts, sided=sided,
    )  # fmt: skip


class Assumption(NamedTuple):
    """What had to be assumed for the numbers of an effect that was found, and what that costs.

    description  a sentence, without the name of the effect
    ci95         parameter -> its interval with what was assumed being off
    numbers      name with unit -> value, for programs
    """

    description: str
    ci95: Mapping[str, tuple[float, float]]
    numbers: Mapping[str, float]


class Measured(NamedTuple):
    """An effect whose cause may be measured: its own parameters do not count there.

    column  of a trial (`wind`), NaN where it was not measured
    fitted  numbers of the vessel, by the names of `Body`, and own ones that are fitted then
    values  of the parameters: what acts where it was not measured
    """

    column: str
    fitted: tuple[str, ...]
    values: Values


TIME_OF_CHANGE = Parameter(
    "time", "s", lower=0.0, upper=1e5, start=60.0, scale=5.0, description="after the first sample",
    kind=Kind.MOMENT,
)  # fmt: skip


LAWS = (
    "wiring", "command", "thrust", "thrust_rate", "turn", "reaction", "angle", "angle_rate",
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
    contains      the effect that it holds as a whole: the two never stand side by side
    beside        the effect that it is one more of: tried where that one stands, and not alone
    of_each_day   every voyage has some of it: fits of many recordings give each its own
    alike         of an effect of a day: what of the boat it is where every day has it
    partial       one such effect follows only part of what nature does: a sea has many waves
    unsteady      share of what it explains that it leaves by being taken for steady: gusts
    evidence      what its evidence is drawn against, or that by its values; None: found from the
                  data
    separated     other effect -> what tells the two apart; one of a pair declares it
    explains      what a fit of the base notices where this effect is missing
    search        (vessel, residual) -> where a search begins, if its parameters' own starts do not
                  serve; `residual()` is what the model leaves of the longest recording
    more_starts   (length of the longest recording [s]) -> starts, each of which is fitted whole
                  where a first look leaves much unexplained: from where a force that goes with a
                  square was found no small step may lead to the best
    tables        (vessel, extent of u, v, r [m/s, rad/s], u r [m/s²], north, east [m], voltage [V],
                  commands of the motors and time [s], as u, v, r, swing, north, east, voltage,
                  motor, time) -> empty tables where a search begins, if the effect is a curve that
                  is not looked for in the residual (`search`)
    knot_places   of such a table: in order, the parameters (`Kind.FIXED`, shares of the way) that
                  say where its inner knots are, which are moved to where it bends once it is filled
    turned        of such a table: the directions (`Kind.FIXED`) that are turned then, and how far
                  in one round
    over_map      (fitted values) -> what it supplies at places of the map, where it is one
    in_words      (fitted values) -> what was found, in a sentence (`sim.effects.words`)
    formulas      (vessel, values, standard deviations) -> short laws that may stand for a table
    formula_source  (name, values, formula) -> the Python file of an effect with that law
    example       values that show it, if no number can be made stronger step by step
    measured      what stands in a recording where the cause itself was measured
    assumption    (vessel, values, intervals by parameter) -> what had to be assumed for them
    within        (vessel) -> what numbers can be on that hull, where that is less than their limits
    mismatch      (vessel, values) -> why numbers that each are possible do not go together, or not
                  with that vessel, so that the effect would do nothing or something else; empty
                  where they do
    disbelieved   (values, trials) -> why numbers that are possible cannot be true of these trials;
                  empty where they may be
    undone        (values, base numbers of the file, as fitted) -> why a base that moves along makes
                  the effect nothing that was seen; empty where it does not
    pattern_for   what an error may depend on (`sim.diagnosis.force_terms.GROUPS`): this file is
                  then proposed as the pattern for an effect of one's own
    pattern       of a curve: the effect whose file is the pattern for a law in its place
    acts_when     law -> by name, what numbers must be for it to do anything: with others compiled
                  code passes it over
    """

    name: str
    scope: Scope
    parameters: tuple[Parameter, ...]
    looks_like: str
    mistaken_for: tuple[str, ...] = ()
    needs: tuple[Need, ...] = ()
    shown_by: tuple[Shown, ...] = ()
    general_of: str = ""
    contains: str = ""
    beside: str = ""
    of_each_day: bool = False
    alike: str = ""
    partial: bool = False
    unsteady: float = 0.0
    evidence: EvidenceAxis | Callable[[Values], EvidenceAxis] | None = None
    separated: Mapping[str, Separation] = field(default_factory=dict, compare=False)
    explains: tuple[Symptom, ...] = ()
    search: Callable[[Any, Callable[[], ResidualForce]], Sequence[Values]] | None = None
    more_starts: Callable[[float], Sequence[Values]] | None = None
    tables: Callable[[Any, Mapping[str, tuple[float, float]]], Sequence[Values]] | None = None
    knot_places: tuple[str, ...] = ()
    turned: Mapping[str, float] = field(default_factory=dict, compare=False)
    over_map: Callable[[FittedValues], MapField] | None = None
    in_words: Callable[[FittedValues], str] | None = None
    formulas: Callable[[Any, Values, Values], Sequence[Formula]] | None = None
    formula_source: Callable[[str, Values, Formula], str] | None = None
    example: Values | None = field(default=None, compare=False)
    measured: Measured | None = field(default=None, compare=False)
    assumption: Callable[[Any, Values, Intervals], Assumption | None] | None = None
    within: Callable[[Any], Intervals] | None = None
    mismatch: Callable[[Any, Values], str] | None = None
    disbelieved: Callable[[Values, Sequence[Any]], str] | None = None
    undone: Callable[[Values, Any, Any], str] | None = None
    pattern_for: tuple[str, ...] = ()
    pattern: str = ""
    acts_when: Mapping[str, Mapping[str, tuple[float, ...]]] = field(
        default_factory=dict, compare=False
    )
    wiring: Law | None = None
    command: Law | None = None
    thrust: Law | None = None
    thrust_rate: Law | None = None
    turn: Law | None = None
    reaction: Law | None = None
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
        known = {p.name for p in self.parameters}
        for law, numbers in self.acts_when.items():
            if law not in self.laws or not known.issuperset(numbers):
                raise ValueError(f"effect {self.name}: acts_when names no law or number: {law}")
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
    def of_the_boat(self) -> "Effect":
        """The same effect with one set of numbers, whatever the day."""
        return replace(self, scope=Scope.BOAT)

    @property
    def of_a_day(self) -> "Effect":
        """The same effect with numbers of each day."""
        return replace(self, scope=Scope.VOYAGE)

    @property
    def is_alike(self) -> bool:
        """Whether it is an effect of a day that this boat has alike on every one."""
        return bool(self.alike) and self.scope is Scope.BOAT

    @property
    def is_curve(self) -> bool:
        """Whether it has no law but takes any shape: no hypothesis of a search, fitted where none
        of them explains the data.
        """
        return self.tables is not None or bool(self.pattern)

    @property
    def is_like_the_base(self) -> bool:
        """Whether numbers of a hull that are off do the same: it is told only beyond what these are
        known to, and before others are found it stands in for all that slows a boat.
        """
        acts = self.thrust or self.reaction
        return acts is not None and any(p.least for p in self.parameters)

    @property
    def fit_parameters(self) -> tuple[str, ...]:
        """Names of the parameters that a fit moves."""
        return tuple(p.name for p in self.parameters if p.is_fitted)

    def evidence_axis(self, values: Values) -> EvidenceAxis | None:
        """What its evidence is drawn against with these values; None: found from the data."""
        return self.evidence(values) if callable(self.evidence) else self.evidence

    def looks_like_effect(self, other: "Effect") -> bool:
        """Whether either of the two says that it may be mistaken for the other."""
        return other.name in self.mistaken_for or self.name in other.mistaken_for

    @property
    def has_sides(self) -> bool:
        """Whether it is one of a few things, whenever it acts: a search has to begin with each."""
        kinds = {p.kind for p in self.parameters}
        return Kind.CHOICE in kinds and Kind.MOMENT not in kinds

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
