"""`shadow plan`: a manoeuvre for a vessel, tried on its model, written for the real boat.

Without a name the manoeuvre is chosen by what a diagnosis of a recording leaves open.

Written are a Lua script for ArduPilot Rover (boats too) and tables of pulses and commands. The
script ends a run at the safety limits, and sends no pulse outside the bounds of the plan. A boat
whose recording says that another autopilot steers her gets none, and is told so.
"""

import csv
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from importlib.metadata import version
from io import StringIO
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from gateway.errors import BadInput
from gateway.figures.matplotlib_draw import save_figure
from gateway.figures.motion import plan_motion, plan_track
from gateway.files import write_whole
from gateway.ingest.log import choose_floating
from gateway.ingest.open import open_log
from gateway.offline.diagnose import DIAGNOSIS_TRIALS, diagnose_trials
from gateway.offline.trials import TrialOptions
from gateway.user_effects import known_effects
from sim.diagnosis.diagnose import DiagnoseSettings
from sim.diagnosis.next_experiment import SuggestedManoeuvre
from sim.excitation import Manoeuvre, Plan, StickLimits, plan_of
from sim.excitation.catalogue import BY_NAME
from sim.excitation.responses import StepResponses, step_responses
from sim.model import Model
from sim.near_names import did_you_mean
from sim.vessel import Vessel

TEMPLATE = Path(__file__).with_name("script.lua")
MILLI = 1000.0
CORNERS_PER_LINE = 5
# All chosen, not measured.
SPEED_MARGIN = 1.3  # of the speed limit over the fastest predicted
LEAST_SPEED_LIMIT_MPS = 1.0
PULSE_MARGIN_US = 25  # beyond the pulses of the plan
TIME_MARGIN_S = 5.0  # how much longer than planned a run may take


@dataclass(frozen=True)
class SafetyLimits:
    """What ends a run; `lowest_voltage_v` None: the autopilot's own BATT_LOW_VOLT."""

    radius_m: float
    highest_speed_mps: float
    time_out_s: float
    lowest_voltage_v: float | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None and not 0.0 < value < np.inf:
                raise ValueError(f"{field.name} = {value}: expected a number above 0")


def safety_for(
    plan: Plan, radius_m: float, speed_mps: float | None, voltage_v: float | None
) -> SafetyLimits:
    """The bounds for a plan: what was asked for, else a margin over what is predicted."""
    expected = max(SPEED_MARGIN * float(plan.speed.max()), LEAST_SPEED_LIMIT_MPS)
    speed = round(expected, 2) if speed_mps is None else speed_mps
    return SafetyLimits(radius_m, speed, plan.seconds + TIME_MARGIN_S, voltage_v)


def pulse_bounds(plan: Plan) -> dict[int, tuple[int, int]]:
    """Channel -> lowest and highest pulse [µs] of the plan, neutral included, with some margin."""
    channels, pulses = plan.vessel.pulses(plan.commands)
    servos = [actuator.servo for actuator in plan.vessel.actuators]
    travel = {s.channel: (round(s.pwm[0]), round(s.pwm[2])) for s in servos}
    return {
        channel: (
            max(round(float(pulses[:, k].min())) - PULSE_MARGIN_US, travel[channel][0]),
            min(round(float(pulses[:, k].max())) + PULSE_MARGIN_US, travel[channel][1]),
        )
        for k, channel in enumerate(channels)
    }


def script_text(plan: Plan, safety: SafetyLimits, version: str) -> str:
    """The whole script."""
    bounds = pulse_bounds(plan)
    return Template(TEMPLATE.read_text(encoding="utf-8")).substitute(
        name=plan.manoeuvre.name,
        vessel=" ".join(plan.vessel.name.split()),
        version=version,
        seconds=f"{plan.seconds:.1f}",
        reach=f"{plan.reach:.0f}",
        radius=f"{safety.radius_m:.1f}",
        speed=f"{safety.highest_speed_mps:.2f}",
        time_out=f"{safety.time_out_s:.1f}",
        voltage=f"{safety.lowest_voltage_v or 0.0:.2f}",
        throttle=f"{plan.limits.throttle:.3f}",
        steer=f"{plan.limits.steer:.3f}",
        throttle_rate=f"{plan.limits.throttle_rate:.3f}",
        steer_rate=f"{plan.limits.steer_rate:.3f}",
        pulses=", ".join(f"{{{c}, {low}, {high}}}" for c, (low, high) in bounds.items()),
        rows=_rows(plan),
    )


def write_script(plan: Plan, safety: SafetyLimits, version: str, file: Path) -> Path:
    """The script as a file."""
    text = script_text(plan, safety, version)
    write_whole(file, text.encode(), "the script")
    return file


def _rows(plan: Plan) -> str:
    """Corners as whole numbers: ms, throttle and steer in thousandths, a few to a line."""
    table = np.column_stack([MILLI * plan.corner_time, MILLI * plan.corner_sticks])
    triples = [f"{t}, {a}, {b}" for t, a, b in np.rint(table).astype(int).tolist()]
    lines = [triples[k : k + CORNERS_PER_LINE] for k in range(0, len(triples), CORNERS_PER_LINE)]
    return "\n".join("  " + ", ".join(line) + "," for line in lines)


def write_pulses(plan: Plan, file: Path) -> Path:
    """time [s], throttle, steer (−1 … 1), pwm_N [µs] of each channel: each row holds."""
    channels, pulses = plan.vessel.pulses(plan.commands)
    header = ["time", "throttle", "steer", *(f"pwm_{channel}" for channel in channels)]
    rows = (
        [f"{t:.1f}", *(f"{s:.3f}" for s in sticks), *(f"{p:.0f}" for p in row)]
        for t, sticks, row in zip(plan.time, plan.sticks, pulses, strict=True)
    )
    return _write_table(file, header, rows)


def write_commands(plan: Plan, file: Path) -> Path:
    """time [s] and one column per actuator by its name (−1 … 1): what `shadow simulate` reads."""
    header = ["time", *(actuator.name for actuator in plan.vessel.actuators)]
    rows = (
        [f"{t:.1f}", *(f"{command:.4f}" for command in row)]
        for t, row in zip(plan.time, plan.commands, strict=True)
    )
    return _write_table(file, header, rows)


def _write_table(file: Path, header: Sequence[str], rows: Iterable[Sequence[str]]) -> Path:
    table = StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    write_whole(file, table.getvalue().encode(), "the table")
    return file


DEFAULT = "mixed"
SHORTEST_S, LONGEST_S = 5.0, 3600.0  # of a plan
# All chosen, not measured.
CLEAR = 0.8  # share of the radius that a plan may use: wind and current need the rest
THROTTLE_STEP = 0.9  # the throttle is lowered by this factor until the plan keeps clear …
LEAST_THROTTLE = 0.6  # … down to this share of what was asked for: less excites too little


@dataclass(frozen=True)
class ManoeuvreRanking:
    """Manoeuvres by the information expected per second, and what it is expected of."""

    of: str
    ranked: tuple[SuggestedManoeuvre, ...]

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        rows = [
            {"excitation": s.manoeuvre.name, "seconds": s.seconds, "nats": s.nats}
            for s in self.ranked
        ]
        return {"of": self.of, "ranked": rows}


@dataclass(frozen=True)
class PlanOptions:
    """What a user asks for; None: a margin over the prediction, or the autopilot's own."""

    excitation: str | None = None
    seconds: float | None = None
    throttle_limit: float = 0.7
    radius_m: float = 100.0
    highest_speed_mps: float | None = None
    lowest_voltage_v: float | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if self.seconds is not None and not SHORTEST_S <= self.seconds <= LONGEST_S:
            raise BadInput(
                f"--seconds {self.seconds:g}: expected {SHORTEST_S:g} to {LONGEST_S:g} s"
            )
        if not 0.0 < self.throttle_limit <= 1.0:
            raise BadInput(f"--throttle-limit {self.throttle_limit:g}: expected above 0, at most 1")
        for name, value in (
            ("radius", self.radius_m),
            ("speed-limit", self.highest_speed_mps),
            ("lowest-voltage", self.lowest_voltage_v),
        ):
            if value is not None and not 0.0 < value < np.inf:
                raise BadInput(f"--{name} {value:g}: expected a number above 0")


@dataclass(frozen=True)
class PlanResult:
    """A plan, its bounds, how the vessel answers to steps, and what was written.

    unscripted  why there is no script; empty where there is one
    """

    plan: Plan
    safety: SafetyLimits
    step_responses: StepResponses
    requested_throttle: float
    files: tuple[Path, ...]
    ranking: ManoeuvreRanking | None = None
    unscripted: str = ""

    @property
    def within_radius(self) -> bool:
        """Whether the prediction keeps within the circle."""
        return self.plan.reach <= self.safety.radius_m

    @property
    def close_to_edge(self) -> bool:
        """Whether it keeps within the circle, but with little room."""
        return self.within_radius and self.plan.reach > CLEAR * self.safety.radius_m

    @property
    def leaves_at(self) -> float | None:
        """When the prediction leaves the circle [s]."""
        return None if self.within_radius else self._first_beyond(self.safety.radius_m)

    @property
    def clear_until(self) -> float:
        """How long a plan that comes too far keeps well within the circle [s]."""
        return float(np.floor(self._first_beyond(CLEAR * self.safety.radius_m)))

    def _first_beyond(self, distance_m: float) -> float:
        return float(self.plan.time[np.argmax(self.plan.distance > distance_m)])

    def to_dict(self) -> dict[str, Any]:
        """What `--json` prints: SI units; what does not exist is left out or null."""
        plan = self.plan
        return {
            "excitation": plan.manoeuvre.name,
            "tells": plan.manoeuvre.reveals,
            "vessel": plan.vessel.name,
            "seconds": plan.seconds,
            "limits": asdict(plan.limits),
            "asked_throttle_limit": self.requested_throttle,
            "reach_m": plan.reach,
            "stays": self.within_radius,
            "leaves_at_s": self.leaves_at,
            "highest_speed_mps": float(plan.speed.max()),
            "safety": asdict(self.safety),
            "pulses_us": {str(c): list(ends) for c, ends in pulse_bounds(plan).items()},
            "step_responses": self.step_responses.to_dict(),
            "files": [str(file) for file in self.files],
            "asked": None if self.ranking is None else self.ranking.to_dict(),
        } | ({"notices": [self.unscripted]} if self.unscripted else {})  # fmt: skip


def make_plan(
    vessel: Vessel,
    options: PlanOptions,
    out: Path | None,
    log: Path | None = None,
    trials: TrialOptions = DIAGNOSIS_TRIALS,
) -> PlanResult:
    """Choose, try on the model, weaken until it keeps within the radius, write."""
    manoeuvre, ranking = choose_manoeuvre(vessel, options.excitation, log, trials)
    model = Model.of(vessel)
    plan = _plan_within(model, manoeuvre, options)
    safety = safety_for(plan, options.radius_m, options.highest_speed_mps, options.lowest_voltage_v)
    unscripted = "" if log is None else runs_no_script(log, trials)
    files = _write_files(plan, safety, out, not unscripted) if out is not None else ()
    throttle, steps = options.throttle_limit, step_responses(model)
    return PlanResult(plan, safety, steps, throttle, files, ranking, unscripted)


def runs_no_script(path: Path, trials: TrialOptions) -> str:
    """That the autopilot of a recording runs no Lua script of ArduPilot's; empty where it may."""
    log = open_log(path, trials.mapping)
    boat = choose_floating(log, trials.system, trials.anyway)
    if boat.autopilot in ("", "ArduPilot"):  # a table names none
        return ""
    return (
        f"{path}: {boat.autopilot} steers her, which runs no Lua script of ArduPilot's: none is "
        "written, nothing ends a run at the limits, and the pulses are in the .csv"
    )


def choose_manoeuvre(
    vessel: Vessel,
    name: str | None,
    log: Path | None,
    trials: TrialOptions = DIAGNOSIS_TRIALS,
) -> tuple[Manoeuvre, ManoeuvreRanking | None]:
    """The manoeuvre that is named; else the best one after a recording, else the default."""
    if name is not None and name not in BY_NAME:
        meant = did_you_mean(name, BY_NAME)
        raise BadInput(f"--excitation {name}: {meant}there are {', '.join(BY_NAME)}")
    if name is not None or log is None:
        return BY_NAME[name or DEFAULT], None
    ranking = rank_manoeuvres(log, vessel, trials)
    if not ranking.ranked:
        raise BadInput(
            f"{log}: as it fits {vessel.name}, the model leaves all bounds in every manoeuvre: "
            "check the signs of its damping and its effects, or name one with --excitation"
        )
    return ranking.ranked[0].manoeuvre, ranking


def rank_manoeuvres(
    log: str | Path, vessel: Vessel, trials: TrialOptions = DIAGNOSIS_TRIALS
) -> ManoeuvreRanking:
    """Diagnose a recording and rank manoeuvres by what they would add on what it leaves open."""
    settings = DiagnoseSettings(plan=True, effects=known_effects())
    _, diagnosis = diagnose_trials([log], vessel, settings, options=trials)
    tied = next((c for c in diagnosis.ranking if c.confounded_with), None)
    if tied is not None:
        of = f"{tied.effect} against {' and '.join(tied.confounded_with)}"
    else:
        effects = f" with {', '.join(diagnosis.effects)}" if diagnosis.effects else ""
        of = f"the numbers of the vessel{effects}"
    return ManoeuvreRanking(of, diagnosis.suggested)


def _plan_within(model: Model, manoeuvre: Manoeuvre, options: PlanOptions) -> Plan:
    """As much throttle as keeps clear of the circle; where none does, what was asked for."""
    limits, tried = StickLimits(throttle=options.throttle_limit), list[Plan]()
    while limits.throttle >= LEAST_THROTTLE * options.throttle_limit:
        tried.append(plan_of(manoeuvre, model, limits, options.seed, options.seconds))
        if not np.isfinite(tried[-1].reach):
            raise BadInput(
                f"{model.vessel.name}: its predicted motion leaves all bounds: "
                "check the signs of its damping and its effects"
            )
        if tried[-1].reach <= CLEAR * options.radius_m:
            return tried[-1]
        limits = replace(limits, throttle=THROTTLE_STEP * limits.throttle)
    return tried[0]


WRITTEN = ("{}.lua", "{}.csv", "{}-commands.csv", "{}-motion.png", "{}-track.png")


def plan_files(name: str | None, log: Path | None, out: Path) -> list[Path]:
    """What a plan may write: of every manoeuvre where a recording will choose."""
    names = [name or DEFAULT] if name is not None or log is None else list(BY_NAME)
    return [out / file.format(name) for name in names for file in WRITTEN]


def _write_files(plan: Plan, safety: SafetyLimits, out: Path, scripted: bool) -> tuple[Path, ...]:
    script, pulses, commands, motion, track = plan_files(plan.manoeuvre.name, None, out)
    lua = [write_script(plan, safety, version("shadow-gateway"), script)] if scripted else []
    return (
        *lua,
        write_pulses(plan, pulses),
        write_commands(plan, commands),
        save_figure(plan_motion(plan), motion),
        save_figure(plan_track(plan, safety.radius_m), track),
    )
