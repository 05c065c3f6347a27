"""What a plan is: sticks on a grid, what the autopilot gets of them, what the vessel does then.

Which manoeuvre a recording asks for: by what it leaves open of the vessel.

`shadow plan`: a manoeuvre for a vessel, tried on its model, written for the real boat.
"""

from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from gateway.errors import BadInput
from gateway.figures.excitation import plan_motion, plan_track
from gateway.figures.matplotlib_draw import save_figure
from gateway.offline.diagnose import answered
from gateway.offline.plan_export import (
    Safety,
    pulse_bounds,
    safety_for,
    write_commands,
    write_pulses,
    write_script,
)
from gateway.user_effects import known_effects
from sim.diagnosis.diagnose import DiagnoseSettings
from sim.diagnosis.next_experiment import Suggested
from sim.excitation.catalogue import BY_NAME
from sim.excitation.manoeuvre import Limits, Manoeuvre
from sim.excitation.plan import Plan, plan_of
from sim.excitation.step_response import StepResponses, step_responses
from sim.model import Model
from sim.vessel import Vessel


@dataclass(frozen=True)
class Asked:
    """Manoeuvres by the information expected per second, and what it is expected of."""

    of: str
    ranked: tuple[Suggested, ...]

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        rows = [
            {"excitation": s.manoeuvre.name, "seconds": s.seconds, "nats": s.nats}
            for s in self.ranked
        ]
        return {"of": self.of, "ranked": rows}


def asked_by(log: str | Path, vessel: Vessel) -> Asked:
    """Diagnose the recording, then ask which manoeuvre would tell most of what stays open."""
    _, found = answered([log], vessel, DiagnoseSettings(plan=True, effects=known_effects()))
    tied = next((c for c in found.ranking if c.confounded_with), None)
    if tied is None:
        of = "the numbers of the vessel" + (
            f" with {', '.join(found.effects)}" if found.effects else ""
        )
    else:
        of = f"{tied.effect} against {' and '.join(tied.confounded_with)}"
    return Asked(of, found.suggested)


DEFAULT = "mixed"
ROOM = 0.8  # of the radius: wind and current want the rest
WEAKER, WEAKEST = 0.9, 0.6  # of the throttle that was asked for: less tells too little
SHORTEST_S, LONGEST_S = 5.0, 3600.0


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
class Planned:
    """A plan, its bounds, how the vessel answers to steps, and what was written."""

    plan: Plan
    safety: Safety
    answers: StepResponses
    asked_throttle: float
    files: tuple[Path, ...]
    asked: Asked | None = None

    @property
    def stays(self) -> bool:
        """Whether the prediction keeps within the circle."""
        return self.plan.reach <= self.safety.radius_m

    @property
    def narrow(self) -> bool:
        """Whether it keeps within the circle, but with little room."""
        return self.stays and self.plan.reach > ROOM * self.safety.radius_m

    @property
    def leaves_at(self) -> float | None:
        """When the prediction leaves the circle [s]."""
        return None if self.stays else self._first_beyond(self.safety.radius_m)

    @property
    def near_until(self) -> float:
        """How long a plan that comes too far keeps well within the circle [s]."""
        return float(np.floor(self._first_beyond(ROOM * self.safety.radius_m)))

    def _first_beyond(self, distance_m: float) -> float:
        return float(self.plan.time[np.argmax(self.plan.distance > distance_m)])

    def to_dict(self) -> dict[str, Any]:
        """What `--json` prints: SI units; what does not exist is left out or null."""
        plan = self.plan
        return {
            "excitation": plan.manoeuvre.name,
            "tells": plan.manoeuvre.tells,
            "vessel": plan.vessel.name,
            "seconds": plan.seconds,
            "limits": asdict(plan.limits),
            "asked_throttle_limit": self.asked_throttle,
            "reach_m": plan.reach,
            "stays": self.stays,
            "leaves_at_s": self.leaves_at,
            "highest_speed_mps": float(plan.speed.max()),
            "safety": asdict(self.safety),
            "pulses_us": {str(c): list(ends) for c, ends in pulse_bounds(plan).items()},
            "step_responses": self.answers.to_dict(),
            "files": [str(file) for file in self.files],
            "asked": None if self.asked is None else self.asked.to_dict(),
        }


def make_plan(
    vessel: Vessel, options: PlanOptions, out: Path | None, log: Path | None = None
) -> Planned:
    """Choose, try on the model, weaken until it keeps within the radius, write."""
    manoeuvre, asked = chosen(vessel, options.excitation, log)
    model = Model.of(vessel)
    plan = _within(model, manoeuvre, options)
    safety = safety_for(plan, options.radius_m, options.highest_speed_mps, options.lowest_voltage_v)
    files = _write(plan, safety, out) if out is not None else ()
    return Planned(plan, safety, step_responses(model), options.throttle_limit, files, asked)


def chosen(vessel: Vessel, name: str | None, log: Path | None) -> tuple[Manoeuvre, Asked | None]:
    """The manoeuvre that was named; else the one that a recording asks for, else the default."""
    if name is not None and name not in BY_NAME:
        raise BadInput(f"--excitation {name}: there are {', '.join(BY_NAME)}")
    if name is not None or log is None:
        return BY_NAME[name or DEFAULT], None
    asked = asked_by(log, vessel)
    return asked.ranked[0].manoeuvre, asked


def _within(model: Model, manoeuvre: Manoeuvre, options: PlanOptions) -> Plan:
    """As much throttle as keeps clear of the circle; where none does, what was asked for."""
    limits, tried = Limits(throttle=options.throttle_limit), list[Plan]()
    while limits.throttle >= WEAKEST * options.throttle_limit:
        tried.append(plan_of(manoeuvre, model, limits, options.seed, options.seconds))
        if not np.isfinite(tried[-1].reach):
            raise BadInput(
                f"{model.vessel.name}: its predicted motion leaves all bounds: "
                "check the signs of its damping and its effects"
            )
        if tried[-1].reach <= ROOM * options.radius_m:
            return tried[-1]
        limits = replace(limits, throttle=WEAKER * limits.throttle)
    return tried[0]


def _write(plan: Plan, safety: Safety, out: Path) -> tuple[Path, ...]:
    name = plan.manoeuvre.name
    return (
        write_script(plan, safety, version("shadow-gateway"), out / f"{name}.lua"),
        write_pulses(plan, out / f"{name}.csv"),
        write_commands(plan, out / f"{name}-commands.csv"),
        save_figure(plan_motion(plan), out / f"{name}-motion.png"),
        save_figure(plan_track(plan, safety.radius_m), out / f"{name}-track.png"),
    )
