"""Samples of a log become events; settings refuse what cannot be."""

import numpy as np
import pytest

from gateway.errors import BadInput
from gateway.estimation import (
    FIELD_OF_KIND,
    FilterSettings,
    MeasurementKind,
    WhiteNoise,
)
from gateway.estimation.events import from_samples, join, make_events
from gateway.estimation.gyro_delay import gyro_delay_s
from gateway.samples import Quantity, Samples

EPOCH = 1_700_000_000_000_000_000


def samples(quantity, source, order, values):
    order = np.asarray(order)
    time = EPOCH + order * 10_000_000
    return Samples(quantity, source, order, time, time, np.asarray(values, float))


def test_samples_become_events_in_the_order_of_the_log():
    columns = [
        samples(Quantity.YAW_RATE, "ATTITUDE", [0, 2], [[0.1], [0.2]]),
        samples(Quantity.YAW, "ATTITUDE", [0, 2], [[1.0], [1.1]]),
        samples(Quantity.VELOCITY, "LOCAL_POSITION_NED", [1], [[3.0, 4.0]]),
        samples(Quantity.VOLTAGE, "SYS_STATUS", [1], [[12.0]]),
    ]
    events = from_samples(columns, FilterSettings(), EPOCH)
    expected = [
        MeasurementKind.YAW,
        MeasurementKind.YAW_RATE,
        MeasurementKind.VELOCITY,
        MeasurementKind.YAW,
        MeasurementKind.YAW_RATE,
    ]
    assert events.kind.tolist() == expected
    np.testing.assert_allclose(events.time_s, [0.0, 0.0, 0.01, 0.02, 0.02])
    assert events.z[2].tolist() == [3.0, 4.0]
    assert events.std[2, 0] == FilterSettings().white_std(
        MeasurementKind.VELOCITY, "LOCAL_POSITION_NED"
    )


def test_no_samples_are_no_events():
    assert len(from_samples([], FilterSettings(), EPOCH)) == 0


def test_every_kind_has_a_std_and_an_unknown_source_the_default():
    assert set(FIELD_OF_KIND) == set(MeasurementKind) - {MeasurementKind.TICK}
    assert (
        FilterSettings().white_std(MeasurementKind.POSITION, "NEW_MESSAGE")
        == WhiteNoise().position_m
    )


@pytest.mark.parametrize(
    "wrong",
    [
        {"surge_tau_s": 0.0},
        {"max_late_s": -1.0},
        {"velocity_error_mps": float("nan")},
        {"gate_probability": 1.0},
        {"history_events": 1},
    ],
)
def test_settings_refuse_what_cannot_be(wrong):
    (name,) = wrong
    with pytest.raises(BadInput, match=name):
        FilterSettings(**wrong)


def test_delay_of_the_gyro_filter():
    assert gyro_delay_s(4.0) == pytest.approx(0.0563, abs=1e-4)
    told = FilterSettings().with_parameters({"INS_GYRO_FILTER": 4.0})
    assert told.gyro_delay_s == gyro_delay_s(4.0)
    chosen = FilterSettings(gyro_delay_s=0.01)
    assert chosen.with_parameters({"INS_GYRO_FILTER": 4.0}) is chosen
    assert gyro_delay_s(0.0) == 0.0
    assert FilterSettings(gyro_delay_s=0.0).kernel_model().gyro_delay_s == 0.0


def test_thinned_events_are_the_first_of_each_kind_in_each_step_of_time():
    yaw = make_events(MeasurementKind.YAW, np.array([0.0, 0.1, 0.6, 0.9]), np.arange(4.0), 0.1)
    place = make_events(MeasurementKind.POSITION, np.array([0.05, 1.2]), np.zeros((2, 2)), 1.0)
    kept = join([yaw, place]).thinned(2.0)
    assert kept.time_s.tolist() == [0.0, 0.6, 0.05, 1.2]
    assert kept.z[:2, 0].tolist() == [0.0, 2.0]
