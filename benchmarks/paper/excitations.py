"""Commands of the port and starboard thrusters: the paper's families, and a joystick.

All give (K, 2) in [−1, 1], one row per tick of 0.02 s. The paper names the families and does not
print their numbers: amplitudes and periods are ours. `sim.excitation` has families of these names
for a boat that somebody will sail: throttle and helm, of fixed length, from neutral to neutral, no
faster than a hand. Here either side has commands of its own, whose edges are sharp.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.random import Generator as Dice

from benchmarks.hidden.pilots import TICK
from sim.excitation import held_sticks
from sim.state import Floats

Family = Callable[[float, Dice], Floats]
STICK_S = 0.25  # a hand moves the stick that fast


def clock(seconds: float) -> Floats:
    """Times of the ticks (K,) [s]."""
    return TICK * np.arange(round(seconds / TICK), dtype=np.float64)


def waves(t: Floats, port: float, starboard: float, amplitude: float = 0.85) -> Floats:
    """Sines of two periods [s] -> (K, 2)."""
    periods = np.array([port, starboard])
    return amplitude * np.sin(2.0 * np.pi * t[:, None] / periods) + 0.15


def sinusoid(seconds: float, dice: Dice) -> Floats:
    """Sines of their own period on either side."""
    return waves(clock(seconds), 23.0, 17.0)


def square(seconds: float, dice: Dice) -> Floats:
    """Steps to and fro."""
    return 0.8 * np.sign(waves(clock(seconds) + 1.0, 19.0, 31.0)) + 0.1


def mixed(seconds: float, dice: Dice) -> Floats:
    """Sine on one side, steps on the other, then the other way round."""
    t = clock(seconds)
    both = np.stack([waves(t, 14.0, 14.0)[:, 0], 0.9 * np.sign(waves(t, 21.0, 21.0)[:, 1])], axis=1)
    return np.where((t < 0.5 * seconds)[:, None], both, both[:, ::-1])


LEVELS = (
    (1.0, 1.0), (0.45, 0.45), (1.0, 0.3), (0.3, 1.0), (-0.8, -0.8), (1.0, -1.0), (-1.0, 1.0),
    (0.7, 0.0), (0.0, 0.7), (0.0, 0.0),
)  # fmt: skip


def constant(seconds: float, dice: Dice) -> Floats:
    """One pair of commands after another, each held."""
    return held_sticks(clock(seconds), [(seconds / len(LEVELS), *level) for level in LEVELS])


def random(seconds: float, dice: Dice) -> Floats:
    """New commands every one to five seconds."""
    lasts = dice.uniform(1.0, 5.0, round(seconds) + 1)
    levels = dice.uniform(-0.8, 1.0, (len(lasts), 2))
    return held_sticks(clock(seconds), [(s, *both) for s, both in zip(lasts, levels, strict=True)])


def joystick(seconds: float, dice: Dice) -> Floats:
    """A driver: a run ahead or astern, a rest, a turn on the spot; the stick moves smoothly.

    Lengths and strengths are such that IAcquaBot moves about as the paper's reference does.
    """
    count, done, legs = round(seconds / TICK), 0, []
    while done < count:
        strength = dice.choice([-1.0, 1.0], p=[0.25, 0.75]) * dice.uniform(0.6, 1.0)
        side = dice.choice([-1.0, 1.0])
        for port, starboard, low, high in (
            (strength, strength, 2.0, 4.0), (0.0, 0.0, 1.0, 3.0), (side, -side, 4.0, 8.0)
        ):  # fmt: skip
            legs.append(np.tile([port, starboard], (round(dice.uniform(low, high) / TICK), 1)))
            done += len(legs[-1])
    return smoothed(np.concatenate(legs)[:count], STICK_S)


def smoothed(commands: Floats, seconds: float) -> Floats:
    """Commands (K, 2) as a first-order lag lets them through."""
    out, share = commands.copy(), TICK / seconds
    for k in range(1, len(out)):
        out[k] = out[k - 1] + share * (commands[k] - out[k - 1])
    return out


IDENTIFICATION: Sequence[Family] = (sinusoid, square, mixed, constant, random)


def identification(seconds: float, dice: Dice) -> Floats:
    """The five families one after another, each a fifth of the time."""
    return np.concatenate([family(seconds / 5.0, dice) for family in IDENTIFICATION])


def validation(seconds: float, dice: Dice) -> Floats:
    """An independent set: sines, steps and random commands of other periods, from other dice."""
    third = seconds / 3.0
    t = clock(third)
    amplitude, (a, b, c, d) = dice.uniform(0.5, 0.9), dice.uniform(8.0, 30.0, 4)
    steps = amplitude * np.sign(waves(t + dice.uniform(0.0, 20.0), a, b))
    parts = waves(t, c, d, amplitude), steps, amplitude * random(third, dice) / 0.9
    return np.clip(np.concatenate(parts), -1.0, 1.0)
