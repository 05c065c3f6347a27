"""What a table says of the motion, as far as it can be trusted, and what could not, in words.

Held values go back to their own times; rates that were smoothed towards both sides give way to the
positions and headings that they came from; accelerations are looked at and never used.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gateway.estimation.settings import FilterSettings, White
from gateway.ingest.csv.log import SOURCE
from gateway.ingest.earth import Origin, to_local
from gateway.ingest.source_quality import (
    NOTHING,
    Smoothing,
    acceleration_std,
    agreement,
    smoothing,
    white_std,
)
from gateway.ingest.sources import Choice, intervals, rate_hz
from gateway.ingest.zero_order_hold import retimed
from gateway.samples import Quantity, Samples
from sim.state import Floats

HELD = ("position", "velocity", "yaw", "yaw rate")


@dataclass(frozen=True)
class Tidied:
    """The sources to use, and one sentence for each thing that was wrong."""

    choices: Mapping[str, Choice]
    notices: tuple[str, ...]


def tidied(choices: Mapping[str, Choice], accelerations: Sequence[Samples] = ()) -> Tidied:
    """The sources of a table -> those that hold; a log of messages comes back as it is."""
    if "yaw" not in choices or choices["yaw"].source != SOURCE:
        return Tidied(choices, ())
    out, said = dict(choices), list[str]()
    for name in HELD:
        if name in out:
            out[name], says = _own_times(out[name])
            said += says
    wide = _smoothings(out)
    said += _gravity(out, accelerations)
    if any(found.found for found in wide.values()):
        left_out = [n for n in ("velocity", "yaw rate") if n in out and _replaceable(n, out)]
        said.append(_says(wide, left_out))
        out = {name: choice for name, choice in out.items() if name not in left_out}
    return Tidied(out, tuple(said))


def settings_for(choices: Mapping[str, Choice], settings: FilterSettings) -> FilterSettings:
    """The same with errors of a table's columns as rough as they are, and motion as hard.

    Positions that stand in for velocities must not wander more from fix to fix than they do.
    """
    if "yaw" not in choices or choices["yaw"].source != SOURCE or SOURCE in settings.sources:
        return settings
    std = dict(vars(White()))
    heading = choices["yaw"].samples
    turned = np.unwrap(heading.values, axis=0)
    std["yaw_rad"] = white_std(turned, 0.001)
    at = _seconds(heading, int(heading.vehicle_time_ns[0]))
    turns = max(acceleration_std(at, turned), settings.yaw_acceleration_radps2)
    sources = {**settings.sources, SOURCE: White(**std)}
    if "position" not in choices or "velocity" in choices:
        return replace(settings, sources=sources, yaw_acceleration_radps2=turns)
    place = choices["position"]
    path, when = _metres(place.samples), _seconds(place.samples, int(heading.vehicle_time_ns[0]))
    white = white_std(path, 0.003)
    sources[SOURCE] = replace(sources[SOURCE], position_m=white)
    wander = 2.0 * settings.position_error_m**2 / (max(place.rate_hz, 0.1) * white**2)
    hard = acceleration_std(when, path)
    return replace(
        settings,
        sources=sources,
        yaw_acceleration_radps2=turns,
        surge_acceleration_mps2=max(hard, settings.surge_acceleration_mps2),
        sway_acceleration_mps2=max(0.5 * hard, settings.sway_acceleration_mps2),
        position_error_tau_s=max(wander, settings.position_error_tau_s),
    )


def _own_times(choice: Choice) -> tuple[Choice, list[str]]:
    """Held values at their own times."""
    found = retimed(choice.samples)
    if found is None:
        return choice, []
    rate = rate_hz(found)
    says = (
        f"{choice.name} comes at {rate:.1f} Hz and is repeated on rows of {choice.rate_hz:.0f} Hz: "
        "each value is taken once, at its own time"
    )
    longest = float(intervals(found).max())
    return replace(choice, samples=found, rate_hz=rate, longest_gap_s=longest), [says]


def _replaceable(name: str, choices: Mapping[str, Choice]) -> bool:
    """There is something else that tells it."""
    return name == "yaw rate" or "position" in choices


def _smoothings(choices: Mapping[str, Choice]) -> dict[str, Smoothing]:
    """Rate -> what was done to it, where there is something to hold it against."""
    yaw = choices["yaw"].samples
    start = int(yaw.vehicle_time_ns[0])
    heading = np.unwrap(yaw.values[:, 0])
    at = _seconds(yaw, start)
    out = {}
    if "yaw rate" in choices:
        rate = choices["yaw rate"].samples
        out["yaw rate"] = _ordered(at, heading[:, None], _seconds(rate, start), rate.values)
    if "velocity" in choices and "position" in choices:
        velocity, place = choices["velocity"].samples, choices["position"].samples
        when = _seconds(velocity, start)
        over_ground = _over_ground(velocity, np.interp(when, at, heading))
        out["velocity"] = _ordered(_seconds(place, start), _metres(place), when, over_ground)
    return out


def _ordered(time: Floats, x: Floats, rate_time: Floats, rate: Floats) -> Smoothing:
    """Nothing is said of a table whose clock runs backwards."""
    if np.any(np.diff(time) <= 0.0) or np.any(np.diff(rate_time) <= 0.0):
        return NOTHING
    return smoothing(time, x, rate_time, rate)


def _seconds(samples: Samples, start_ns: int) -> Floats:
    return np.asarray((samples.vehicle_time_ns - start_ns) * 1e-9, np.float64)


def _metres(place: Samples) -> Floats:
    """Positions (K, 2) [m]."""
    if place.quantity is not Quantity.GLOBAL_POSITION:
        return place.values
    return to_local(place.values, Origin(*map(float, place.values[0])))


def _over_ground(velocity: Samples, yaw: Floats) -> Floats:
    """Velocities (K, 2) towards north, east [m/s]."""
    if velocity.quantity is not Quantity.BODY_VELOCITY:
        return velocity.values
    c, s = np.cos(yaw), np.sin(yaw)
    u, v = velocity.values.T
    return np.stack([c * u - s * v, s * u + c * v], axis=1)


def _gravity(choices: Mapping[str, Choice], accelerations: Sequence[Samples]) -> list[str]:
    """A sentence about accelerations, which are not used either way."""
    if not accelerations:
        return []
    means = "accelerations are not used: motion follows from positions, headings and rates"
    moving = choices.get("velocity")
    if moving is None or moving.samples.quantity is not Quantity.BODY_VELOCITY:
        return [means]
    start = int(moving.samples.vehicle_time_ns[0])
    time, (u, v) = _seconds(moving.samples, start), moving.samples.values.T
    yaw = choices["yaw"].samples
    turned = np.interp(time, _seconds(yaw, start), np.unwrap(yaw.values[:, 0]))
    r = np.gradient(turned, time)
    reported = np.interp(time, _seconds(accelerations[0], start), accelerations[0].values[:, 0])
    found = agreement(time, reported, np.gradient(u, time) - r * v)
    if found is None or found.good:
        return [means]
    return [
        f"surge acceleration holds gravity: it reads {found.slope:.1f} m/s² where the speed "
        f"changes by 1.0 m/s² and is {found.bias:+.2f} m/s² off in the mean; {means}"
    ]


def _says(wide: Mapping[str, Smoothing], left_out: Sequence[str]) -> str:
    names = [name for name, found in wide.items() if found.found]
    window = max(wide[name].window_s for name in names)
    verb = "is" if len(names) == 1 else "are"
    instead = {"velocity": "positions", "yaw rate": "headings"}
    how = (
        f"{' and '.join(instead[n] for n in left_out)} are taken instead of "
        f"{' and '.join(left_out)}"
        if left_out
        else "there is nothing to take instead: lags found from it are too short"
    )
    return (
        f"{' and '.join(names)} {verb} smoothed over about {window:.1f} s to both sides, so motion "
        f"shows before its command: {how}"
    )
