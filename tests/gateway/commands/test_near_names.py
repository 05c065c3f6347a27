"""A name with a letter wrong: the line says which one was meant."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import gateway
from gateway.config import settings_of
from gateway.errors import BadInput
from gateway.fleet.analysis import AnalysisSettings
from gateway.offline.usable_time import Exclusion, exclude_stretches
from gateway.simulated_boat.hull import program_of
from gateway.vessel_file import load_vessel
from sim.effects.catalogue import named
from sim.identification import IdentifySettings
from sim.identification.parameters import unknowns_of
from sim.model import Model
from sim.vessel import AddedEffect
from tests.gateway.command_line import Run, one_line
from tests.sim.vessels import WAMV
from tests.sim.voyages import WAM_V, simulated

COMMANDS = {
    "steady_wind": ["effects", "steady_wnd"],
    "otter": ["compare", "LOG", "--vessel", "oter"],
    "parquet": ["export", "LOG", "--to", "parqet"],
    "ATTITUDE": ["export", "LOG", "--to", "csv", "--topic", "attitude"],
    "mujoco": ["replay", "LOG", "--vessel", "otter", "--plant", "mujocco", "--no-record"],
    "thinned": ["replay", "LOG", "--vessel", "otter", "--topics", "thined"],
    "measured": ["replay", "LOG", "--vessel", "otter", "--reference", "masured"],
    "zigzag": ["plan", "--vessel", "otter", "--excitation", "zigzg"],
    "shooting": ["identify", "LOG", "--vessel", "otter", "--method", "shoting"],
    "show": ["vessel", "shw", "otter"],
}


@pytest.mark.parametrize("meant", COMMANDS)
def test_a_command_says_which_name_was_meant(
    run: Run, log: Path, meant: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    words = [log if word == "LOG" else word for word in COMMANDS[meant]]
    line = one_line(run(*words), 2).lower().replace("'", "")
    assert f"did you mean {meant.lower()}?" in line


OTTER, WIND = load_vessel("otter"), named("steady_wind")
BREEZE = AddedEffect(WIND, {p.name: p.start for p in WIND.parameters})
BOAT = Model.of(replace(OTTER, effects=(BREEZE,)))
MEANT: dict[str, Callable[[], object]] = {
    "compare": lambda: AnalysisSettings(steps=("compar",)),
    "voyage_1": lambda: gateway.example_log("voyage1"),
    "zigzag": lambda: program_of(WAMV, "zigzg"),
    "hull_lift": lambda: named("hul_lift"),
    "voyage": lambda: exclude_stretches([simulated(WAM_V, 5.0)], [Exclusion(0.0, 1.0, "voyag")]),
    "left.ahead": lambda: unknowns_of(BOAT, 1, IdentifySettings(fix=("lefft.ahead",))),
    "left.curve": lambda: unknowns_of(BOAT, 1, IdentifySettings(free=("lefft.curve",))),
    "steady_wind.*": lambda: unknowns_of(BOAT, 1, IdentifySettings(free=("steady_wnd.*",))),
    "radio": lambda: settings_of({"links": {"rates": {"preset": "radoi"}}}, "gateway.toml"),
}


@pytest.mark.parametrize("meant", MEANT)
def test_a_function_says_so_too(meant: str) -> None:
    mistakes = (BadInput, KeyError, ValueError, FileNotFoundError)
    with pytest.raises(mistakes, match=re.escape(f"did you mean {meant}?")):
        MEANT[meant]()
