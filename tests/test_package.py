"""What a wheel holds: installed anywhere, away from the repository, the program is whole."""

import os
import subprocess
import sys
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
WHERE = "import gateway, sim; print(gateway.__file__); print(sim.__file__)"
SHADOW = "from gateway.cli import run; run()"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel of this checkout."""
    out = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation",
         "--disable-pip-version-check", "--wheel-dir", str(out), str(ROOT)],
        check=True,
    )  # fmt: skip
    return next(out.glob("*.whl"))


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel alone, unpacked where only its own files are; its dependencies are those here."""
    target = tmp_path_factory.mktemp("installed")
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(target),
         "--disable-pip-version-check", str(wheel)],
        check=True,
    )  # fmt: skip
    return target


def run(code: str, *arguments: str, installed: Path, cwd: Path) -> str:
    """Standard output of Python code that finds the installed package first."""
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        env={**os.environ, "PYTHONPATH": str(installed)}, cwd=cwd, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_wheel_is_pure_python(wheel):
    assert wheel.name.endswith("-py3-none-any.whl")


@pytest.mark.slow
def test_it_runs_from_an_empty_folder_with_the_vessels_that_it_carries(installed, tmp_path):
    for file in run(WHERE, installed=installed, cwd=tmp_path).split():
        assert Path(file).is_relative_to(installed)
    code = "import gateway.vessel_file as v; print(v.load_vessel('otter').name)"
    assert "Otter" in run(code, installed=installed, cwd=tmp_path)
    assert "steady_current" in run(SHADOW, "effects", installed=installed, cwd=tmp_path)


def test_what_ships_is_whole(installed):
    shipped = installed / "gateway" / "_shipped"
    for folder, pattern in (("configs", "*.toml"), ("configs", "*.json"), ("recordings", "*.tlog")):
        there = {p.relative_to(ROOT) for p in (ROOT / folder).rglob(pattern)}
        assert there == {p.relative_to(shipped) for p in (shipped / folder).rglob(pattern)}
    for resource in (
        "figures/report.html", "figures/fleet_report.html", "figures/report_style.html",
        "offline/script.lua", "studio/template.html",
    ):  # fmt: skip
        assert (installed / "gateway" / resource).is_file()


@pytest.mark.slow
def test_a_new_environment_runs_the_whole_demo(wheel, tmp_path):
    home = tmp_path / "environment"
    venv.create(home, with_pip=True)
    python = home / "bin" / "python"
    subprocess.run(
        [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check",
         "--constraint", str(ROOT / "constraints.txt"), str(wheel)],
        check=True,
    )  # fmt: skip
    shadow = str(home / "bin" / "shadow")
    empty = tmp_path / "empty"
    empty.mkdir()
    done = subprocess.run([shadow, "demo"], cwd=empty, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "before" in done.stdout
