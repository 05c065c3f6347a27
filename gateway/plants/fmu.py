"""A co-simulation FMU (FMI 2 or 3) as a plant, its variables mapped by a TOML table.

    file = "boat.fmu"               # beside the table
    step = 0.02                     # s, the longest communication step; default 0.02
    [inputs]                        # X, N needed; Y, voltage, wind_north, wind_east if it has them
    X = "tau_x"                     # N
    N = { variable = "tau_n", factor = -1.0 }    # what the FMU takes = factor · ours + offset
    [outputs]                       # north, east, yaw, u, v, r needed: m, rad, m/s, rad/s
    north = "x"                     # ours = factor · the FMU's + offset
    yaw = { variable = "heading_deg", factor = 0.017453292519943295 }
    [start]                         # variables that take north, east, yaw, u, v, r at the start
    u = "u0"
    [parameters]
    mass = 25.0

Where [start] has no pose, the FMU starts at its own and is moved and turned to where the boat is.
With down, roll, pitch, w, roll_rate and pitch_rate as outputs it has six degrees of freedom. An FMU
is a program: whoever names one runs it.
"""

import shutil
import tempfile
import weakref
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil, cos, isfinite, nan, sin
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from annotated_types import Gt, Le
from pydantic import Field, TypeAdapter, ValidationError

from gateway.errors import BadInput
from gateway.toml_file import explain, read_toml, validated
from gateway.vessel_tables import Number, StrictTable
from sim.model import Model
from sim.plants import PlantKind
from sim.plants.plant import Afloat, Plant, PlantInputs, PlantMotion
from sim.state import Pose, Velocity, Wrench, to_world

PLANE = ("north", "east", "yaw", "u", "v", "r")
AFLOAT = ("down", "roll", "pitch", "w", "roll_rate", "pitch_rate")


class MappedVariable(StrictTable):
    """A variable of the FMU, and how its value relates to ours."""

    variable: str
    factor: Number = 1.0
    offset: Number = 0.0


Name = str | MappedVariable
InputName = Literal["X", "Y", "N", "voltage", "wind_north", "wind_east"]
OutputName = Literal[
    "north", "east", "yaw", "u", "v", "r", "down", "roll", "pitch", "w", "roll_rate", "pitch_rate"
]
StartName = Literal["north", "east", "yaw", "u", "v", "r"]


class FmuTable(StrictTable):
    """The table of an FMU as written."""

    file: str
    step: Annotated[float, Gt(0.0), Le(1.0)] = 0.02
    inputs: dict[InputName, Name]
    outputs: dict[OutputName, Name]
    start: dict[StartName, Name] = Field(default_factory=dict)
    parameters: dict[str, Number] = Field(default_factory=dict)


class FmuState(NamedTuple):
    """A moment of an FMU: its time, outputs, their rates over the last step, and a snapshot."""

    number: int  # counts the moments of one plant
    time: float  # s of the FMU's own clock
    values: tuple[float, ...]
    rates: tuple[float, ...]
    place: tuple[float, float, float]  # where the FMU's origin lies: north, east [m], yaw [rad]
    snapshot: Any  # None where the FMU cannot save its state


def load_fmu(text: str) -> tuple[Callable[[Model], Plant], str]:
    """A table's file name -> what makes the plant, and the table's text; BadInput in one line."""
    file = Path(text)
    tables = read_toml(file, "the table of an FMU")
    try:
        table = validated(TypeAdapter(FmuTable), tables)
    except ValidationError as error:
        raise BadInput(f"{file}: {explain(error)}") from None
    for kind, given, needed in (
        ("inputs", table.inputs, ("X", "N")), ("outputs", table.outputs, PLANE),
    ):  # fmt: skip
        missing = [f"{kind}.{name}" for name in needed if name not in given]
        if missing:
            raise BadInput(f"{file}: missing key {', '.join(missing)}")
    archive = file.parent / table.file
    described = _described(file, archive)
    library = _Library.of(file, archive, described, table)
    sort = FloatingFmu if all(name in table.outputs for name in AFLOAT) else FmuPlant

    def build(model: Model) -> Plant:
        plant = sort(table, library.instance())
        try:
            plant.check_saving()
        except ArithmeticError as error:
            raise ValueError(str(error)) from None
        return plant

    return build, file.read_text(encoding="utf-8")


FMU = PlantKind(
    "fmu",
    "a co-simulation FMU (FMI 2, 3), mapped by a table: fmu:TABLE.toml (extra: fmu)",
    lambda model: _needs_a_table(),
    load_fmu,
)


def _needs_a_table() -> Plant:
    raise ValueError("plant fmu: expected fmu:FILE, the table that describes it")


def _described(file: Path, archive: Path) -> Any:
    """The model description of an FMU; BadInput where it is none that can be run."""
    try:
        import fmpy
    except ImportError:
        raise BadInput("FMPy is not installed: pip install 'shadow-gateway[fmu]'") from None
    if not archive.is_file():
        raise BadInput(f"{file}: file = {archive.name!r}: there is no such file beside it")
    try:
        with archive.open("rb") as stream:
            described = fmpy.read_model_description(stream, validate=False)
    except Exception as error:  # whatever FMPy, zipfile and lxml say of a file that is none
        raise BadInput(f"{archive}: not an FMU: {error}") from None
    if described.coSimulation is None:
        raise BadInput(f"{archive}: an FMU for model exchange alone: expected co-simulation")
    if not str(described.fmiVersion).startswith(("2.", "3.")):
        raise BadInput(f"{archive}: FMI {described.fmiVersion}: expected 2 or 3")
    return described


@dataclass(frozen=True)
class _Library:
    """An FMU that can be run: its description, where it is unpacked, its variables."""

    archive: Path
    described: Any
    folder: str
    references: Mapping[str, int]

    @classmethod
    def of(cls, file: Path, archive: Path, described: Any, table: FmuTable) -> "_Library":
        """Check that every variable of the table is there, then unpack; BadInput names them."""
        known = {v.name: v.valueReference for v in described.modelVariables}
        wanted = [
            _variable(name).variable
            for part in (table.inputs, table.outputs, table.start) for name in part.values()
        ]  # fmt: skip
        missing = [name for name in (*wanted, *table.parameters) if name not in known]
        if missing:
            there = ", ".join(list(known)[:12]) + (" …" if len(known) > 12 else "")
            raise BadInput(
                f"{file}: {archive.name} has no variable {', '.join(missing)}: it has {there}"
            )
        kinds = {v.name: v.type for v in described.modelVariables}
        other = [n for n in (*wanted, *table.parameters) if kinds[n] not in ("Real", "Float64")]
        if other:
            raise BadInput(
                f"{file}: {other[0]} of {archive.name} is {kinds[other[0]]}: expected a real number"
            )
        import fmpy

        folder = tempfile.mkdtemp(prefix="shadow-fmu-")
        fmpy.extract(str(archive), unzipdir=folder)
        library = cls(archive, described, folder, known)
        weakref.finalize(library, shutil.rmtree, folder, True)
        return library

    def instance(self) -> "_Instance":
        """One boat of it; ValueError where it does not run on this machine."""
        from fmpy.fmi2 import FMU2Slave
        from fmpy.fmi3 import FMU3Slave

        sort = FMU3Slave if str(self.described.fmiVersion).startswith("3.") else FMU2Slave
        try:
            slave = sort(
                guid=self.described.guid, unzipDirectory=self.folder,
                modelIdentifier=self.described.coSimulation.modelIdentifier, instanceName="boat",
            )  # fmt: skip
            slave.instantiate()
        except Exception as error:  # a missing binary for this platform, a library that is missing
            raise ValueError(f"{self.archive.name} does not run here: {error}") from None
        return _Instance(self, slave)


class _Instance:
    """A running FMU: one set of functions for FMI 2 and 3."""

    def __init__(self, library: _Library, slave: Any) -> None:
        self._library, self._slave = library, slave  # the library keeps the unpacked files
        self.name = library.described.modelName
        self.saves = bool(library.described.coSimulation.canGetAndSetFMUstate)
        self._three = hasattr(slave, "getFloat64")
        self.moment = -1  # number of the moment that it is at
        self._fresh = True

    def begin(self, values: Mapping[str, float]) -> None:
        """Initialise, with these start values of variables."""
        if not self._fresh:
            self._slave.reset()
        self._fresh = False
        if self._three:
            self.set(values)
            self._slave.enterInitializationMode(startTime=0.0)
        else:
            self._slave.setupExperiment(startTime=0.0)
            self.set(values)
            self._slave.enterInitializationMode()
        self._slave.exitInitializationMode()

    def set(self, values: Mapping[str, float]) -> None:
        """Give variables their values."""
        if values:
            references = [self._library.references[name] for name in values]
            setter = self._slave.setFloat64 if self._three else self._slave.setReal
            setter(references, list(values.values()))

    def get(self, names: Sequence[str]) -> list[float]:
        """Values of variables."""
        references = [self._library.references[name] for name in names]
        getter = self._slave.getFloat64 if self._three else self._slave.getReal
        return list(getter(references))

    def advance(self, time: float, dt: float) -> None:
        """Go on by dt [s]; ArithmeticError where the FMU refuses."""
        try:
            self._slave.doStep(currentCommunicationPoint=time, communicationStepSize=dt)
        except Exception as error:  # FMPy raises a bare Exception with the function's name
            raise ArithmeticError(f"{self.name} stopped after {time:.2f} s: {error}") from None

    def snapshot(self) -> Any:
        """Its state as it is, freed with the value that holds it; None where it cannot be saved."""
        if not self.saves:
            return None
        get, free = (
            (self._slave.getFMUState, self._slave.freeFMUState)
            if self._three
            else (self._slave.getFMUstate, self._slave.freeFMUstate)
        )
        kept = _Snapshot(get())
        weakref.finalize(kept, free, kept.pointer)
        return kept

    def restore(self, kept: "_Snapshot") -> None:
        """Back to a snapshot."""
        (self._slave.setFMUState if self._three else self._slave.setFMUstate)(kept.pointer)


class _Snapshot:
    """What an FMU points to as its state."""

    def __init__(self, pointer: Any) -> None:
        self.pointer = pointer


def _variable(name: Name) -> MappedVariable:
    return MappedVariable(variable=name) if isinstance(name, str) else name


@dataclass
class FmuPlant:
    """An FMU as a plant of three degrees of freedom."""

    table: FmuTable
    instance: _Instance
    _moments: int = 0
    _inputs: dict[str, MappedVariable] = field(init=False)
    _outputs: dict[str, MappedVariable] = field(init=False)
    _start: dict[str, MappedVariable] = field(init=False)

    def __post_init__(self) -> None:
        self._inputs = {k: _variable(v) for k, v in self.table.inputs.items()}
        self._outputs = {k: _variable(v) for k, v in self.table.outputs.items()}
        self._start = {k: _variable(v) for k, v in self.table.start.items()}

    @property
    def name(self) -> str:
        """The FMU's model."""
        return str(self.instance.name)

    @property
    def rewinds(self) -> bool:
        """Whether it can be stepped from a moment other than the last: its FMU saves its state."""
        return self.instance.saves

    def check_saving(self) -> None:
        """See that a step from a saved moment can be repeated: some FMUs save a part of it only."""
        if not self.rewinds:
            return
        calm, still = PlantInputs(0.0, nan, nan, nan), PlantMotion(Pose(0, 0, 0), Velocity(0, 0, 0))
        state, push = self.initial_state(still, calm), Wrench(1.0, 0.0, 1.0)
        for _ in range(3):
            state = self.step(state, push, calm, self.table.step)
        once = self.step(state, Wrench(0.0, 0.0, 0.0), calm, self.table.step)
        again = self.step(state, Wrench(0.0, 0.0, 0.0), calm, self.table.step)
        self.instance.saves = once.values == again.values

    def initial_state(self, motion: PlantMotion, inputs: PlantInputs) -> FmuState:
        """The FMU begun anew with as much of that pose and velocity as its [start] takes."""
        (north, east, yaw), (u, v, r) = motion
        given = dict(zip(PLANE, (north, east, yaw, u, v, r), strict=True))
        values = {
            to.variable: to.factor * given[name] + to.offset for name, to in self._start.items()
        }
        self.instance.begin({**self.table.parameters, **values})
        own = self._read()
        placed = all(name in self._start for name in PLANE[:3])
        turn = 0.0 if placed else yaw - own[2]
        moved = to_world(own[0], own[1], turn)
        place = (0.0, 0.0, 0.0) if placed else (north - moved[0], east - moved[1], turn)
        return self._moment(0.0, own, (0.0,) * len(own), place)

    def motion(self, state: FmuState) -> PlantMotion:
        """Pose and velocity of a moment."""
        north, east = to_world(state.values[0], state.values[1], state.place[2])
        pose = Pose(state.place[0] + north, state.place[1] + east, state.values[2] + state.place[2])
        return PlantMotion(pose, Velocity(*state.values[3:6]))

    def acceleration(self, state: FmuState, tau: Wrench, inputs: PlantInputs) -> Velocity:
        """ν̇ over the last step."""
        return Velocity(*state.rates[3:6])

    def step(self, state: FmuState, tau: Wrench, inputs: PlantInputs, dt: float) -> FmuState:
        """The moment dt [s] later; ValueError for a moment that cannot be gone back to."""
        if state.number != self.instance.moment:
            if state.snapshot is None:
                raise ValueError(f"{self.name} cannot go back: its FMU does not save its state")
            self.instance.restore(state.snapshot)
        self.instance.set(self._given(tau, inputs, state.place[2]))
        count = max(ceil(dt / self.table.step - 1e-9), 1)
        for k in range(count):
            self.instance.advance(state.time + k * dt / count, dt / count)
        after = self._read()
        if not all(map(isfinite, after)):
            raise ArithmeticError(f"{self.name} gave no number {state.time + dt:.2f} s after start")
        rates = tuple((b - a) / dt for a, b in zip(state.values, after, strict=True))
        return self._moment(state.time + dt, after, rates, state.place)

    def _given(self, tau: Wrench, inputs: PlantInputs, turn: float) -> dict[str, float]:
        """Values of the FMU's inputs; what was not measured is 0."""
        c, s = cos(turn), sin(turn)
        north, east = inputs.wind_north, inputs.wind_east
        ours = {
            "X": tau.X, "Y": tau.Y, "N": tau.N, "voltage": inputs.voltage,
            "wind_north": c * north + s * east, "wind_east": c * east - s * north,
        }  # fmt: skip
        return {
            to.variable: to.factor * (ours[name] if isfinite(ours[name]) else 0.0) + to.offset
            for name, to in self._inputs.items()
        }

    def _read(self) -> tuple[float, ...]:
        """Outputs in the order of PLANE, then AFLOAT; NaN for those that are not mapped."""
        names = [name for name in (*PLANE, *AFLOAT) if name in self._outputs]
        values = self.instance.get([self._outputs[name].variable for name in names])
        ours = {
            name: self._outputs[name].factor * value + self._outputs[name].offset
            for name, value in zip(names, values, strict=True)
        }
        return tuple(ours.get(name, nan) for name in self._read_names())

    def _read_names(self) -> tuple[str, ...]:
        return PLANE

    def _moment(
        self, time: float, values: tuple[float, ...], rates: tuple[float, ...],
        place: tuple[float, float, float],
    ) -> FmuState:  # fmt: skip
        self._moments += 1
        self.instance.moment = self._moments
        return FmuState(self._moments, time, values, rates, place, self.instance.snapshot())


class FloatingFmu(FmuPlant):
    """An FMU that also tells heave, roll and pitch with their rates."""

    def afloat(self, state: FmuState, tau: Wrench, inputs: PlantInputs) -> Afloat:
        """Heave, roll and pitch; accelerations over the last step."""
        down, roll, pitch, *rates = state.values[6:12]
        return Afloat._make((down, roll, pitch, *rates, *state.rates[9:12], 0.0))

    def _read_names(self) -> tuple[str, ...]:
        return (*PLANE, *AFLOAT)
