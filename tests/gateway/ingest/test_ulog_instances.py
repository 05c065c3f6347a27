"""Instances of a topic of PX4: drivers of outputs, receivers, batteries, EKFs."""

from pathlib import Path

import numpy as np
import pytest

from gateway.errors import BadInput
from gateway.ingest.log import BoatSamples, Log, choose_boat
from gateway.ingest.log_events import log_events
from gateway.ingest.mapping import EstimatorFault
from gateway.ingest.open import open_log
from gateway.ingest.sources import choose
from gateway.ingest.survey import survey
from gateway.ingest.ulog.log import ulog_from_bytes
from gateway.samples import Quantity
from tests.gateway.ingest.ulog_writer import TOPICS, UlogWriter, quaternion

SECOND = 1_000_000
NAN = float("nan")
EMPTY = [0.0] * 14
WELL = 0x3F  # all bits of solution_status_flags that a healthy filter sets


def decoded(writer: UlogWriter) -> BoatSamples:
    log = ulog_from_bytes(writer.bytes())
    return log.decode(choose_boat(log))


def driven(*instances: tuple[int, float, float], motors: bool = True) -> UlogWriter:
    """Drivers that put out values from … to … on two channels, and the commands behind them."""
    writer = UlogWriter()
    for k in range(100):
        t, share = SECOND + k * 50_000, k / 99
        for instance, low, high in instances:
            up, down = low + share * (high - low), high - share * (high - low)
            writer.add("actuator_outputs", t, up, down, *EMPTY, instance=instance)
        if motors:
            writer.add("actuator_motors", t, 2 * share - 1, 1 - 2 * share, *[NAN] * 10)
    return writer


@pytest.mark.parametrize(
    ("low", "high", "timer"),
    [
        (0.0, 1000.0, None),  # Gazebo
        (500.0, 900.0, None),  # … a boat that never goes astern nor full ahead
        (0.0, 8191.0, None),  # CAN
        (1.0, 1999.0, None),  # DShot
        (1001.0, 1999.0, -3.0),  # … of both directions, ahead alone
        (-1.0, 1.0, None),  # a simulator
    ],
)
def test_outputs_that_are_no_pulses_are_not_read_as_such(
    low: float, high: float, timer: float | None
) -> None:
    writer = driven((0, low, high))
    if timer is not None:
        writer.parameter("PWM_MAIN_TIM0", timer)
    found = decoded(writer)
    assert choose(found.samples)["commands"].source == "actuator_motors"
    (notice,) = found.notices
    assert "no pulses: the commands of actuator_motors are read instead" in notice


@pytest.mark.parametrize(("low", "high"), [(1000.0, 2000.0), (800.0, 2200.0), (1100.0, 1900.0)])
def test_pulses_stay_pulses(low: float, high: float) -> None:
    writer = driven((0, low, high))
    writer.parameter("PWM_MAIN_TIM0", 50.0)
    writer.parameter("PWM_MAIN_TIM1", -3.0)  # a group beside it
    found = decoded(writer)
    assert choose(found.samples)["commands"].source == "actuator_outputs"
    assert found.notices == ()


def test_one_damaged_value_does_not_make_another_driver() -> None:
    writer = driven((0, 1000.0, 2000.0))
    for k in range(200):
        writer.add("actuator_outputs", 10 * SECOND + k, 1500.0, 1500.0, *EMPTY)
    writer.add("actuator_outputs", 11 * SECOND, 9e9, -3.0, *EMPTY)
    writer.add("actuator_outputs", 12 * SECOND, 1500.0, 1500.0, 3e-43, *EMPTY[1:])  # nothing there
    assert choose(decoded(writer).samples)["commands"].source == "actuator_outputs"


def test_pulses_beside_a_driver_without_are_told_to_be_left_out() -> None:
    """Motors by CAN and a rudder by pulses: the channels of both would be mixed up."""
    writer = driven((0, 1000.0, 2000.0), (1, 0.0, 8191.0))
    writer.add("actuator_servos", SECOND, 0.5, *[NAN] * 7)
    found = decoded(writer)
    assert not [s for s in found.of(Quantity.ACTUATORS) if s.equivalent == "SERVO_OUTPUT_RAW"]
    (notice,) = found.notices
    assert notice.startswith("instance 1 of actuator_outputs holds")
    assert "actuator_motors and actuator_servos are read instead" in notice


def test_without_other_commands_a_refusal_says_what_was_not_read(tmp_path: Path) -> None:
    from gateway.offline.trials import load_trials

    writer = driven((0, 0.0, 1000.0), motors=False)
    for k in range(100):
        t = SECOND + k * 50_000
        writer.add("vehicle_attitude", t, *quaternion(0.0, 0.0, 0.0))
        writer.add("vehicle_local_position", t, 1, 2, 0.5, 0, 0, 63.0, 10.0, 1, 1, 1)
    path = tmp_path / "a.ulg"
    path.write_bytes(writer.bytes())
    with pytest.raises(
        BadInput, match=r"no servo outputs.*which are no pulses.*no actuator_motors"
    ):
        load_trials(path)


@pytest.mark.parametrize(
    ("instances", "blocks", "told"),
    [
        ((0, 1), {0: 1, 1: 17}, ()),
        ((1,), {1: 17}, ()),
        ((2,), {2: 1}, ("instance 2 of actuator_outputs stands as channels 1 to 16",)),
        ((0, 3), {0: 1, 3: 17}, ("instance 3 of actuator_outputs stands as channels 17 to 32",)),
        ((0, 1, 2), {0: 1, 1: 17}, (
            "instance 2 of actuator_outputs is not read: there are channels for 2 instances only",
        )),
    ],
)  # fmt: skip
def test_every_instance_of_outputs_is_read_or_told(
    instances: tuple[int, ...], blocks: dict[int, int], told: tuple[str, ...]
) -> None:
    found = decoded(driven(*((one, 1000.0, 2000.0) for one in instances)))
    ports = [s for s in found.of(Quantity.ACTUATORS) if s.equivalent == "SERVO_OUTPUT_RAW"]
    assert {s.source: s.channels[0] for s in ports} == {
        "actuator_outputs" + (f"/{one}" if one else ""): first for one, first in blocks.items()
    }
    for samples in ports:
        assert np.isfinite(samples.values[:, samples.channels[0] - 1]).all()
    assert found.notices == told


def test_an_instance_that_puts_nothing_out_needs_no_channels() -> None:
    writer = driven((2, 1000.0, 2000.0))
    for instance in (0, 1):
        writer.add("actuator_outputs", SECOND, *[0.0] * 16, instance=instance)
    ports = [s.source for s in decoded(writer).of(Quantity.ACTUATORS)]
    assert ports == ["actuator_outputs/2", "actuator_motors"]


def receivers(*fixes: tuple[int, ...]) -> UlogWriter:
    """Receivers that have these fixes, one after the other, at other places each."""
    writer = UlogWriter()
    for instance, of_one in enumerate(fixes):
        for k, fix in enumerate(of_one):
            where = 63.0 + instance
            writer.add("sensor_gps", SECOND * (1 + k), 0, where, 10.0, 0, 0, fix, 1,
                       instance=instance)  # fmt: skip
    return writer


@pytest.mark.parametrize("fixes", [((0,) * 5, (3,) * 5), ((0,) * 5, (1,) * 5, (3, 4, 4, 3, 3))])
def test_a_receiver_with_a_fix_is_read_whatever_its_number(fixes: tuple[tuple[int, ...]]) -> None:
    found = decoded(receivers(*fixes))
    chosen = choose(found.samples)
    assert (chosen["fix"].samples.values[-4:, 0] >= 3).all()
    assert chosen["position"].samples.values[0, 0] == 63.0 + len(fixes) - 1


def test_of_two_receivers_the_better_one_counts_at_each_moment() -> None:
    chosen = choose(decoded(receivers((3, 3, 0, 0), (0, 3, 3, 3))).samples)
    fix = chosen["fix"].samples
    at = np.searchsorted(fix.vehicle_time_ns, np.arange(1, 5) * 10**9, side="right") - 1
    assert fix.values[at, 0].tolist() == [3.0] * 4
    assert chosen["position"].samples.values[0, 0] == 64.0


def test_a_battery_that_measures_nothing_hides_no_other() -> None:
    writer = UlogWriter()
    writer.add("battery_status", SECOND, 0.0, instance=0)
    writer.add("battery_status", SECOND, 12.0, instance=1)
    assert choose(decoded(writer).samples)["voltage"].samples.values.tolist() == [[12.0]]


def estimator(
    writer: UlogWriter, k: int, flags: int = WELL, faults: int = 0, rejected: int = 0,
    ratio: float = 0.1, instance: int = 0,
) -> None:  # fmt: skip
    """A report at second k."""
    row = (faults, ratio, 0.1, NAN, rejected, flags)
    writer.add("estimator_status", SECOND * (1 + k), *row, instance=instance)


@pytest.mark.parametrize(
    ("report", "fault"),
    [
        ({}, EstimatorFault(0)),
        ({"ratio": 0.75}, EstimatorFault(0)),  # of roots: not squared once more
        ({"ratio": 0.9}, EstimatorFault.REJECTS),
        ({"rejected": 1 << 6}, EstimatorFault.REJECTS),
        ({"rejected": 1 << 2}, EstimatorFault(0)),  # the height
        ({"faults": 1 << 12}, EstimatorFault.REJECTS),
        ({"faults": 1 << 5}, EstimatorFault(0)),  # airspeed
        ({"flags": WELL & ~1}, EstimatorFault.ATTITUDE),
        ({"flags": WELL | 1 << 10}, EstimatorFault.GLITCH),
        ({"flags": WELL | 1 << 7}, EstimatorFault(0)),  # at rest
        ({"flags": WELL & ~0x18}, EstimatorFault.POSITION),
        ({"faults": 1 << 10}, EstimatorFault(0)),  # since v1.15 the vertical accelerometer
    ],
)
def test_what_the_ekf_says_of_itself_is_read(report: dict[str, float], fault: int) -> None:
    writer = UlogWriter()
    estimator(writer, 0, **report)
    (samples,) = decoded(writer).of(Quantity.ESTIMATOR)
    assert samples.values.tolist() == [[float(fault)]]


def test_the_newer_name_of_the_heading_and_the_flags_alone_are_read() -> None:
    newer = TOPICS["estimator_status"].replace("mag_test", "hdg_test")
    flags = "cs_tilt_align cs_yaw_align reject_hor_vel reject_hor_pos reject_yaw fs_bad_hdg"
    flags += " fs_bad_vel_n fs_bad_vel_e fs_bad_pos_n fs_bad_pos_e"
    only_flags = ";".join(f"bool {name}" for name in flags.split())
    writer = UlogWriter(topics={"estimator_status": newer, "estimator_status_flags": only_flags})
    estimator(writer, 0, ratio=2.0)
    writer.add("estimator_status_flags", SECOND, 1, 1, *[0] * 8)
    writer.add("estimator_status_flags", SECOND * 2, 1, 1, 0, 0, 1, *[0] * 5)
    writer.add("estimator_status_flags", SECOND * 3, 1, 0, *[0] * 8)
    status, told = decoded(writer).of(Quantity.ESTIMATOR)
    assert status.values.tolist() == [[16.0]]
    assert told.values.tolist() == [[0.0], [16.0], [1.0]]


def test_the_flags_of_newer_firmware_are_read_which_lack_velocity_and_position() -> None:
    flags = "cs_tilt_align cs_yaw_align fs_bad_hdg reject_hor_vel reject_hor_pos reject_yaw"
    only_flags = ";".join(f"bool {name}" for name in flags.split())
    writer = UlogWriter(topics={"estimator_status_flags": only_flags})
    writer.add("estimator_status_flags", SECOND, 1, 1, 0, 0, 0, 0)
    writer.add("estimator_status_flags", SECOND * 2, 1, 1, 1, 0, 0, 0)
    found = decoded(writer)
    assert found.notices == ()
    (told,) = found.of(Quantity.ESTIMATOR)
    assert told.values.tolist() == [[0.0], [16.0]]


def test_a_stopped_output_of_the_simulated_driver_has_no_pulse() -> None:
    writer = UlogWriter()
    writer.add("actuator_outputs", SECOND, 1700.0, 900.0, *[900.0] * 14)
    writer.add("actuator_outputs", 2 * SECOND, 900.0, 1250.0, *[900.0] * 14)
    (pulses,) = decoded(writer).of(Quantity.ACTUATORS)
    assert pulses.values[:, 0] == pytest.approx([1700.0, NAN], nan_ok=True)
    assert pulses.values[:, 1] == pytest.approx([NAN, 1250.0], nan_ok=True)
    assert not np.isfinite(pulses.values[:, 2:]).any()


def test_a_report_without_the_state_of_the_solution_tells_the_rest() -> None:
    fields = TOPICS["estimator_status"].replace(";uint16_t solution_status_flags", "")
    writer = UlogWriter(topics={"estimator_status": fields})
    writer.add("estimator_status", SECOND, 0, 0.1, 0.1, 0.1, 0)
    writer.add("estimator_status", 2 * SECOND, 0, 0.9, 0.1, 0.1, 0)
    (samples,) = decoded(writer).of(Quantity.ESTIMATOR)
    assert samples.values.tolist() == [[0.0], [16.0]]


def test_the_ekf_in_use_counts_and_its_switches_are_told() -> None:
    writer = UlogWriter()
    for k in range(20):
        writer.add("estimator_selector_status", SECOND * (1 + k) - 10, 0 if k < 10 else 1)
        estimator(writer, k, 0x400 if k >= 10 else WELL)
        estimator(writer, k, 0x400 if k < 10 else WELL, instance=1)
    log = ulog_from_bytes(writer.bytes())
    found = log.decode(choose_boat(log))
    (samples,) = found.of(Quantity.ESTIMATOR)
    assert samples.values.tolist() == [[0.0]] * 20
    (switch,) = found.lane_switches
    assert (switch.before, switch.after) == (0, 1)
    assert "switches from lane 0 to lane 1 at 10 s" in found.notices[0]


def events(log: Log) -> list[str]:
    return [one.text for one in log_events(log, choose_boat(log))]


def test_time_with_an_ill_ekf_judges_no_model_and_is_an_event(tmp_path: Path) -> None:
    from gateway.offline.trials import load_trials

    writer = driven((0, 1200.0, 2000.0))
    for k in range(100 * 20):
        t = SECOND + k * 50_000
        writer.add("vehicle_attitude", t, *quaternion(0.0, 0.0, 0.0))
        writer.add("vehicle_local_position", t, 0.05 * k, 2, 1.0, 0, 0, 63.0, 10.0, 1, 1, 1)
        writer.add("actuator_outputs", t + 20_000, 1700.0, 1700.0, *EMPTY)
        if k % 20 == 0:
            writer.add("vehicle_status", t, 2, 11, 3)
            estimator(writer, k // 20, WELL if not 30 <= k // 20 < 60 else 0x400)
    path = tmp_path / "a.ulg"
    path.write_bytes(writer.bytes())
    (trial,) = load_trials(path)
    (ill,) = [one for one in trial.excluded if "EKF" in one.why]
    assert (ill.start, ill.end) == pytest.approx((30.0, 64.5), abs=1.5)
    assert "the autopilot's EKF is healthy again" in events(open_log(path))
    assert "estimator" in survey(open_log(path)).boats[0].sources
