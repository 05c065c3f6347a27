"""Are the channels what they are said to be? Does the boat turn and go the way it is commanded?

    y(t) ∝ ∫ e^{−(t−s)/T} τ(s) ds       τ commanded yaw moment, y turn rate; or surge force, speed

With the actuators where the vessel file says, a boat turns towards its commanded moment: the
correlation is positive whatever the hull, over a time T that is tried. Clearly negative, in yaw
alone, port and starboard are swapped; in surge and yaw, the motors run the wrong way round; in
surge alone, both. Only what was excited counts: a boat that was never steered, or never turned,
tells nothing. How sure it is comes from blocks of time.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.effects.catalogue import EFFECTS
from sim.identification.regression import command_forces
from sim.model import Model
from sim.state import Floats, Nu
from sim.trial import Trial
from sim.vessel import Vessel

TIMES_S = (0.5, 1.0, 2.0, 4.0)  # T: a small boat's answer takes about so long
BLOCK_S = 5.0
FEWEST = 4  # blocks
CLEAR = 0.5  # of the correlation
SURE = 4.0  # standard deviations of the slope
STEERED = 0.03  # of the largest moment or force: a smaller standard deviation is no excitation
MIN_MOTION_STD = {Nu.R: 0.03, Nu.U: 0.1}  # rad/s, m/s: a smaller standard deviation is no answer


class CommandResponse(NamedTuple):
    """How motion followed what was commanded: −1 … 1, and the slope in standard deviations."""

    correlation: float
    sure: float

    @property
    def sign(self) -> int:
        """1 as commanded, −1 the other way, 0 not clear."""
        clear = abs(self.correlation) > CLEAR and abs(self.sure) > SURE
        return int(np.sign(self.correlation)) if clear else 0


def command_response(
    command: Floats, motion: Floats, rows: NDArray[np.bool_], dt: float, moved: float
) -> CommandResponse | None:
    """Command (T,) in shares of the largest, motion (T,), rows that count -> None: not excited."""
    if rows.sum() * dt < FEWEST * BLOCK_S:
        return None
    if command[rows].std() < STEERED or motion[rows].std() < moved:
        return None
    tried = [_over(command, motion, rows, dt, tau) for tau in TIMES_S]
    return max(tried, key=lambda a: abs(a.correlation))


def _over(
    command: Floats, motion: Floats, rows: NDArray[np.bool_], dt: float, tau: float
) -> CommandResponse:
    """Command through a lag, beside the motion."""
    # only where something is linked does the scipy.signal package load: half a second
    from scipy.signal import lfilter

    keep = float(np.exp(-dt / tau))
    lagged = np.asarray(lfilter([1.0 - keep], [1.0, -keep], command))[rows]
    x, y = lagged - lagged.mean(), motion[rows] - motion[rows].mean()
    size = float(np.sqrt((x @ x) * (y @ y)))
    if size == 0.0:
        return CommandResponse(0.0, 0.0)
    block = (np.arange(len(x)) * dt // BLOCK_S).astype(int)
    above, below = np.bincount(block, x * y), np.bincount(block, x * x)
    without = (above.sum() - above) / np.maximum(below.sum() - below, 1e-300)
    share = (len(above) - 1) / len(above)
    std = float(np.sqrt(share * np.sum((without - without.mean()) ** 2)))
    return CommandResponse(float(x @ y) / size, float(above.sum() / below.sum() / max(std, 1e-12)))


@dataclass(frozen=True)
class Wiring:
    """What recordings tell of a vessel's channels.

    yaw, surge  1 as commanded, −1 the other way round, 0 not told
    """

    yaw: int
    surge: int
    runs: tuple[str, ...]  # that tell of something wrong
    correlation: float  # the clearest of those

    @property
    def swapped(self) -> bool:
        """Port and starboard exchanged."""
        return self.yaw < 0 <= self.surge or (self.surge < 0 < self.yaw)

    @property
    def turned(self) -> bool:
        """All motors the wrong way round."""
        return self.surge < 0


def wiring_of(trials: Sequence[Trial], vessel: Vessel) -> Wiring:
    """All recordings together: each that tells has a vote."""
    model = Model.of(vessel)
    votes = {axis: [(t.name, _answer(t, model, axis)) for t in trials] for axis in MIN_MOTION_STD}
    signs = {axis: [(n, a) for n, a in told if a and a.sign] for axis, told in votes.items()}
    yaw, surge = (_majority([a.sign for _, a in signs[axis]]) for axis in (Nu.R, Nu.U))
    wrong = [
        (n, a)
        for axis, verdict in ((Nu.R, yaw), (Nu.U, surge))
        for n, a in signs[axis]
        if verdict < 0 and a.sign < 0
    ]
    clearest = min((a.correlation for _, a in wrong), default=0.0)
    return Wiring(yaw, surge, tuple(dict.fromkeys(n for n, _ in wrong)), clearest)


def _answer(trial: Trial, model: Model, axis: Nu) -> CommandResponse | None:
    """How one axis of a trial followed its commands."""
    tau = command_forces(trial, model)[:, axis]
    largest = _largest(model, axis)
    if largest == 0.0:
        return None
    return command_response(
        tau / largest, trial.nu[:, axis], trial.usable, trial.dt, MIN_MOTION_STD[axis]
    )


def _largest(model: Model, axis: Nu) -> float:
    """Force or moment [N, N m] that all thrusters come to at most."""
    per = [
        abs(t.thrust[1]) * (1.0 if axis is Nu.U else float(np.hypot(*t.position)))
        for t in model.vessel.thrusters
    ]
    return float(sum(per))


def _majority(signs: Sequence[int]) -> int:
    """One sign that nobody, or few, speak against."""
    total = sum(signs)
    return int(np.sign(total)) if abs(total) > 0.5 * len(signs) else 0


def pair_of(vessel: Vessel) -> tuple[int, int] | None:
    """The one thruster to port and the one to starboard, where there are no others."""
    port = [i for i, t in enumerate(vessel.thrusters) if t.position[1] < 0.0]
    starboard = [i for i, t in enumerate(vessel.thrusters) if t.position[1] > 0.0]
    alone = len(port) == len(starboard) == 1
    return (port[0], starboard[0]) if alone else None


def rewired(vessel: Vessel, found: Wiring) -> Vessel:
    """The vessel with its channels as the recordings say."""
    thrusters = list(vessel.thrusters)
    pair = pair_of(vessel)
    if found.swapped and pair is not None:
        a, b = pair
        servos = thrusters[a].servo, thrusters[b].servo
        thrusters[a] = replace(thrusters[a], servo=servos[1])
        thrusters[b] = replace(thrusters[b], servo=servos[0])
    if found.turned:
        thrusters = [
            replace(t, servo=replace(t.servo, reversed=not t.servo.reversed)) for t in thrusters
        ]
    return replace(vessel, thrusters=tuple(thrusters))


def wiring_notices(found: Wiring, vessel: Vessel) -> tuple[str, ...]:
    """What is wrong, which runs tell, and what to do: a sentence each."""
    where = f"{', '.join(found.runs)}: correlation {found.correlation:.2f}"
    said = []
    if found.swapped:
        said.append(f"{_swap(vessel, found)} ({where})")
    if found.turned:
        said.append(
            "the motors look as if they ran the wrong way round: the boat goes astern where it is "
            f"commanded ahead; exchange `reversed` of every thruster in the vessel file ({where})"
        )
    return tuple(said)


def _swap(vessel: Vessel, found: Wiring) -> str:
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
        f"{b.name} ({b.servo.channel}), or add the effect {wiring} with order = {digits}"
    )
