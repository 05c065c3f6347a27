"""What a service needs of `shadow live`: lines for programs, metrics, a unit that starts it."""

import configparser
import json
import re
import shlex
import signal
import socket
import subprocess
import time
import urllib.request
from pathlib import Path

import orjson
import pytest
from prometheus_client.parser import text_string_to_metric_families
from typer.testing import CliRunner

from gateway.cli import app
from gateway.errors import BadInput, ShadowError
from gateway.links import LinkCounts
from gateway.live.outputs import HEALTH, Metrics
from gateway.long_running import LogFormat, LogLine, print_line
from gateway.simulated_boat.play import playing
from gateway.topics import TOPICS, FieldType
from tests.conftest import ROOT
from tests.gateway.pipelines.running import boat, free_port, program, wait

UNIT, CONTAINER = ROOT / "deploy" / "shadow-live.service", ROOT / "deploy" / "Containerfile"
BLUEOS = ROOT / "deploy" / "blueos.Containerfile"


def health(unfit: str = "", loss: float = 0.25) -> bytes:
    row: dict[str, object] = {
        f.name: "" if f.type is FieldType.STRING else 1 for f in TOPICS["health"].fields
    }
    return orjson.dumps({**row, "unfit": unfit, "loss": loss})


def scraped(metrics: Metrics) -> dict[tuple[str, tuple[str, ...]], float]:
    """(name, values of labels) -> value, as another program reads them."""
    with urllib.request.urlopen(f"http://127.0.0.1:{metrics.port}/metrics") as answer:
        families = text_string_to_metric_families(answer.read().decode())
    return {
        (sample.name, tuple(sample.labels.values())): sample.value
        for family in families
        for sample in family.samples
    }


def test_metrics_say_what_health_and_the_links_say() -> None:
    counts = LinkCounts(frames=7)
    with Metrics("0", lambda: {"udpin:x": vars(counts)}, lambda: 3) as metrics:
        assert ("shadow_health_loss", ("otter",)) not in scraped(metrics)
        metrics.health("otter", health())
        metrics.health("teal", health(unfit="the GPS has no 3-D fix", loss=0.5))
        found = scraped(metrics)
        assert found["shadow_health_loss", ("otter",)] == 0.25
        assert found["shadow_health_loss", ("teal",)] == 0.5
        assert [found["shadow_unfit", (name,)] for name in ("otter", "teal")] == [0.0, 1.0]
        assert 0.0 <= found["shadow_health_age_seconds", ("otter",)] < 5.0
        assert found["shadow_link_frames_total", ("udpin:x",)] == 7.0
        assert found["shadow_faults_total", ()] == 3.0
        for field in HEALTH:
            assert (f"shadow_health_{field.name}", ("otter",)) in found
        assert "for this machine" in metrics.text


def test_an_address_that_is_taken_or_none_is_one_line() -> None:
    with Metrics("0", dict, lambda: 0) as first:
        taken = Metrics(str(first.port), dict, lambda: 0)
        with pytest.raises(ShadowError, match="another program"), taken:
            pass
    with pytest.raises(BadInput, match=r'metrics on "nowhere": expected \[HOST:\]PORT'):
        Metrics("nowhere", dict, lambda: 0)


def test_a_line_for_programs_has_time_level_kind_vessel_and_message(
    capsys: pytest.CaptureFixture[str],
) -> None:
    print_line(LogLine("otter: \x1b[2Jbad", "warning", "sensor_failed", "otter"), LogFormat.JSON)
    print_line("plain", LogFormat.JSON)
    print_line(LogLine("for people", "error"))
    first, second, third = capsys.readouterr().err.splitlines()
    found = json.loads(first)
    assert found.pop("time").endswith("Z")
    assert found == {
        "level": "warning", "kind": "sensor_failed", "vessel": "otter",
        "message": "otter: \\x1b[2Jbad",
    }  # fmt: skip
    assert json.loads(second)["level"] == "info"
    assert third == "for people"


@pytest.mark.alone
def test_a_running_gateway_logs_json_and_serves_metrics(tmp_path: Path) -> None:
    port = free_port(socket.SOCK_STREAM)
    with (
        program(tmp_path, "--log", "json", "--metrics", str(port)) as live,
        playing([boat()], f"udpout:127.0.0.1:{live.port}"),
    ):
        wait(lambda: live.says("the first estimate is there"))

        def rate() -> float:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics") as answer:
                lines = answer.read().decode().splitlines()
            values = [
                line.rpartition(" ")[2]
                for line in lines
                if line.startswith("shadow_health_rate_hz{")
            ]
            return float(values[0]) if values else 0.0

        wait(lambda: rate() > 50.0)
        time.sleep(0.2)
        live.end(signal.SIGTERM)
    lines = [json.loads(line) for line in live.told]
    assert {"level", "kind", "vessel", "message", "time"} == set(lines[0])
    (started,) = [line for line in lines if line["kind"] == "started"]
    assert (started["vessel"], started["level"]) == ("wam-v", "info")


def exec_start() -> list[str]:
    unit = configparser.ConfigParser(strict=False, interpolation=None)
    unit.optionxform = str  # type: ignore[assignment, method-assign]
    unit.read(UNIT)
    return shlex.split(unit["Service"]["ExecStart"])


def container_command(file: Path) -> list[str]:
    text = file.read_text("utf-8").replace("\\\n", "")
    (line,) = [line for line in text.splitlines() if line.startswith("CMD ")]
    return list(json.loads(line.removeprefix("CMD ")))


@pytest.mark.parametrize(
    "arguments", [exec_start()[1:], container_command(CONTAINER), container_command(BLUEOS)]
)
def test_unit_and_container_start_the_command_with_options_that_exist(
    arguments: list[str],
) -> None:
    """It gets as far as the configuration, which is not on this machine."""
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code != 0
    assert "No such option" not in done.output
    assert "gateway.toml" in f"{done.output} {done.exception}"


def test_the_labels_of_the_blueos_extension_are_those_that_its_store_reads() -> None:
    """Label by label as its repository documents them, with what `docker build` puts in."""
    text = BLUEOS.read_text("utf-8").replace("\\\n", "")
    given = dict(re.findall(r'^ARG (\w+)="?([^"\n]*)"?$', text, re.MULTILINE))
    labels = {}
    for line in text.splitlines():
        if line.startswith("LABEL "):
            name, value = shlex.split(line.removeprefix("LABEL "))[0].split("=", 1)
            labels[name] = re.sub(r"\$\{(\w+)\}", lambda found: given[found[1]], value)
    assert re.fullmatch(r"\d+\.\d+\.\d+", labels["version"])
    assert labels["type"] in ("device-integration", "example", "tool", "other")
    host = json.loads(labels["permissions"])["HostConfig"]
    assert host == {"NetworkMode": "host", "Binds": ["/usr/blueos/extensions/shadow:/data"]}
    assert {"name", "email"} == set(json.loads(labels["authors"])[0])
    assert {"name", "email", "about"} == set(json.loads(labels["company"]))
    assert json.loads(labels["links"])["website"].startswith("https://")
    assert all(re.fullmatch(r"[a-z0-9-]+", tag) for tag in json.loads(labels["tags"]))
    bound = host["Binds"][0].split(":")[1]
    assert all(word.startswith(bound) for word in container_command(BLUEOS) if "/" in word)


def test_systemd_takes_the_unit(tmp_path: Path) -> None:
    try:
        done = subprocess.run(
            ["systemd-analyze", "verify", "--man=no", str(UNIT)], capture_output=True, text=True,
            timeout=60.0,
        )  # fmt: skip
    except FileNotFoundError:
        pytest.skip("no systemd-analyze here")
    complaints = [line for line in done.stderr.splitlines() if "shadow-live.service" in line]
    assert not [line for line in complaints if "is not executable" not in line], complaints
