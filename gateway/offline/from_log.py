"""A vessel from a log alone: begun from what the log says, learnt on its first part.

begin (parameters, else assumed outputs) → split the time → identify → diagnose

Nothing is asked for: what the log does not say is assumed, and every assumption is a sentence.
Where no parameters say which output drives what, it is assumed, then checked: the two outputs that
move most are the port and the starboard motor, or steering and throttle as ArduPilot has them by
default; which it is, and which way round, is what the boat's own turns and speeds follow best. A
single output that moves is a motor.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from gateway.errors import BadInput, printable
from gateway.ingest.log import choose_floating
from gateway.ingest.mapping import (
    LIMITS_US,
    THRUST_FUNCTIONS,
    Actuator,
    OutputFunction,
    actuators,
)
from gateway.ingest.open import open_log
from gateway.ingest.px4_outputs import named_only, named_outputs
from gateway.offline.diagnose import (
    DIAGNOSIS_TRIALS,
    DiagnosisResult,
    diagnosed_trials,
)
from gateway.offline.identify import identify_trials
from gateway.offline.notices import notices_of
from gateway.offline.trials import TrialOptions, usable_trials
from gateway.offline.usable_time import TimeSpan, limit_to_span
from gateway.offline.vessel import ASTERN, BoatSize, check_size, first_vessel
from gateway.user_effects import known_effects
from gateway.vessel_file import load_vessel, name_after
from sim.diagnosis.diagnose import DiagnoseSettings
from sim.diagnosis.thresholds import GUESSED_PRIOR
from sim.effects.effect import Effect
from sim.identification.intervals import Estimate
from sim.identification.wiring import CommandResponse, command_response
from sim.state import Floats, Nu, Progress
from sim.trial import Trial
from sim.vessel import Vessel

# Standard deviation of an output that is not merely held, gentle as its pilot may be: the two that
# change most are the motors. An alarm that one is unknown takes more, `notices.MOVES_US`. Chosen.
CHANGES_US = 5.0
USUAL_US = tuple(pulse for _, pulse in LIMITS_US)  # lowest, neutral, highest


def assumed_actuators(trial: Trial) -> tuple[list[Actuator], str]:
    """Outputs of a trial that move the boat, and the sentence that says what was assumed."""
    spread = np.nan_to_num(np.nanstd(trial.pwm[trial.usable], axis=0))
    moving = [i for i in np.argsort(-spread, kind="stable") if spread[i] > CHANGES_US][:2]
    if not moving:
        raise BadInput(f"{trial.name}: no output ever changes: nothing can be learnt from that")
    outputs = [_output(trial, i) for i in sorted(moving)]
    if len(outputs) == 1:
        (one,) = outputs
        return [one], f"output {one.channel} is taken for the motor"
    first, second = outputs
    pulses = [_share(trial, i) for i in sorted(moving)]
    turn_apart = _followed(trial, pulses[0] - pulses[1], Nu.R)
    turn_alone = _followed(trial, pulses[0], Nu.R)
    if abs(turn_alone.correlation) > abs(turn_apart.correlation):
        return _steered(trial, first, second, pulses, turn_alone)
    return _apart(trial, first, second, pulses, turn_apart)


def _apart(
    trial: Trial, first: Actuator, second: Actuator, pulses: Sequence[Floats], turn: CommandResponse
) -> tuple[list[Actuator], str]:
    """Two motors side by side: their difference turns the boat, their sum drives it."""
    ahead = _followed(trial, pulses[0] + pulses[1], Nu.U)
    backwards = ahead.correlation < 0.0
    swapped = (turn.correlation < 0.0) != backwards
    left, right = (second, first) if swapped else (first, second)
    text = (
        f"output {left.channel} is taken for the port motor and output {right.channel} for the "
        f"starboard motor{', both reversed' if backwards else ''}, from how the boat turns"
    )
    return [
        replace(left, kind=OutputFunction.THROTTLE_LEFT, reversed=backwards),
        replace(right, kind=OutputFunction.THROTTLE_RIGHT, reversed=backwards),
    ], text


def _steered(
    trial: Trial, first: Actuator, second: Actuator, pulses: Sequence[Floats], turn: CommandResponse
) -> tuple[list[Actuator], str]:
    """Steering on the first of the two outputs, throttle on the second."""
    backwards = _followed(trial, pulses[1], Nu.U).correlation < 0.0
    text = (
        f"output {first.channel} is taken for the steering and output {second.channel} for the "
        "motor, from how the boat turns"
    )
    steering = replace(first, kind=OutputFunction.STEERING, reversed=turn.correlation < 0.0)
    return [steering, replace(second, reversed=backwards)], text


def _output(trial: Trial, i: int) -> Actuator:
    """A motor of the usual pulses, wider where the log's are."""
    low, neutral, high = USUAL_US
    pwm = trial.pwm[trial.usable, i]
    limits = (min(low, float(np.nanmin(pwm))), neutral, max(high, float(np.nanmax(pwm))))
    return Actuator(trial.channels[i], 70, OutputFunction.THROTTLE, limits, False)


def _share(trial: Trial, i: int) -> Floats:
    """Pulses as shares of full (T,), neutral where there are none."""
    low, neutral, high = USUAL_US
    return np.nan_to_num((trial.pwm[:, i] - neutral) / (high - low) * 2.0)


def _followed(trial: Trial, command: Floats, axis: Nu) -> CommandResponse:
    """How clearly a motion follows a command; nothing where neither was excited."""
    found = command_response(command, trial.nu[:, axis], trial.usable, trial.dt, axis)
    return found or CommandResponse(0.0, 0.0)


# Chosen, not measured:
LEARN_SHARE = 0.6  # of the usable time, from its beginning
SHORTEST_LEARN_S, SHORTEST_JUDGE_S = 60.0, 30.0
TOP_SPEED_SHARE = 0.99  # quantile of the speeds that is taken for the top speed
UNITS = {"length": "m", "beam": "m", "mass": "kg", "thrust": "N", "top_speed": "m/s"}
WORDS = {"thrust": "full thrust of each motor", "top_speed": "top speed"}


@dataclass(frozen=True)
class TimeSplit:
    """The longest trial of a log, cut in two; one and the same where it is too short for that.

    cut     [s after its first sample]; None where it was not cut
    """

    learn: Trial
    judge: Trial
    cut: float | None

    @property
    def sentence(self) -> str:
        """What was learnt from and what it is judged on."""
        if self.cut is None:
            return (
                f"{self.learn.name} is too short to hold time back: errors are those on the "
                "time that was learnt from, and say little about another day"
            )
        seconds = [float(t.usable.sum()) * t.dt for t in (self.learn, self.judge)]
        return (
            f"learnt from the first {seconds[0]:.0f} s of {self.learn.name}, judged on the "
            f"{seconds[1]:.0f} s that came after"
        )


@dataclass(frozen=True)
class LearntVessel:
    """What came of a log alone.

    plain    its nine numbers fitted, without any effect
    answer   the diagnosis of it; None where the time is too short for one
    assumed  what had to be assumed, a sentence each
    """

    plain: Vessel
    answer: DiagnosisResult | None
    split: TimeSplit
    assumed: tuple[str, ...]

    @property
    def vessels(self) -> tuple[Vessel, ...]:
        """What is compared: the fitted vessel, and that with the effects that were found."""
        if self.answer is None or not self.answer.diagnosis.best.effects:
            return (self.plain,)
        return (self.plain, self.answer.diagnosis.vessel)


def learn_from(
    log: str | Path,
    given: Mapping[str, float],
    *,
    options: TrialOptions,
    effects: Iterable[Effect] = (),
    progress: Progress = lambda text: None,
) -> LearntVessel:
    """Begin a vessel, identify it and diagnose it on the first part of a log.

    `given`: members of `BoatSize` that the user knows; BadInput where nothing can be learnt.
    """
    check_size(given)
    split = split_time(_longest(usable_trials([log], options, progress)))
    text, assumed = begin_vessel(Path(log), given, split.learn, options)
    own = tuple(effects)
    with TemporaryDirectory() as folder:
        file = Path(folder) / f"{Path(log).stem}.toml"
        file.write_text(text, encoding="utf-8")
        boat = load_vessel(file, own)
    progress("identifying")
    found = identify_trials([split.learn], boat, names=str(log), progress=progress)
    name = f"{name_after(Path(log))} fitted"
    source = f"learnt from {printable(Path(log).name)} alone"
    plain = replace(found.vessel, name=name, source=source)
    answer = _diagnosed(Path(log), plain, split, options, own, progress)
    said = (split.sentence, *assumed, *_as_assumed(found.estimates))
    return LearntVessel(plain, answer, split, said)


def split_time(trial: Trial) -> TimeSplit:
    """Cut a trial where most of its usable time lies behind."""
    usable = np.flatnonzero(trial.usable)
    cut = float(trial.time[usable[int(LEARN_SHARE * (len(usable) - 1))]])
    learn = limit_to_span(trial, TimeSpan(None, cut))
    judge = limit_to_span(trial, TimeSpan(cut, None))
    long_enough = (
        float(learn.usable.sum()) * trial.dt >= SHORTEST_LEARN_S
        and float(judge.usable.sum()) * trial.dt >= SHORTEST_JUDGE_S
    )
    return TimeSplit(learn, judge, cut) if long_enough else TimeSplit(trial, trial, None)


def begin_vessel(
    log: Path, given: Mapping[str, float], trial: Trial, options: TrialOptions
) -> tuple[str, tuple[str, ...]]:
    """The text of a first vessel file, and what had to be assumed for it."""
    opened = open_log(log, options.mapping)
    parameters = opened.parameters(choose_floating(opened, options.system, options.anyway))
    outputs = actuators(parameters)
    if any(a.kind in THRUST_FUNCTIONS for a in outputs):
        wiring = _outputs_text(outputs)
    else:
        outputs, wiring = assumed_actuators(trial)
        named = named_only(named_outputs(parameters))
        wiring = f"{named or 'the log does not say what its outputs drive'}: {wiring}"
    top = float(np.quantile(np.abs(trial.nu[trial.usable, Nu.U]), TOP_SPEED_SHARE))
    size = {"top_speed": max(round(top, 2), 0.1), **given}
    text = first_vessel(log, name_after(log), outputs, size)
    return text, (*_size_texts(given, size["top_speed"]), wiring)


def _as_assumed(estimates: Sequence[Estimate]) -> list[str]:
    """Numbers that the log does not tell, in a sentence."""
    names = [e.name for e in estimates if not e.identifiable]
    if not names:
        return []
    return [f"the log does not tell {', '.join(names)}: they are as assumed, from the boat's size"]


def _outputs_text(outputs: Sequence[Actuator]) -> str:
    said = ", ".join(f"{a.kind} on output {a.channel}" for a in outputs)
    return f"from the log's parameters: {said}"


def _size_texts(given: Mapping[str, float], top: float) -> list[str]:
    """What was taken for the boat's size: from the log, or because nobody said it."""
    assumed = {
        name: value for name, value in vars(BoatSize()).items()
        if name not in given and name != "top_speed"
    }  # fmt: skip
    out = [] if "top_speed" in given else [f"top speed {top:g} m/s, the fastest in the log"]
    if assumed:
        numbers = ", ".join(
            f"{WORDS.get(name, name)} {value:g} {UNITS[name]}" for name, value in assumed.items()
        )
        flags = " ".join(f"--{name}" for name in assumed)
        out.append(f"assumed, because no log says it: {numbers} (give {flags})")
    out.append(
        f"astern the motors are taken to push {100.0 * ASTERN:.0f} % of what they push ahead"
    )
    if {"mass", "thrust"} & set(assumed):
        out.append(
            "forces, masses and damping are right in proportion to one another only: motion is the "
            "same for a boat of twice the mass with twice the thrust"
        )
    return out


def _longest(trials: Sequence[Trial]) -> Trial:
    return max(trials, key=lambda trial: int(trial.usable.sum()))


def _diagnosed(
    log: Path, plain: Vessel, split: TimeSplit, options: TrialOptions, effects: tuple[Effect, ...],
    progress: Progress,
) -> DiagnosisResult | None:  # fmt: skip
    """The diagnosis on the same first part, on its coarser grid; None where that is too short."""
    coarse = replace(options, rate_hz=DIAGNOSIS_TRIALS.rate_hz)
    trial = _longest(usable_trials([log], coarse, progress))
    learn = trial if split.cut is None else limit_to_span(trial, TimeSpan(None, split.cut))
    settings = DiagnoseSettings(effects=(*known_effects(), *effects), prior=GUESSED_PRIOR)
    try:
        diagnosis = diagnosed_trials([learn], plain, settings, str(log), progress)
    except BadInput as error:
        progress(f"no diagnosis: {error}")
        return None
    notices = notices_of([learn], plain)
    return DiagnosisResult(diagnosis, plain, (learn,), (str(log),), f"{log.stem}.toml", notices)
