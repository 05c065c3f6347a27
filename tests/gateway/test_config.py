"""gateway.toml: flags over file over defaults; every mistake is one line."""

import tomllib
from pathlib import Path

import pytest

from gateway.config import Settings, as_tables, as_toml, load_settings, settings_of
from gateway.errors import BadInput
from gateway.estimation import SOURCES
from gateway.links.rate_requests import FULL_HZ, RADIO_HZ
from gateway.recording.writer import Compression
from sim.following.follower import ControlLaw, ReferenceMode

EVERYTHING = """
[[boats]]
system_id = 1
vessel = "wam-v.toml"
plant = "otter.toml"
name = "wam-v"

[links]
endpoints = ["udpin:127.0.0.1:14550"]

[links.rates]
preset = "radio"
ATTITUDE = 12
RAW_IMU = 25.0

[filter]
gyro_delay_s = 0.02

[filter.sources.ATTITUDE]
yaw_rad = 0.03

[zenoh]
publish = false
endpoint = "tcp/127.0.0.1:9000"
config_file = "zenoh.json5"

[foxglove]
address = "0.0.0.0:8765"

[recording]
compression = "lz4"
rotate_seconds = 60

[following]
reference = "auto"
rate_hz = 20

[following.follower]
rate = 3.0
law = "printed"
limits = true

[studio]
tiles = "http://maps.local:8080/{Z}/{X}/{Y}.png"
attribution = "our own survey"
"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "gateway.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_without_a_file_the_defaults_stand(tmp_path: Path) -> None:
    assert load_settings(None) == Settings()
    assert load_settings(written(tmp_path, "")) == Settings()


def test_every_table_is_read(tmp_path: Path) -> None:
    found = load_settings(written(tmp_path, EVERYTHING))
    (boat,) = found.boats
    assert boat.system_id == 1
    assert (boat.vessel, boat.plant) == tuple(
        str(tmp_path / name) for name in ("wam-v.toml", "otter.toml")
    )  # as seen from the file
    assert found.links.endpoints == ("udpin:127.0.0.1:14550",)
    assert found.links.rates == {**RADIO_HZ, "ATTITUDE": 12.0, "RAW_IMU": 25.0}
    assert found.foxglove.address == "0.0.0.0:8765"
    assert found.filter.gyro_delay_s == 0.02
    assert (found.zenoh.publish, found.zenoh.bus().config_file) == (False, Path("zenoh.json5"))
    assert found.recording.compression is Compression.LZ4
    assert found.following.reference is ReferenceMode.AUTO
    assert found.studio.tile(3, 4, 5) == "http://maps.local:8080/3/4/5.png"
    assert found.studio.source == "asked of maps.local:8080"
    assert found.studio.attribution == "our own survey"
    assert found.following.follower.law is ControlLaw.PRINTED


def test_what_a_file_leaves_out_stays_as_it_was(tmp_path: Path) -> None:
    found, usual = load_settings(written(tmp_path, EVERYTHING)), Settings()
    assert found.recording.chunk_bytes == usual.recording.chunk_bytes
    assert found.following.follower.integral == usual.following.follower.integral
    assert found.filter.sources["ATTITUDE"].yaw_rad == 0.03
    assert found.filter.sources["ATTITUDE"].yaw_rate_radps == SOURCES["ATTITUDE"].yaw_rate_radps
    assert found.filter.sources["XKF1"] == SOURCES["XKF1"]


@pytest.mark.parametrize("text", ["", EVERYTHING])
def test_the_resolved_configuration_is_a_configuration(tmp_path: Path, text: str) -> None:
    resolved = load_settings(written(tmp_path, text))
    assert load_settings(written(tmp_path, as_toml(resolved))) == resolved
    tables = as_tables(resolved)
    assert settings_of(tables, "") == resolved
    assert tomllib.loads(as_toml(resolved)) == tables


def test_a_noise_that_nothing_reads_any_more_still_loads(tmp_path: Path) -> None:
    text = "[filter.sources.IMU]\nacceleration_mps2 = 0.5"
    assert load_settings(written(tmp_path, text)) == Settings()
    assert "acceleration_mps2" not in as_tables(Settings())["filter"]["sources"]["IMU"]


def test_a_rate_alone_leaves_the_others_as_they_were(tmp_path: Path) -> None:
    found = load_settings(written(tmp_path, "[links.rates]\nATTITUDE = 20\nGPS_RAW_INT = 0"))
    assert found.links.rates == {**FULL_HZ, "ATTITUDE": 20.0, "GPS_RAW_INT": 0.0}


def test_the_printed_configuration_tells_of_presets_and_players() -> None:
    text = as_toml(Settings())
    assert 'preset = "radio"' in text.partition("[links.rates]")[2].partition("\nATTITUDE")[0]
    assert "address" in text.partition("[foxglove]")[2].partition("\n[")[0]


MISTAKES = {
    '[studio]\ntiles = "https://maps.local/map.png"': "[studio] tiles",
    '[studio]\ntiles = "file:///{Z}/{X}/{Y}.png"': "expected an address like",
    "[studio]\ndeepest = 90": "[studio] deepest = 90",
    "[follow]": "unknown key follow",
    "[zenoh]\nport = 7447": "unknown key zenoh.port",
    "[filter]\nspeed = 1.0": "unknown key filter.speed",
    "[filter.sources]\nATTITUDE = 1.0": "filter.sources.ATTITUDE",
    "[filter.sources.ATTITUDE]\nroll = 1.0": "unknown key filter.sources.ATTITUDE.roll",
    "[[boats]]\nsystem_id = 1": "missing key boats[0].vessel",
    '[zenoh]\npublish = "yes"': "zenoh.publish = 'yes': input should be a valid boolean",
    '[following]\nrate_hz = "50"': "following.rate_hz = '50': input should be a valid number",
    "[following]\nrate_hz = 0": "[following] rate_hz = 0.0: expected 0.1 to 1000 Hz",
    '[following]\nreference = "both"': "following.reference = 'both': input should be 'measured'",
    "[following.follower]\nrate = -1.0": "rate must be above 0, at most 1000 1/s, not -1.0",
    "[filter]\ngyro_delay_s = 1e308": "[filter] gyro_delay_s = 1e+308: expected a positive",
    "[filter]\nhistory_events = 99999999": "[filter] history_events = 99999999: expected a posi",
    "[filter]\nmax_step_s = 1e-9": "[filter] max_step_s = 1e-09: expected a positive number, 0.001",
    "[filter.sources.ATTITUDE]\nyaw_rad = -1.0": "yaw_rad = -1.0: expected a positive number",
    "[following.follower]\nrate = 1e9": "rate must be above 0, at most 1000 1/s, not 1000000000.0",
    "[following]\nrate_hz = 1e9": "[following] rate_hz = 1000000000.0: expected 0.1 to 1000 Hz",
    "[filter]\nsurge_tau_s = 0.0": "[filter] surge_tau_s = 0.0: expected a positive number",
    '[recording]\ncompression = "rar"': "recording.compression = 'rar': input should be 'lz4', ",
    "[recording]\nfoxglove_hz = 0": "[recording] foxglove_hz = 0.0: expected a positive number",
    '[links]\nendpoints = "udp"': "links.endpoints = 'udp': input should be a valid array",
    "[links.rates]\nATITUDE = 5": "[links.rates] ATITUDE: there is no such MAVLink message",
    "[links.rates]\nATTITUDE = -1": "[links.rates] ATTITUDE = -1.0: expected Hz, 0 (not asked for)",
    '[links.rates]\nATTITUDE = "5"': "links.rates.ATTITUDE = '5': input should be a valid number",
    '[links.rates]\npreset = "slow"': "links.rates.preset = 'slow': expected full, radio",
    "[links]\nrates = 5": "links.rates = 5: input should be an object",
    '[foxglove]\naddress = "lab"': 'Foxglove server on "lab": expected [HOST:]PORT',
    "[foxglove]\naddress = 8765": "foxglove.address = 8765: input should be a valid string",
    "boats = 3": "boats = 3: input should be a valid array",
    "[zenoh": "not a TOML file",
}


@pytest.mark.parametrize("text", MISTAKES)
def test_a_mistake_is_one_line_with_key_and_what_was_expected(tmp_path: Path, text: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(BadInput) as caught:
        load_settings(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert MISTAKES[text] in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_is_no_configuration_is_said(tmp_path: Path) -> None:
    binary = tmp_path / "noise.toml"
    binary.write_bytes(b"\xff\xfe\x00\x01")
    for path, expected in (
        (tmp_path / "absent.toml", "cannot read the configuration: No such file"),
        (tmp_path, "cannot read the configuration: Is a directory"),
        (binary, "not a text file; the configuration is TOML"),
    ):
        with pytest.raises(BadInput, match=f"^{path}: {expected}"):
            load_settings(path)
