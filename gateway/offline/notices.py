"""The notices on recordings and on the vessel file that every result repeats.

Wiring, outputs of which the autopilot says something else than the file, what the vessel's effects
assume, then what looks odd in the recordings.
"""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from gateway.estimation.gyro_delay import assumed_texts
from gateway.ingest.log import BoatSamples
from gateway.ingest.parameter_changes import ALIKE_US, changes_text
from gateway.ingest.sources import Choice
from gateway.offline.same_voyage import same_voyage_notices
from sim.identification.at_rest import AXES_AT_REST, axes_at_rest
from sim.identification.wiring import wiring_notices, wiring_of
from sim.state import Floats
from sim.trial import Trial
from sim.vessel import Servo, Vessel

# Standard deviation of the pulses of an output that is told to move beside the known ones; chosen.
MOVES_US = 30.0
NUMBER = re.compile(r"[+-]?\d+(\.\d+)?")


def notices_of(trials: Sequence[Trial], vessel: Vessel) -> tuple[str, ...]:
    """All of them in sentences, like ones of several recordings in one.

    Notices are alike where they differ in numbers alone; the numbers shown are the first one's.
    """
    alike: dict[str, list[tuple[str, str]]] = {}
    for trial in trials:
        for notice in (*outputs_set_otherwise(trial, vessel), *outputs_change(trial)):
            # each output has its own, and each recording its own change
            alike.setdefault(notice, []).append((trial.name, notice))
        for notice in trial.notices:
            alike.setdefault(NUMBER.sub("", notice), []).append((trial.name, notice))
    wiring = wiring_notices(wiring_of(trials, vessel), vessel)
    out = [*wiring, *outputs_without_actuator(trials, vessel), *not_tested(trials)]
    out += same_voyage_notices(trials)
    out += assumed_by(vessel)
    for group in alike.values():
        names = list(dict.fromkeys(name for name, _ in group))
        listed = names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
        out.append(f"{listed}: {group[0][1]}")
    return tuple(out)


def not_tested(trials: Sequence[Trial]) -> list[str]:
    """Which motion of the model these recordings cannot judge, for the boat did not move so."""
    rest = axes_at_rest(trials)
    if len(rest) == len(AXES_AT_REST):
        return ["the boat hardly moved: these recordings say nothing of the model"]
    if "yaw" in rest:
        return ["the boat hardly turned: whether the model turns as it does is not tested; sail "
                "turns, slow ones and hard ones, either way"]  # fmt: skip
    if "surge" in rest:
        return ["the boat hardly moved ahead or astern: speeds of the model are not tested"]
    return []


def outputs_without_actuator(trials: Sequence[Trial], vessel: Vessel) -> list[str]:
    """That outputs move which the vessel file does not have: motors may be missing from it."""
    known = {actuator.servo.channel for actuator in vessel.actuators}
    moving = {
        channel
        for trial in trials
        for channel, pwm in zip(trial.channels, trial.pwm[trial.usable].T, strict=True)
        if channel not in known and spread_of(pwm) > MOVES_US
    }
    if not moving:
        return []
    names = " and ".join(map(str, sorted(moving)))
    what, verb = ("output", "moves") if len(moving) == 1 else ("outputs", "move")
    return [f"{what} {names} {verb} too, and {vessel.name} has nothing there: a motor that the "
            "file lacks, another boat's log, or a camera?"]  # fmt: skip


def spread_of(pwm: Floats) -> float:
    """Standard deviation of the pulses that there are [µs]."""
    pulses = pwm[np.isfinite(pwm)]
    return float(np.std(pulses)) if len(pulses) else 0.0


def outputs_set_otherwise(trial: Trial, vessel: Vessel) -> list[str]:
    """Pulse limits and directions of the file that are not those of the autopilot's parameters.

    Where those change in the usable time, only what the file has otherwise on every side: the
    change itself is told beside it.
    """
    first, *later = _in_force(trial) or [trial.outputs]
    found = _unlike(first, vessel)
    others = [_unlike(outputs, vessel).keys() for outputs in later]
    return [text for key, text in found.items() if all(key in other for other in others)]


def _unlike(outputs: Sequence[Servo], vessel: Vessel) -> dict[tuple[int, str], str]:
    """Channel and what is unlike there -> the sentence."""
    own, out = {servo.channel: servo for servo in outputs}, dict[tuple[int, str], str]()
    for actuator in vessel.actuators:
        ours, theirs = actuator.servo, own.get(actuator.servo.channel)
        if theirs is None:
            continue
        where = f"output {ours.channel} ({actuator.name})"
        low, neutral, high = (
            abs(a - b) > ALIKE_US for a, b in zip(ours.pwm, theirs.pwm, strict=True)
        )
        if low or neutral or high:
            what = "full throttle or full helm" if low or high else "neutral"
            out[ours.channel, "pulses"] = (
                f"{where}: pulses of {_limits(ours)} µs in the vessel file, but of "
                f"{_limits(theirs)} µs in the autopilot's parameters: what is {what} "
                "for one is not for the other"
            )
        if ours.reversed != theirs.reversed:
            does, does_not = "the vessel file", "the autopilot's parameters"
            if theirs.reversed:
                does, does_not = does_not, does
            out[ours.channel, "direction"] = f"{where}: reversed in {does}, and not in {does_not}"
    return out


def outputs_change(trial: Trial) -> list[str]:
    """That outputs are set otherwise inside the usable time: one model does not fit both sides."""
    used = trial.time[trial.usable]
    inside = [s for s in trial.outputs_set if len(used) and used[0] < s.start <= used[-1]]
    text = changes_text([(one.start, one.text) for one in inside])
    return [text] if text else []


def _in_force(trial: Trial) -> list[tuple[Servo, ...]]:
    """The outputs as they were set in the usable time, in order."""
    starts = [one.start for one in trial.outputs_set]
    sets = [trial.outputs, *(one.outputs for one in trial.outputs_set)]
    which = np.unique(np.searchsorted(starts, trial.time[trial.usable], side="right"))
    return [sets[k] for k in which]


def _limits(servo: Servo) -> str:
    """Lowest, neutral, highest [µs]."""
    return " – ".join(f"{pulse:g}" for pulse in servo.pwm)


def assumed_by(vessel: Vessel) -> list[str]:
    """What was assumed for the vessel's effects to act."""
    return [f"{vessel.name}: {text}" for text in vessel.assumptions]


def delay_assumed(
    decoded: BoatSamples, choices: Mapping[str, Choice], parameters: Mapping[str, float]
) -> tuple[str, ...]:
    """What is assumed of the delay of an autopilot's yaw rate."""
    if "yaw rate" not in choices:
        return ()
    return assumed_texts(parameters, decoded.boat.autopilot)
