"""What data cannot tell is refused with the reason, and only that."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim.diagnosis.next_experiment import RecordingContent, Refusal, refusals
from sim.effects.catalogue import EFFECTS, named
from sim.effects.effect import Effect, Shown
from sim.model import Model
from sim.trial import Trial
from tests.sim.diagnosis.sailed import sailed
from tests.sim.voyages import WAM_V

MODEL = Model.of(WAM_V)


def refused(effects: Sequence[Effect], trial: Trial) -> list[Refusal]:
    return refusals(effects, RecordingContent.of(MODEL, [trial]), WAM_V)


def reasons(trial: Trial) -> dict[str, str]:
    return {r.effect: r.reason for r in refused(EFFECTS, trial)}


def test_a_rich_voyage_is_refused_only_what_the_vessel_lacks_and_nobody_measured() -> None:
    turning = sailed(seconds=300.0)
    eta = turning.eta.copy()
    eta[:, 2] = np.linspace(0.0, 20.0, len(eta))
    pwm = turning.pwm.copy()
    pwm[:100] = 1300.0
    rich = replace(turning, eta=eta, pwm=pwm)
    assert set(reasons(rich)) == {
        "steering_scale",
        "steering_offset",
        "steering_lag",
        "steering_play",
        "steering_rate",
        "battery_sag",
    }
    assert WAM_V.hull.wind_area == (0.0, 0.0)  # areas that nobody gave are assumed


def test_slow_commands_cannot_tell_a_lag() -> None:
    slow = replace(sailed(), rates_hz={"commands": 2.0, "velocity": 10.0})
    for name in ("thruster_lag", "command_delay", "velocity_latency"):
        assert "2.0 Hz" in reasons(slow)[name]


def test_a_receiver_of_five_hertz_may_give_a_little_less() -> None:
    nominal = replace(sailed(), rates_hz={"commands": 25.0, "velocity": 4.99})
    assert not {"velocity_latency", "thruster_lag"} & reasons(nominal).keys()
    slow = replace(nominal, rates_hz={"commands": 25.0, "velocity": 4.5})
    assert reasons(slow)["velocity_latency"] == "velocity at 4.5 Hz: 5 Hz are needed to tell it"


def test_who_never_went_astern_cannot_tell_a_loss_there() -> None:
    ahead = sailed()
    never = replace(ahead, pwm=np.maximum(ahead.pwm, 1500.0))
    assert "astern" in reasons(never)["reverse_loss"]
    assert "reverse_loss" not in reasons(replace(ahead, pwm=ahead.pwm - 300.0))


def test_an_effect_of_ones_own_is_refused_for_the_same_reasons() -> None:
    ahead = sailed()
    never = replace(ahead, pwm=np.maximum(ahead.pwm, 1500.0))
    own = replace(named("cubic_drag"), name="own", shown_by=(Shown.ASTERN, Shown.VOLTAGE))
    (one,) = refused([own], never)
    assert one.effect == "own"
    assert "astern" in one.reason
    (other,) = refused([own], replace(ahead, pwm=ahead.pwm - 300.0))
    assert "voltage" in other.reason


def test_one_heading_cannot_tell_the_compass() -> None:
    trial = sailed()
    eta = trial.eta.copy()
    eta[:, 2] = 0.3
    straight = reasons(replace(trial, eta=eta))
    assert {"compass_deviation", "steady_current", "heading_offset"} <= set(straight)


def test_a_short_voyage_cannot_tell_what_changes() -> None:
    assert "100 s" in reasons(sailed(seconds=100.0))["drag_growth"]


def test_each_reason_says_what_is_needed() -> None:
    for because in reasons(sailed(seconds=100.0)).values():
        assert len(because) > 20
    assert named("steering_lag").needs


def test_a_voltmeter_that_reads_zero_was_not_there() -> None:
    trial = sailed()
    assert "not measured" in reasons(replace(trial, voltage=np.zeros(len(trial))))["battery_sag"]
