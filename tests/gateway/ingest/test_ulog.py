"""PX4's ULog: read as any other format, whatever is wrong with it."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gateway.errors import BadInput
from gateway.ingest.log import BoatSamples, choose_boat
from gateway.ingest.open import open_log
from gateway.ingest.sources import choose
from gateway.ingest.survey import survey
from gateway.ingest.ulog.log import UlogLog, ulog_from_bytes
from gateway.ingest.ulog.mapping import RULES
from gateway.samples import Quantity
from tests.gateway.ingest.ulog_writer import (
    MAGIC,
    TOPICS,
    UlogWriter,
    as_ulog,
    message,
    quaternion,
)

VOYAGE = Path(__file__).resolve().parents[3] / "recordings" / "voyage_1.tlog"
UTC_US = 1_700_000_000_000_000
RANDOM = settings(
    max_examples=100, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
)


def decoded(writer: UlogWriter) -> BoatSamples:
    log = ulog_from_bytes(writer.bytes())
    return log.decode(choose_boat(log))


def values(found: BoatSamples, quantity: Quantity, source: str) -> np.ndarray:
    (samples,) = [one for one in found.of(quantity) if one.source == source]
    return samples.values


def short_log() -> UlogWriter:
    """Ten seconds of heading and velocity, with GPS time from the third second on."""
    writer = UlogWriter()
    writer.parameter("MAV_TYPE", 11.0)
    for k in range(100):
        t = 1_000_000 + 100_000 * k
        writer.add("vehicle_attitude", t, *quaternion(0.01 * k, 0.1, -0.2))
        writer.add("vehicle_local_position", t + 10, 1.0, 2.0, 0.5, -0.5, 0.0, 0.0, 0.0, 1, 1, 0)
        if k % 10 == 0:
            utc = UTC_US + t if k >= 30 else 0
            writer.add("vehicle_gps_position", t + 20, utc + 20, 63.4, 10.4, 0.5, -0.5, 3, 1)
    return writer


@pytest.fixture(scope="module")
def voyage(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first shipped voyage as PX4 would have logged it."""
    path = tmp_path_factory.mktemp("ulog") / "voyage_1.ulg"
    path.write_bytes(as_ulog(VOYAGE).bytes())
    return path


def test_a_voyage_gives_the_same_trial_as_its_tlog(voyage: Path) -> None:
    """To the resolution of the log's single precision: 1e-5 in SI units."""
    from gateway.offline.trials import load_trials

    (radio,), (board,) = load_trials(VOYAGE), load_trials(voyage)
    assert board.sources["velocity"] == "vehicle_local_position"
    assert board.sources["yaw rate"] == "vehicle_angular_velocity"
    assert board.channels == radio.channels
    assert board.origin_deg == pytest.approx(radio.origin_deg, abs=1e-9)
    assert abs(board.start_time_ns - radio.start_time_ns) < 2000
    np.testing.assert_array_equal(board.usable, radio.usable)
    for name in ("pwm", "eta", "nu", "nu_dot", "voltage", "covariance"):
        mine, theirs = getattr(board, name), getattr(radio, name)
        np.testing.assert_allclose(mine, theirs, atol=1e-5, err_msg=name)


def test_survey_names_the_topics_and_stays_plain_json(voyage: Path) -> None:
    found = survey(open_log(voyage))
    (boat,) = found.boats
    assert found.kind == "ulog"
    assert str(boat.boat) == "system 0 (PX4 surface boat)"
    assert boat.firmware == "PX4 v1.14.3 (1dacb4cd)"
    assert boat.sources["yaw"].source == "vehicle_attitude"
    assert "vehicle_attitude" in boat.sources["yaw"].preference
    assert boat.sources["commands"].source == "actuator_outputs"
    assert boat.sources["fix"].source == "vehicle_gps_position"
    assert boat.unix_ahead_s == pytest.approx(0.0, abs=1e-3)
    assert found.messages["vehicle_attitude"].rate_hz == pytest.approx(20.0, rel=1e-2)
    assert json.loads(json.dumps(found.to_dict()))["kind"] == "ulog"


def test_rates_in_health_are_those_of_the_topics(voyage: Path) -> None:
    from gateway.shadow.health import LogHealth

    log = open_log(voyage)
    found = LogHealth.of(log, log.decode(choose_boat(log))).arrivals
    assert len(found["ATTITUDE"]) == 6155
    assert len(found["LOCAL_POSITION_NED"]) == 3847
    assert sum(map(len, found.values())) == log.statistics.accepted


def test_equivalents_are_known_sources_and_names_unique() -> None:
    from gateway.ingest.mavlink.mapping import BY_SOURCE

    assert len({rule.source for rule in RULES}) == len(RULES)
    assert {r.equivalent for r in RULES} - set(BY_SOURCE) <= {"GPS", "vehicle_acceleration"}


def test_quaternions_rates_and_validity() -> None:
    writer = UlogWriter()
    for k in range(3):
        t = 1_000_000 + k
        writer.add("vehicle_attitude", t, *quaternion(2.5, 0.1, -0.2))
        writer.add("vehicle_angular_velocity", t, 9.0, 9.0, 0.3)
        writer.add("vehicle_local_position", t, 1, 2, 3, 4, 0.5, 63.0, 10.0, k > 0, k > 1, k > 1)
    found = decoded(writer)
    assert values(found, Quantity.YAW, "vehicle_attitude") == pytest.approx(2.5, abs=1e-6)
    tilt = values(found, Quantity.TILT, "vehicle_attitude")[0]
    assert tilt == pytest.approx([0.1, -0.2], abs=1e-6)
    rate = values(found, Quantity.YAW_RATE, "vehicle_angular_velocity")
    assert rate == pytest.approx(0.3, abs=1e-6)
    assert values(found, Quantity.POSITION, "vehicle_local_position").tolist() == [[1.0, 2.0]] * 2
    assert values(found, Quantity.VELOCITY, "vehicle_local_position").tolist() == [[3.0, 4.0]]
    origin = values(found, Quantity.ORIGIN, "vehicle_local_position/origin")
    assert origin.tolist() == [[63.0, 10.0]]
    heading = values(found, Quantity.YAW, "vehicle_local_position/heading")
    assert heading == pytest.approx(0.5)


def test_older_names_of_fields_are_read_too() -> None:
    older = {
        "vehicle_attitude": "float pitchspeed;float yawspeed;float[4] q",
        "vehicle_local_position": (
            "float x;float y;float vx;float vy;float yaw;double ref_lat;double ref_lon;"
            "bool xy_valid;bool v_xy_valid;bool xy_global"
        ),
        "vehicle_global_position": "double lat;double lon;float vel_n;float vel_e",
        "vehicle_gps_position": (
            "uint64_t time_utc_usec;int32_t lat;int32_t lon;float vel_n_m_s;float vel_e_m_s;"
            "uint8_t fix_type;bool vel_ned_valid"
        ),
        "battery_status": "float voltage_filtered_v",
        "wind_estimate": "float windspeed_north;float windspeed_east",
    }
    writer = UlogWriter(topics=older)
    writer.add("vehicle_attitude", 1_000_000, 9.0, 0.25, *quaternion(1.0, 0.0, 0.0))
    writer.add("vehicle_local_position", 1_000_000, 1, 2, 3, 4, 0.5, 0.0, 0.0, 1, 1, 0)
    writer.add("vehicle_global_position", 1_000_000, 63.4, 10.4, 1.5, -0.5)
    place = (634_000_000, 104_000_000)
    writer.add("vehicle_gps_position", 1_000_000, UTC_US, *place, 1.0, 2.0, 3, 1)
    writer.add("battery_status", 1_000_000, 12.5)
    writer.add("wind_estimate", 1_000_000, 3.0, -4.0)
    found = decoded(writer)
    assert values(found, Quantity.YAW_RATE, "vehicle_attitude").tolist() == [[0.25]]
    assert values(found, Quantity.YAW, "vehicle_local_position/heading").tolist() == [[0.5]]
    assert values(found, Quantity.VELOCITY, "vehicle_global_position").tolist() == [[1.5, -0.5]]
    gps = values(found, Quantity.GLOBAL_POSITION, "vehicle_gps_position")
    assert gps == pytest.approx(np.array([[63.4, 10.4]]))
    assert values(found, Quantity.VOLTAGE, "battery_status").tolist() == [[12.5]]
    assert values(found, Quantity.WIND, "wind_estimate").tolist() == [[3.0, -4.0]]


def test_both_ports_of_outputs_speak_for_their_channels() -> None:
    writer = UlogWriter()
    writer.add("actuator_outputs", 1_000_000, 1600.0, *[0.0] * 15)
    writer.add("actuator_outputs", 1_000_000, 1700.0, *[0.0] * 15, instance=1)
    found = decoded(writer)
    main = values(found, Quantity.ACTUATORS, "actuator_outputs")[0]
    aux = values(found, Quantity.ACTUATORS, "actuator_outputs/1")[0]
    assert (main[0], aux[16]) == (1600.0, 1700.0)
    assert np.isnan(main[1:]).all()
    assert choose(found.samples)["commands"].source == "actuator_outputs"


def test_commands_of_motors_stand_for_pulses_where_there_are_none() -> None:
    writer = UlogWriter()
    for k in range(3):
        writer.add("actuator_outputs", 1_000_000 + k, *[0.5] * 16)  # a simulator: no pulses
        stopped = [np.nan] * 10
        writer.add("actuator_motors", 1_000_000 + k, 1.0, -0.5, *stopped)
    found = decoded(writer)
    assert choose(found.samples)["commands"].source == "actuator_motors"
    pulses = values(found, Quantity.ACTUATORS, "actuator_motors")[0]
    assert pulses[:3] == pytest.approx([1900.0, 1300.0, np.nan], nan_ok=True)


def test_the_instance_in_use_counts() -> None:
    writer = UlogWriter()
    writer.add("battery_status", 1_000_000, 11.0, instance=2)
    writer.add("battery_status", 1_000_000, 12.0, instance=1)
    assert values(decoded(writer), Quantity.VOLTAGE, "battery_status").tolist() == [[12.0]]


def test_times_are_unix_times_by_the_gps() -> None:
    log = ulog_from_bytes(short_log().bytes())
    assert log.table("vehicle_attitude").receive_time_ns[0] == (UTC_US + 1_000_000) * 1000
    assert log.statistics.notes == ()
    (yaw, *_) = log.decode(choose_boat(log)).of(Quantity.YAW)
    np.testing.assert_array_equal(yaw.vehicle_time_ns, yaw.receive_time_ns)


def test_without_gps_time_counts_from_boot() -> None:
    writer = UlogWriter()
    writer.add("battery_status", 5_000_000, 12.0)
    log = ulog_from_bytes(writer.bytes())
    assert log.table("battery_status").receive_time_ns.tolist() == [5_000_000_000]
    assert any("no GPS time" in note for note in log.statistics.notes)


def test_order_is_that_of_time_over_all_topics() -> None:
    log = ulog_from_bytes(short_log().bytes())
    orders = np.concatenate([log.table(name).order for name in log.counts()])
    assert sorted(orders.tolist()) == list(range(log.statistics.accepted))
    assert log.table("vehicle_attitude").order[:2].tolist() == [0, 3]
    assert len(log.table("nothing")) == 0


def test_parameters_are_those_of_the_end() -> None:
    writer = short_log()
    writer.parameter("GND_SPEED_MAX", 2.5)
    writer.changed_parameter(3_000_000, "GND_SPEED_MAX", 3)
    log = ulog_from_bytes(writer.bytes())
    found = log.parameters(choose_boat(log))
    assert found == {"MAV_TYPE": 11.0, "GND_SPEED_MAX": 3.0}
    assert log.boats()[0].type == "surface boat"


def test_dropouts_are_told() -> None:
    writer = short_log()
    for k, duration in enumerate((120, 450)):
        writer.dropout(2_000_000 + k, duration)
    (note,) = ulog_from_bytes(writer.bytes()).statistics.notes
    assert note == ("the logger dropped data 2 time(s), 0.6 s together, 0.5 s at the longest")


def test_a_cut_tail_is_told_and_the_rest_read() -> None:
    raw = short_log().bytes()
    whole, cut = ulog_from_bytes(raw), ulog_from_bytes(raw[:-5])
    assert not whole.statistics.truncated_tail
    assert cut.statistics.truncated_tail
    assert cut.statistics.accepted == whole.statistics.accepted - 1


def test_an_impossible_time_is_refused() -> None:
    writer = short_log()
    writer.rows.append((4_000_000, writer.rows[0][1][:5] + b"\xff" * 8 + writer.rows[0][1][13:]))
    log = ulog_from_bytes(writer.bytes())
    assert log.counts()["vehicle_attitude"] == 100
    assert any("1 message(s) with an impossible time" in note for note in log.statistics.notes)


def test_damage_in_the_middle_loses_little() -> None:
    raw = bytearray(short_log().bytes())
    at = len(raw) // 2
    raw[at : at + 40] = bytes(40)
    log = ulog_from_bytes(bytes(raw))
    assert log.statistics.accepted > 180
    assert any("damaged" in note for note in log.statistics.notes)


def empty() -> bytes:
    return UlogWriter().bytes()


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"ULog", "ends inside its header"),
        (b"ULog" + bytes(100), "header is damaged"),
        (MAGIC + bytes(9) + message("B", bytes(8) + b"\x02" + bytes(31)), "flag that is not known"),
        (empty(), "holds no data"),
        (empty()[:20], "holds no data"),
        (empty() + bytes(5000), "holds no data"),
        (empty() + message("F", b"x:uint64_t timestamp;") + b"\xff\xffz", "holds no data"),
    ],
)
def test_what_holds_nothing_gets_one_clear_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: bytes, says: str
) -> None:
    path = tmp_path / "log.ulg"
    path.write_bytes(content)
    with pytest.raises(BadInput, match=says) as raised:
        open_log(path)
    assert str(path) in str(raised.value)
    assert "\n" not in str(raised.value)
    assert capsys.readouterr().out == ""


@pytest.mark.slow
@RANDOM
@given(st.data())
def test_damaged_logs_end_in_a_log_or_in_one_line(data: st.DataObject) -> None:
    raw = bytearray(short_log().bytes()[:3000])
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(raw) - 1))
        patch = data.draw(st.binary(max_size=30))
        raw[at : at + data.draw(st.integers(0, 30))] = patch
        if not raw:
            return
    try:
        log: UlogLog = ulog_from_bytes(bytes(raw))
    except BadInput:
        return
    for name, count in log.counts().items():
        assert len(log.table(name)) == count
    survey(log)


def test_content_decides_and_not_the_name(tmp_path: Path) -> None:
    path = tmp_path / "log.tlog"
    path.write_bytes(short_log().bytes())
    assert open_log(path).kind == "ulog"


def test_the_writer_is_read_back_by_pyulog_itself() -> None:
    """The test log is a ULog, and not only what the reader here takes for one."""
    import io

    from pyulog import ULog

    found = ULog(io.BytesIO(short_log().bytes()))
    assert not found.file_corruption
    assert {one.name for one in found.data_list} <= set(TOPICS)
