"""Wiring of the actuators: does the boat turn and go the way that it is commanded?

    y(t) ∝ ∫ e^{−(t−s)/T} τ(s) ds       τ commanded yaw moment, y turn rate; or surge force, speed

With the actuators as in the vessel file, a boat turns towards its commanded moment: the correlation
is positive whatever the hull, for the best of a few times T. Clearly negative, in yaw alone, port
and starboard are swapped; in surge and yaw, the motors run the wrong way round; in surge alone,
both. Where neither follows its command, one motor of a pair may run the wrong way round: then both
follow theirs with that one turned. Only what was excited counts: a boat that was never steered, or
never turned, determines nothing. The uncertainty of the slope comes from blocks of time.

A thruster or rudder whose output never gets a pulse in a recording has a channel that is not its
own. Such recordings tell nothing of the other outputs: the model lacks a force there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.effects.catalogue import EFFECTS
from sim.identification.regression import command_forces
from sim.model import Model
from sim.state import Floats, Nu
from sim.trial import Trial
from sim.vessel import Vessel

# Chosen, not measured:
RESPONSE_TIMES_S = (0.5, 1.0, 2.0, 4.0)  # T of a small boat
RESPONSE_BLOCK_S = 5.0
MIN_BLOCKS = 4
MIN_CORRELATION = 0.5
MIN_SLOPE_STDS = 4.0  # standard deviations of the slope
MIN_COMMAND_STD = 0.03  # of the largest moment or force: less is no excitation
AHEAD = np.array([1.0, 0.0, 0.0])
MIN_MOTION_STD = {Nu.R: 0.03, Nu.U: 0.1}  # rad/s, m/s: less is no response


class CommandResponse(NamedTuple):
    """Correlation of motion and command, −1 … 1, and the slope in its standard deviations."""

    correlation: float
    slope_stds: float

    @property
    def sign(self) -> int:
        """1 as commanded, −1 the other way, 0 not clear."""
        clear = abs(self.correlation) > MIN_CORRELATION and abs(self.slope_stds) > MIN_SLOPE_STDS
        return int(np.sign(self.correlation)) if clear else 0


def command_response(
    command: Floats, motion: Floats, rows: NDArray[np.bool_], dt: float, axis: Nu
) -> CommandResponse | None:
    """Command (T,) in shares of the largest, motion (T,), rows that count -> None: not excited."""
    if rows.sum() * dt < MIN_BLOCKS * RESPONSE_BLOCK_S:
        return None
    if command[rows].std() < MIN_COMMAND_STD or motion[rows].std() < MIN_MOTION_STD[axis]:
        return None
    tried = [_lagged_response(command, motion, rows, dt, tau) for tau in RESPONSE_TIMES_S]
    return max(tried, key=lambda response: abs(response.correlation))


def _lagged_response(
    command: Floats, motion: Floats, rows: NDArray[np.bool_], dt: float, tau: float
) -> CommandResponse:
    """Motion beside the command through a first-order lag `tau` [s]."""
    keep = float(np.exp(-dt / tau))
    lag = accumulate(((1.0 - keep) * command).tolist(), lambda y, c: keep * y + c)
    lagged = np.fromiter(lag, float, len(command))[rows]
    x, y = lagged - lagged.mean(), motion[rows] - motion[rows].mean()
    size = float(np.sqrt((x @ x) * (y @ y)))
    if size == 0.0:
        return CommandResponse(0.0, 0.0)
    block = (np.arange(len(x)) * dt // RESPONSE_BLOCK_S).astype(int)
    above, below = np.bincount(block, x * y), np.bincount(block, x * x)
    without = (above.sum() - above) / np.maximum(below.sum() - below, 1e-300)
    share = (len(above) - 1) / len(above)
    std = float(np.sqrt(share * np.sum((without - without.mean()) ** 2)))
    return CommandResponse(float(x @ y) / size, float(above.sum() / below.sum() / max(std, 1e-12)))


class UndrivenOutput(NamedTuple):
    """An actuator's output without a pulse in some recordings, and the outputs that have some."""

    actuator: str
    channel: int
    runs: tuple[str, ...]
    driven: tuple[int, ...]


@dataclass(frozen=True)
class Wiring:
    """Contradictions between recordings and a vessel's channels.

    yaw, surge   1 as commanded, −1 the other way round, 0 not determined
    runs         recordings that contradict them
    correlation  the clearest of those
    clear        sum of the correlations, 0 … 1 each, of responses that are clear
    backwards    the one thruster that runs the wrong way round; the others are as with it turned
    undriven     outputs that never get a pulse
    """

    yaw: int
    surge: int
    runs: tuple[str, ...]
    correlation: float
    clear: float = 0.0
    backwards: int | None = None
    undriven: tuple[UndrivenOutput, ...] = ()

    @property
    def swapped(self) -> bool:
        """Port and starboard exchanged."""
        return self.yaw < 0 <= self.surge or (self.surge < 0 < self.yaw)

    @property
    def reversed(self) -> bool:
        """All motors the wrong way round."""
        return self.surge < 0


def wiring_of(trials: Sequence[Trial], vessel: Vessel) -> Wiring:
    """All recordings together: the clear responses of each axis vote on its sign.

    Where the channels are contradicted, or nothing is clear, one motor may be turned: it is where
    responses are then clearer. A wrong force may follow a motion by chance, on a recording or two.
    """
    undriven, outputs = _undriven(trials, vessel), {a.servo.channel for a in vessel.actuators}
    trials = [trial for trial in trials if outputs <= set(trial.channels)]
    best, pair = replace(_votes(trials, vessel), undriven=undriven), pair_of(vessel)
    agrees = min(best.yaw, best.surge) >= 0 and max(best.yaw, best.surge) > 0
    for i in () if agrees or pair is None else pair:
        turned = _votes(trials, _with_turned(vessel, [i]), wrong=(-1, 1))
        if turned.surge > 0 and turned.yaw and turned.clear > best.clear:
            best = replace(turned, backwards=i, undriven=undriven)
    return best


def _undriven(trials: Sequence[Trial], vessel: Vessel) -> tuple[UndrivenOutput, ...]:
    """Actuators without a pulse in recordings that have commands at all."""
    commanded = [trial for trial in trials if trial.channels]
    out = []
    for actuator in vessel.actuators:
        channel = actuator.servo.channel
        silent = [trial for trial in commanded if channel not in trial.channels]
        if silent:
            driven = sorted({one for trial in silent for one in trial.channels})
            names = tuple(trial.name for trial in silent)
            out.append(UndrivenOutput(actuator.name, channel, names, tuple(driven)))
    return tuple(out)


def _votes(trials: Sequence[Trial], vessel: Vessel, wrong: tuple[int, ...] = (-1,)) -> Wiring:
    """The signs of both axes; `wrong`: those that contradict the vessel file."""
    model = Model.of(vessel)
    signs: dict[Nu, int] = {}
    against: list[tuple[str, CommandResponse]] = []
    total_clear = 0.0
    for axis in (Nu.R, Nu.U):
        all_of_axis = [(t.name, _response(t, model, axis)) for t in trials]
        clear = [(name, response) for name, response in all_of_axis if response and response.sign]
        total = sum(response.sign for _, response in clear)
        total_clear += sum(abs(response.correlation) for _, response in clear)
        signs[axis] = int(np.sign(total)) if abs(total) > 0.5 * len(clear) else 0
        if signs[axis] in wrong:
            against += [(name, r) for name, r in clear if r.sign == signs[axis]]
    clearest = max((r.correlation for _, r in against), key=abs, default=0.0)
    runs = tuple(dict.fromkeys(name for name, _ in against))
    return Wiring(signs[Nu.R], signs[Nu.U], runs, clearest, total_clear)


def _response(trial: Trial, model: Model, axis: Nu) -> CommandResponse | None:
    """Response of one axis of a trial to its commands, in shares of what all thrusters can do.

    Commands as they act on a boat that goes straight: a rudder is a fin too, and where a tight
    turn drives the water against its other side it brakes the turn that it has begun.
    """
    largest = sum(
        abs(t.thrust[1]) * (1.0 if axis is Nu.U else float(np.hypot(*t.position)))
        for t in model.vessel.thrusters
    )
    if largest == 0.0:
        return None
    straight = replace(trial, nu=trial.nu * AHEAD)
    command = command_forces(straight, model)[:, axis] / largest
    return command_response(command, trial.nu[:, axis], trial.usable, trial.dt, axis)


def pair_of(vessel: Vessel) -> tuple[int, int] | None:
    """The one thruster to port and the one to starboard, where there are no others."""
    port = [i for i, t in enumerate(vessel.thrusters) if t.position[1] < 0.0]
    starboard = [i for i, t in enumerate(vessel.thrusters) if t.position[1] > 0.0]
    alone = len(port) == len(starboard) == 1
    return (port[0], starboard[0]) if alone else None


def _with_turned(vessel: Vessel, which: Sequence[int]) -> Vessel:
    """The vessel with some of its motors running the other way round."""
    thrusters = [
        replace(t, servo=replace(t.servo, reversed=not t.servo.reversed)) if i in which else t
        for i, t in enumerate(vessel.thrusters)
    ]
    return replace(vessel, thrusters=tuple(thrusters))


def rewired(vessel: Vessel, wiring: Wiring) -> Vessel:
    """The vessel with its channels as the recordings have them."""
    if wiring.backwards is not None:
        vessel = _with_turned(vessel, [wiring.backwards])
    thrusters = list(vessel.thrusters)
    pair = pair_of(vessel)
    if wiring.swapped and pair is not None:
        port, starboard = (thrusters[i] for i in pair)
        thrusters[pair[0]] = replace(port, servo=starboard.servo)
        thrusters[pair[1]] = replace(starboard, servo=port.servo)
    swapped = replace(vessel, thrusters=tuple(thrusters))
    return _with_turned(swapped, range(len(thrusters))) if wiring.reversed else swapped


def wiring_notices(wiring: Wiring, vessel: Vessel) -> tuple[str, ...]:
    """A sentence for each fault of the wiring: what it is, in which runs, and what to do."""
    where = f"{', '.join(wiring.runs)}: correlation {wiring.correlation:.2f}"
    notices = [_undriven_notice(one) for one in wiring.undriven]
    if wiring.backwards is not None:
        one = vessel.thrusters[wiring.backwards]
        vessel = _with_turned(vessel, [wiring.backwards])
        notices.append(
            "one motor looks as if it ran the wrong way round: the boat follows neither its "
            "commanded force nor its commanded moment, and both with that motor turned; in the "
            f"vessel file exchange `reversed` of {one.name} ({one.servo.channel}) ({where})"
        )
    if wiring.swapped:
        after = "" if wiring.backwards is None else "with that motor turned "
        notices.append(f"{after}{_swap_notice(vessel)} ({where})")
    if wiring.reversed:
        notices.append(
            "the motors look as if they ran the wrong way round: the boat goes astern where it is "
            f"commanded ahead; exchange `reversed` of every thruster in the vessel file ({where})"
        )
    return tuple(notices)


def _undriven_notice(one: UndrivenOutput) -> str:
    *others, last = map(str, one.driven)
    driven = f"{', '.join(others)} and {last}" if others else last
    return (
        f"{one.actuator} (channel {one.channel}): this log never drives output {one.channel}; it "
        f"drives {driven}; correct `channel` in the vessel file ({', '.join(one.runs)})"
    )


def _swap_notice(vessel: Vessel) -> str:
    pair = pair_of(vessel)
    if pair is None:
        return (
            "the steering looks reversed: the boat turns away from its commanded side; look at "
            "`channel` and `reversed` of thrusters and rudders in the vessel file"
        )
    a, b = (vessel.thrusters[i] for i in pair)
    order = list(range(1, len(vessel.actuators) + 1))
    order[pair[0]], order[pair[1]] = order[pair[1]], order[pair[0]]
    digits = "".join(map(str, order))
    wiring = next(effect.name for effect in EFFECTS if effect.wiring is not None)
    turned = " (and `reversed`)" if a.servo.reversed != b.servo.reversed else ""
    return (
        "port and starboard commands look swapped: the boat turns away from its commanded side; "
        f"in the vessel file exchange `channel`{turned} of {a.name} ({a.servo.channel}) and "
        f"{b.name} ({b.servo.channel}), or, where the channels are right, the signs of `position`; "
        f"or add the effect {wiring} with order = {digits}"
    )
