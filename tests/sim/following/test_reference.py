"""ν_ref: measured, model and auto; hand-overs without a bump; chunks make no difference."""

from dataclasses import replace

import numpy as np
import pytest

from sim.effects import heading_offset, thruster_lag
from sim.following import MAX_SPEED_MPS
from sim.following.follower import Reference, ReferenceMode
from sim.model import Model
from tests.sim.vessels import WAMV, added, excitation

DT = 0.02
BOAT = WAMV.with_effects(added(thruster_lag.EFFECT), added(heading_offset.EFFECT))


def voyage(seconds=20.0, vessel=BOAT):
    """Times (K,), reported motion (K, 9) and the commands up to each row (K, na)."""
    commands = excitation(vessel, seconds, DT)
    _, reports = Model.of(vessel).simulate(commands, DT)
    before = np.concatenate([commands[:1], commands])
    return DT * np.arange(len(before)), reports[0], before


def outage(count, start, end):
    """Freshness (K,) with one stretch of silence."""
    fresh = np.ones(count, bool)
    fresh[start:end] = False
    return fresh


def test_measured_is_the_estimate_itself():
    times, rows, commands = voyage()
    reference = Reference(Model.of(BOAT), ReferenceMode.MEASURED)
    _, out, from_model, *_ = reference.advance(
        reference.start(), times, rows, outage(len(times), 300, 500), commands
    )
    np.testing.assert_array_equal(out, rows)
    assert not from_model.any()


def test_the_model_alone_reproduces_a_boat_that_is_as_the_model_says():
    times, rows, commands = voyage()
    blind = rows.copy()
    blind[1:] = 1e6  # only the first estimate may be looked at
    reference = Reference(Model.of(BOAT), ReferenceMode.MODEL)
    _, out, from_model, *_ = reference.advance(
        reference.start(), times, blind, np.ones(len(times), bool), commands
    )
    assert from_model.all()
    np.testing.assert_allclose(out[:, :6], rows[:, :6], atol=1e-9)


def test_a_wild_time_is_no_span_to_predict_over():
    times, rows, commands = voyage(4.0, WAMV)  # no memory that would start settled
    reference = Reference(Model.of(WAMV), ReferenceMode.MODEL)
    wild = times.copy()
    wild[100] = 1e9
    fresh = np.ones(len(times), bool)
    out = reference.advance(reference.start(), wild, rows, fresh, commands)
    np.testing.assert_allclose(out.references[100:102, :6], rows[100:102, :6], atol=1e-9)
    np.testing.assert_allclose(out.references[-1, :6], rows[-1, :6], atol=1e-6)
    assert not out.diverged.any()


def test_a_model_that_diverges_begins_anew_at_the_estimate_and_says_so():
    runaway = replace(WAMV, dynamics=replace(WAMV.dynamics, X_u=400.0, X_uu=50.0))
    times, rows, commands = voyage(20.0, WAMV)
    reference = Reference(Model.of(runaway), ReferenceMode.MODEL)
    fresh = np.ones(len(times), bool)
    out = reference.advance(reference.start(), times, rows, fresh, commands)
    (first, *_), count = np.flatnonzero(out.diverged), int(out.diverged.sum())
    assert 1 <= count < 100
    np.testing.assert_allclose(out.references[first, :6], rows[first, :6], atol=1e-9)
    assert np.abs(out.references[:, 3:5]).max() <= MAX_SPEED_MPS
    measured = Reference(Model.of(runaway), ReferenceMode.MEASURED)
    assert not measured.advance(
        measured.start(), times, rows, fresh, commands
    ).diverged.any()  # nobody looks at the model


def test_auto_bridges_a_silent_link():
    """The estimate freezes in the outage, the prediction goes on as the boat does."""
    times, rows, commands = voyage()
    fresh = outage(len(times), 300, 600)
    frozen = rows.copy()
    frozen[300:600] = rows[299]
    reference = Reference(Model.of(BOAT))
    start = reference.start()
    _, out, from_model, *_ = reference.advance(start, times, frozen, fresh, commands)
    np.testing.assert_allclose(out[:, :6], rows[:, :6], atol=1e-7)
    np.testing.assert_array_equal(from_model, ~fresh)


def wrong_model_voyage(jumps=None):
    """A boat that the model does not describe: times, estimates, freshness, reference."""
    times, rows, commands = voyage(30.0)
    fresh = outage(len(times), 500, 800)
    reference = Reference(Model.of(WAMV))  # neither lag nor heading offset
    start, commands = reference.start(), 0.8 * commands
    _, out, *_ = reference.advance(start, times, rows, fresh, commands, jumps=jumps)
    return times, rows, fresh, out


def test_pose_velocity_and_acceleration_go_on_at_both_hand_overs():
    _, rows, _, out = wrong_model_voyage()
    usual = np.abs(np.diff(rows, axis=0)).max(axis=0)
    for k in (500, 800):
        step = np.abs(out[k] - out[k - 1])
        assert np.all(step <= 1.5 * usual + 1e-3), k
    assert np.abs(out[799, :2] - rows[799, :2]).max() > 0.3  # there was something to hide


def test_what_the_prediction_was_off_fades_within_seconds():
    times, rows, _, out = wrong_model_voyage()
    off = np.abs(out - rows)[:, :6].max(axis=1)
    since = times - times[800]
    assert off[800] > 0.3
    assert off[since >= 10.0].max() < 0.01
    np.testing.assert_array_equal(out[:500], rows[:500])
    late = (since > 4.0) & (since < 8.0)
    gap = np.linalg.norm((out - rows)[late, :2], axis=1)
    rate = -np.polyfit(times[late], np.log(gap), 1)[0]
    assert 0.5 < rate < 1.2  # a time constant of about a second


def test_the_reference_stays_one_motion_while_it_hands_over():
    """η̇ = J(ψ) ν and ν̇ = dν/dt hold in the blend as they do in its sources."""
    _, _, _, out = wrong_model_voyage()
    part = out[801:900]
    rate = np.gradient(part, DT, axis=0)[1:-1]
    mid = part[1:-1]
    c, s = np.cos(mid[:, 2]), np.sin(mid[:, 2])
    np.testing.assert_allclose(rate[:, 0], c * mid[:, 3] - s * mid[:, 4], atol=2e-3)
    np.testing.assert_allclose(rate[:, 1], s * mid[:, 3] + c * mid[:, 4], atol=2e-3)
    np.testing.assert_allclose(rate[:, 2], mid[:, 5], atol=2e-3)


def test_an_origin_shift_is_not_a_bump_to_be_hidden():
    times, rows, commands = voyage()
    fresh = outage(len(times), 300, 600)
    rows[700:, 0] += 500.0
    rows[450:, 1] -= 90.0
    jumps = np.zeros(len(times), bool)
    jumps[[450, 700]] = True
    reference = Reference(Model.of(BOAT))
    _, out, *_ = reference.advance(reference.start(), times, rows, fresh, commands, jumps=jumps)
    np.testing.assert_allclose(out[:, :6], rows[:, :6], atol=1e-7)


def test_a_jump_ends_a_hand_over():
    jumps = np.arange(1501) == 810
    _, rows, _, out = wrong_model_voyage(jumps)
    assert np.abs(out[809] - rows[809]).max() > 0.1
    np.testing.assert_array_equal(out[810:], rows[810:])


@pytest.mark.parametrize("mode", list(ReferenceMode))
@pytest.mark.parametrize("size", [1, 13, 300])
def test_chunks_make_no_difference(mode, size):
    times, rows, commands = voyage(10.0)
    fresh = outage(len(times), 100, 150) & outage(len(times), 170, 300)
    times[200] = times[199]
    reference = Reference(Model.of(WAMV), mode)
    whole = reference.advance(reference.start(), times, rows, fresh, commands)
    state, parts, modelled = reference.start(), [], []
    for k in range(0, len(times), size):
        cut = slice(k, k + size)
        part = reference.advance(state, times[cut], rows[cut], fresh[cut], commands[cut])
        state = part.state
        modelled.append(part.from_model)
        parts.append(part.references)
    np.testing.assert_array_equal(np.concatenate(parts), whole.references)
    np.testing.assert_array_equal(state.carry, whole.state.carry)
    np.testing.assert_array_equal(np.concatenate(modelled), whole.from_model)
    changes = np.count_nonzero(np.diff(whole.from_model))
    assert changes == (4 if mode is ReferenceMode.AUTO else 0)
