"""The example files for TLS work between two processes, and keep strangers out."""

import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from gateway.bus import Bus, BusSettings
from gateway.errors import ShadowError
from gateway.monitor import join_bus
from tests.conftest import ROOT
from tests.gateway.voyages import rows_of

SHADOW = "from gateway.cli import run; run()"
CONFIGS = ROOT / "configs"
PAYLOAD = rows_of("measured", 1).payloads[0]

pytestmark = pytest.mark.skipif(
    shutil.which("openssl") is None, reason="no openssl command to make certificates with"
)


def openssl(*words: str, folder: Path) -> None:
    subprocess.run(["openssl", *words], cwd=folder, check=True, capture_output=True)


def authority(folder: Path, name: str) -> None:
    """A certificate authority of one's own: name.key, name.pem."""
    openssl(
        "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
        "-days", "2", "-subj", f"/CN={name}", "-keyout", f"{name}.key", "-out", f"{name}.pem",
        folder=folder,
    )  # fmt: skip


def certificate(folder: Path, name: str, ca: str) -> None:
    """A certificate for localhost, signed by `ca`."""
    (folder / "names.txt").write_text("subjectAltName=DNS:localhost,IP:127.0.0.1\n")
    openssl(
        "req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
        "-subj", f"/CN={name}", "-keyout", f"{name}.key", "-out", f"{name}.csr", folder=folder,
    )  # fmt: skip
    openssl(
        "x509", "-req", "-in", f"{name}.csr", "-CA", f"{ca}.pem", "-CAkey", f"{ca}.key",
        "-CAcreateserial", "-days", "2", "-extfile", "names.txt", "-out", f"{name}.pem",
        folder=folder,
    )  # fmt: skip


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Throw-away certificates: gateway and watcher of one authority, a stranger of another."""
    folder = tmp_path_factory.mktemp("keys")
    for ca, names in {"ca": ("gateway", "watcher"), "other": ("stranger",)}.items():
        authority(folder, ca)
        for name in names:
            certificate(folder, name, ca)
    return folder


@pytest.fixture
def endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tls/localhost:{probe.getsockname()[1]}"


def filled(example: str, keys: Path, endpoint: str, out: Path) -> Path:
    """An example of configs/ with the places of this test in it."""
    text = (CONFIGS / example).read_text("utf-8")
    for place in ("tls/0.0.0.0:7448", "tls/boat.local:7448"):
        text = text.replace(place, endpoint)
    path = out / example
    path.write_text(text.replace("/etc/shadow", str(keys)))
    return path


@pytest.mark.alone
def test_two_processes_meet_over_tls(keys: Path, endpoint: str, tmp_path: Path) -> None:
    gateway = filled("zenoh-tls.json5", keys, endpoint, tmp_path)
    watcher = filled("zenoh-tls-watch.json5", keys, endpoint, tmp_path)
    command = [sys.executable, "-c", SHADOW, "monitor", "--once", "--json"]
    with Bus("otter", settings=BusSettings(config_file=gateway)) as bus:
        bus.publish("measured", PAYLOAD)
        seen = subprocess.run(
            [*command, "--config", str(watcher)], cwd=ROOT, capture_output=True, text=True,
            timeout=60.0,
        )  # fmt: skip
    assert seen.returncode == 0, seen.stderr
    assert '"vessel":"otter","alive":true' in seen.stdout
    assert PAYLOAD.decode() in seen.stdout


@pytest.mark.parametrize("trusts", ["ca", "other"])
def test_a_stranger_is_kept_out(trusts: str, keys: Path, endpoint: str, tmp_path: Path) -> None:
    gateway = filled("zenoh-tls.json5", keys, endpoint, tmp_path)
    watcher = filled("zenoh-tls-watch.json5", keys, endpoint, tmp_path)
    text = watcher.read_text().replace("watcher", "stranger").replace("ca.pem", f"{trusts}.pem")
    watcher.write_text(text)
    with Bus("otter", settings=BusSettings(config_file=gateway)), pytest.raises(ShadowError):
        join_bus("", watcher)


def test_without_tls_nobody_gets_in(keys: Path, endpoint: str, tmp_path: Path) -> None:
    gateway = filled("zenoh-tls.json5", keys, endpoint, tmp_path)
    with Bus("otter", settings=BusSettings(config_file=gateway)):
        assert join_bus(endpoint.replace("tls/localhost", "tcp/127.0.0.1"), None) is None
