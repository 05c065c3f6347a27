"""What an effect does to a small boat: seen for all of the catalogue, within their bounds."""

import numpy as np
import pytest

from sim.effects.catalogue import EFFECTS
from sim.effects.effect import Kind
from sim.excitation.responses import MIN_SIZE, run_example
from tests.sim.vessels import each_effect

pytestmark = pytest.mark.usefixtures("plain_laws")


@each_effect()
def test_every_effect_is_seen_where_the_picture_looks(effect):
    run = run_example(effect)
    assert np.isfinite(run.changed).all()
    off = (run.changed - run.plain)[:, run.channel]
    size = max(run.plain[:, run.channel].std(), MIN_SIZE[run.channel])
    assert np.sqrt(np.mean(off**2)) > 0.1 * size
    for p in effect.parameters:
        if p.kind is not Kind.CHOICE:
            assert p.lower <= run.values[p.name] <= p.upper


def test_the_plain_boat_is_the_same_for_all():
    one, two = (run_example(effect) for effect in EFFECTS[:2])
    np.testing.assert_array_equal(one.plain, two.plain)
