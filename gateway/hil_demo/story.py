"""`shadow hil-demo`: a boat in the loop is identified, spoiled, diagnosed, played again.

    excite → identify → hide an effect in the plant → drive again → diagnose → add → does the error
    fall? → the better vessel is the plant of the next run

The boat is a vessel file that the steps never read: they begin with a first guess of it. Every
sentence about a result is made of its numbers.

A sentence says what its numbers say.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from gateway.errors import BadInput
from gateway.files import pictures_there, write_whole
from gateway.hil_demo import Autopilot, MissionTask, PlanTask, Run, Task
from gateway.offline.add import add_effects
from gateway.offline.beside_loop import beside_loop, draw_missions
from gateway.offline.compare import compare_logs
from gateway.offline.diagnose import DiagnosisResult, diagnose_logs, save_diagnosis
from gateway.offline.identify import identify_logs
from gateway.offline.plan import PlanOptions, make_plan
from gateway.terminal import SafeConsole, status_line
from gateway.terminal.comparison import mission_sentences
from gateway.terminal.diagnosis import show_diagnosis
from gateway.terminal.identification import show_identification
from gateway.vessel_file import dump_vessel
from sim.comparison.compare import ADEQUATE_FLOORS, Comparison
from sim.excitation import Plan
from sim.excitation.responses import THROTTLE, step_responses
from sim.hil.day import Day
from sim.identification.intervals import Estimate
from sim.model import Model
from sim.vessel import AddedEffect, Vessel


def intervals_sentence(estimates: Sequence[Estimate], true: Mapping[str, float]) -> str:
    """How many intervals hold the number that the boat in the loop really has."""
    known = [e for e in estimates if e.name in true]
    holding = [e.name for e in known if e.ci95[0] <= true[e.name] <= e.ci95[1]]
    missing = [e.name for e in known if e.name not in holding]
    text = f"{len(holding)} of {len(known)} intervals hold the number that the boat really has"
    return f"{text}; not that of {', '.join(missing)}" if missing else text


def error_sentence(what: str, before: Comparison, after: Comparison) -> str:
    """Two errors on one recording, and whether the second is lower, and at the floor."""
    numbers = f"{before.nrmse:.3f} → {after.nrmse:.3f}"
    if after.nrmse < before.nrmse:
        verdict = f"the error of {what} falls"
    elif after.nrmse > before.nrmse:
        verdict = f"the error of {what} does not fall, it rises"
    else:
        verdict = f"the error of {what} stays as it is"
    floor = after.noise_floor_nrmse
    at_floor = after.nrmse <= ADEQUATE_FLOORS * floor
    rest = "no more than noise" if at_floor else "more than noise"
    return f"{verdict}: {numbers}, which is {rest} (noise alone may show {floor:.3f})"


def effect_text(added: AddedEffect) -> str:
    """`NAME (PARAMETER 0.8, …)`, without what a file need not say."""
    usual = {p.name: p.default for p in added.effect.parameters}
    told = ((name, value) for name, value in added.values.items() if value != usual[name])
    numbers = ", ".join(f"{name} {value:.3g}" for name, value in told)
    return f"{added.effect.name} ({numbers})"


def named_sentence(hidden: Sequence[AddedEffect], found: Sequence[AddedEffect]) -> str:
    """What a diagnosis has named, held against what was hidden."""
    was, named = {a.effect.name for a in hidden}, {a.effect.name for a in found}
    said = " and ".join(map(effect_text, found))
    truth = " and ".join(map(effect_text, hidden))
    if not named:
        return f"it names nothing; hidden was {truth}"
    if named == was:
        return f"it names {said}: that is what was hidden, {truth}"
    if was <= named:
        return f"it names {said}: what was hidden, {truth}, and more that was not"
    if named & was:
        return f"it names {said}: a part of what was hidden, {truth}"
    return f"it names {said}: that is not what was hidden, {truth}"


# How far the first guess is off, chosen: as one who has weighed the boat and guessed the rest.
GUESS = {
    "m11": 1.3, "m22": 0.75, "m33": 1.4, "X_u": 0.7, "X_uu": 1.0, "Y_v": 1.5, "Y_vv": 0.7,
    "N_r": 1.4, "N_rr": 0.7,
}  # fmt: skip
LENGTHS = ((15, 0), (15, 10), (0, 10), (0, 20), (15, 20), (8, 10), (0, 0))  # of the boat: mission
PLAN_S = 330.0  # of the manoeuvre "mixed": all of its parts but the random one
RADIUS_M = 250.0  # nothing is there to run into, so a plan need not be weakened
FOLDERS = ("1-excite", "2-mission", "3-excite", "4-mission", "5-mission")
FILES = ("guess.toml", "identified.toml", "better.toml", "diagnosis.json")
PICTURES = ("ladder", "ranking", "timeline", "evidence", FOLDERS[3])


@dataclass(frozen=True)
class DemoOptions:
    """The boat, what is hidden in it, where everything goes."""

    boat: Vessel
    hidden: tuple[AddedEffect, ...]
    out: Path
    seed: int = 0

    def file(self, name: str) -> Path:
        """A file of the demo."""
        return self.out / name


def hil_demo_files(out: Path) -> list[Path]:
    """What the demo writes into its folder under names that are known before."""
    logs = [out / name / f"{name}{kind}" for name in FOLDERS for kind in (".tlog", ".BIN")]
    drawn = pictures_there(out / "diagnosis", PICTURES)
    return [*(out / name for name in FILES), *logs, *drawn]


def hidden_effects(day: Day) -> tuple[AddedEffect, ...]:
    """What a day hides; BadInput where it hides nothing."""
    if not day.effects:
        raise BadInput(
            "the day has no [[effects]], and what its moments bring comes too late to be learnt: "
            "the demo needs one"
        )
    return day.effects


def first_guess(boat: Vessel) -> Vessel:
    """The boat with the numbers that someone would guess who has not measured it."""
    d = boat.dynamics
    guessed = {name: factor * getattr(d, name) for name, factor in GUESS.items()}
    return replace(boat, dynamics=replace(d, **guessed))


def run_hil_demo(options: DemoOptions, autopilot: Autopilot) -> None:
    """All steps; each prints what it does, what came of it, and where the files are."""
    Story(options, autopilot, SafeConsole(highlight=False)).tell()


class Story:
    """The steps in order, and what they share."""

    def __init__(self, options: DemoOptions, autopilot: Autopilot, console: Console) -> None:
        self._o, self._autopilot, self._console = options, autopilot, console
        self._guess = first_guess(options.boat)

    def tell(self) -> None:
        """The whole story; it ends early where a diagnosis names nothing."""
        o, hidden = self._o, " and ".join(map(effect_text, self._o.hidden))
        write_whole(o.file("guess.toml"), dump_vessel(self._guess).encode(), "the guess")
        self._say(f"{o.boat.name} in the loop, steered by {self._autopilot.name}; out: {o.out}")
        self._head("1. Excite", "the boat's plan, and a mission, in calm water")
        excited = self._sail(0, PlanTask(self._plan(self._guess, 0)), ())
        mission = self._mission()
        calm = self._sail(1, mission, ())
        self._head("2. Identify", "from a first guess, by the log of the plan alone")
        self._identify(excited, calm)
        self._head("3. Hide", f"{hidden}, in the plant alone; the autopilot drives again")
        better_plan = self._plan(self._guess, 1)
        spoiled = self._sail(2, PlanTask(better_plan), o.hidden)
        judge = self._sail(3, mission, o.hidden)
        self._head("4. Diagnose", "every effect of the catalogue is tried on the log of that plan")
        found = self._diagnose(spoiled)
        if not found.diagnosis.effects:
            return
        names = found.diagnosis.effects
        self._head("5. Add", f"shadow add {' '.join(names)}; judged by a mission that it never saw")
        better = self._add(names)
        self._compare("the free predictions", judge, "identified.toml", "better.toml")
        self._head("6. The better vessel is the plant", "the same mission, in its own loop")
        self._replay(mission, judge, better)

    def _plan(self, vessel: Vessel, seed: int) -> Plan:
        return make_plan(
            vessel, PlanOptions("mixed", PLAN_S, radius_m=RADIUS_M, seed=seed), None
        ).plan

    def _mission(self) -> MissionTask:
        surge, _ = step_responses(Model.of(self._guess))
        length = self._o.boat.hull.length
        waypoints = tuple((length * north, length * east) for north, east in LENGTHS)
        return MissionTask(waypoints, THROTTLE, round(surge.after, 2), max(length, 2.0))

    def _sail(
        self, number: int, task: Task, hidden: Sequence[AddedEffect], boat: Vessel | None = None
    ) -> Run:
        o, name = self._o, FOLDERS[number]
        day = Day(effects=tuple(hidden))
        with status_line(f"in the loop: {name}"):
            run = self._autopilot.sail(task, boat or o.boat, day, o.file(name), o.seed + number)
        pace = run.seconds / run.wall_s
        self._say(f"{name}: {run.seconds:.0f} s sailed, {pace:.0f} × real time → {run.log}")
        for remark in run.remarks:
            self._say(f"{name}: {remark}")
        return run

    def _identify(self, excited: Run, calm: Run) -> None:
        with status_line("identifying") as progress:
            found = identify_logs(
                [excited.log], self._o.file("guess.toml"), self._o.file("identified.toml"),
                progress=progress,
            )  # fmt: skip
        show_identification(found, self._o.file("identified.toml"))
        true = {name: float(getattr(self._o.boat.dynamics, name)) for name in GUESS}
        self._say(intervals_sentence(found.estimates, true))
        self._compare("a mission that it never saw", calm, "guess.toml", "identified.toml")

    def _compare(self, what: str, run: Run, *vessels: str) -> tuple[Comparison, Comparison]:
        with status_line("comparing") as progress:
            before, after = compare_logs(
                [run.log], [self._o.file(name) for name in vessels], progress=progress
            )[:2]
        self._say(error_sentence(what, before, after))
        return before, after

    def _diagnose(self, run: Run) -> DiagnosisResult:
        saved, pictures = self._o.file("diagnosis.json"), self._o.file("diagnosis")
        with status_line("diagnosing") as progress:
            found = diagnose_logs([run.log], self._o.file("identified.toml"), progress=progress)
            save_diagnosis(found, save=saved, pictures=pictures, progress=progress)
        show_diagnosis(found, saved, None, pictures)
        last = found.diagnosis.ladder[-1]
        added = [a for a in last.vessel.effects if a.effect.name in last.effects]
        self._say(named_sentence(self._o.hidden, added))
        return found

    def _add(self, names: Sequence[str]) -> Vessel:
        better = self._o.file("better.toml")
        done = add_effects(
            names, self._o.file("identified.toml"), self._o.file("diagnosis.json"), better
        )
        self._say(f"written: {better}")
        return done.vessel

    def _replay(self, mission: MissionTask, judge: Run, better: Vessel) -> None:
        again = self._sail(4, mission, (), better)
        beside = beside_loop(judge.log, again.recording, better)
        draw_missions(beside, self._o.file("diagnosis"))
        self._say(f"shadow compare {judge.log} --with-hil {again.recording}:")
        for sentence in mission_sentences(beside.missions):
            self._say(sentence)

    def _head(self, title: str, text: str) -> None:
        self._console.print(f"\n[bold]{title}[/bold]: {escape(text)}", soft_wrap=True)

    def _say(self, text: str) -> None:
        self._console.print(f"• {text}", markup=False, soft_wrap=True)
