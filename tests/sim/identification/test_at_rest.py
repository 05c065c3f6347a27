"""A boat that did not turn tells nothing of how it turns."""

from dataclasses import replace

import numpy as np
import pytest

from sim.identification import BASE, IdentifySettings
from sim.identification.at_rest import axes_at_rest, axis_of
from sim.identification.by_recording import fit_recording
from sim.identification.identify import identify
from tests.sim.identification.noisy_trials import noisy, off
from tests.sim.vessels import WAMV

OF_SURGE = ("m11", "X_u", "X_uu")


@pytest.fixture(scope="module")
def straight():
    return noisy(WAMV, 200.0, seed=3, steering=0.0)


def test_a_straight_voyage_is_at_rest_in_yaw_and_sway(straight):
    assert axes_at_rest([straight]) == ("sway", "yaw")
    assert axes_at_rest([straight, noisy(WAMV, 60.0)]) == ()


def test_little_sway_in_turns_tells_of_the_hull():
    turned = noisy(WAMV, 60.0)
    stiff = replace(turned, nu=turned.nu * np.array([1.0, 0.0, 1.0]))
    assert axes_at_rest([stiff]) == ()


def test_a_boat_at_the_quay_is_at_rest_in_all(straight):
    moored = replace(straight, nu=straight.nu - straight.nu)
    assert axes_at_rest([moored]) == ("surge", "sway", "yaw")
    assert axes_at_rest([replace(moored, usable=np.zeros(len(moored.usable), bool))]) == ()


def test_a_motion_that_one_sees_is_no_noise_whatever_is_stated():
    turned = noisy(WAMV, 60.0)
    vague = replace(turned, covariance=np.tile(np.eye(9), (len(turned.time), 1, 1)))
    assert axes_at_rest([vague]) == ()


def test_axes_of_numbers():
    axes = {name: axis_of(name) for name in (*BASE, "Y_uv", "N_ur", "left.ahead", "drag.Y_extra")}
    assert [n for n, axis in axes.items() if axis == "surge"] == list(OF_SURGE)
    assert [n for n, axis in axes.items() if axis == "sway"] == ["m22", "Y_v", "Y_vv", "Y_uv"]
    assert [n for n, axis in axes.items() if axis == "yaw"] == ["m33", "N_r", "N_rr", "N_ur"]
    assert not axes["left.ahead"]
    assert not axes["drag.Y_extra"]


def test_what_did_not_move_stays_as_it_was_and_is_said(straight):
    given = off(WAMV)
    found = identify([straight], given)
    for each in found.estimates:
        truth, before = (getattr(v.dynamics, each.name) for v in (WAMV, given))
        if each.name in OF_SURGE:
            assert each.identifiable
            assert abs(each.value - truth) < 0.5 * abs(before - truth)
        else:
            assert each.value == pytest.approx(before, rel=1e-3)
            assert not each.identifiable
            assert "turned" in each.doubt
            assert each.ci95[0] < min(truth, before) < max(truth, before) < each.ci95[1]
    assert not any(name in says for says in found.trade for name in ("m33", "N_r", "Y_v"))


def test_among_many_recordings_a_straight_one_has_no_say_in_how_the_boat_turns(straight):
    given = off(WAMV)
    found = fit_recording(straight, given, "", IdentifySettings())
    std = dict(zip(found.names, np.sqrt(np.diag(found.covariance)), strict=True))
    for name in BASE:
        before = abs(getattr(given.dynamics, name))
        assert bool(std[name] > before) is (name not in OF_SURGE)


def test_who_knows_a_number_is_believed_as_far_as_he_says(straight):
    known = IdentifySettings(priors={"N_r": 0.1})
    (rate,) = (e for e in identify([straight], WAMV, known).estimates if e.name == "N_r")
    assert rate.value == pytest.approx(WAMV.dynamics.N_r)
    assert max(abs(end - rate.value) for end in rate.ci95) < 0.3 * abs(rate.value)
