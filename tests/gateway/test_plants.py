"""Plants by kind: words of the command line, a plug-in's kind driven from it, the table of them."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from gateway import plants
from gateway.config import load_settings
from gateway.errors import BadInput
from gateway.files import vessel_path
from gateway.live.plans import plans_in, plans_of
from gateway.recording.reader import Recording
from gateway.vessel_file import dump_vessel
from sim.plants import OWN_VESSEL, PLANTS, VESSEL, PlantChoice, PlantKind
from sim.plants.plant import VesselPlant
from tests.gateway.command_line import Run
from tests.sim.vessels import IACQUABOT

ROOT = Path(__file__).resolve().parents[2]
HEAVY = PlantKind("heavy", "twice the mass", VesselPlant)
PLUG_IN = '''
from dataclasses import dataclass, replace
from sim.model import Model
from sim.plants import PlantKind
from sim.plants.plant import VesselPlant


@dataclass(frozen=True)
class LazyPlant(VesselPlant):
    """Half the force that is asked for."""

    def step(self, state, tau, inputs, dt):
        half = tau._replace(X=0.5 * tau.X, Y=0.5 * tau.Y, N=0.5 * tau.N)
        return super().step(state, half, inputs, dt)


LAZY = PlantKind("lazy", "half the force that is asked for", LazyPlant)
'''


@pytest.fixture
def heavy(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A second kind of plant in the table."""
    monkeypatch.setattr(plants, "PLANTS", {**PLANTS, "heavy": HEAVY})
    plants.known_plants.cache_clear()
    yield
    plants.known_plants.cache_clear()


@pytest.fixture
def boat(tmp_path: Path) -> Path:
    file = tmp_path / "boat.toml"
    file.write_text(dump_vessel(IACQUABOT), encoding="utf-8")
    return file


def test_the_words_for_a_plant(heavy: None, boat: Path) -> None:
    assert plants.load_plant(None) == OWN_VESSEL
    assert plants.load_plant("vessel") == OWN_VESSEL
    assert plants.load_plant(str(boat)) == PlantChoice(VESSEL, IACQUABOT)
    assert plants.load_plant(f"vessel:{boat}") == PlantChoice(VESSEL, IACQUABOT)
    assert plants.load_plant("heavy") == PlantChoice(HEAVY, None)
    assert plants.load_plant(f"heavy:{boat}") == PlantChoice(HEAVY, IACQUABOT)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("heavy:", "expected KIND or KIND:FILE"),
        ("heafy:boat.toml", r"'heafy': did you mean heavy\? there are fmu, heavy, mujoco, vessel"),
        ("heavy:absent.toml", "absent.toml: cannot read the vessel file"),
        ("absent.toml", "^absent.toml: cannot read the vessel file"),
    ],
)
def test_a_plant_that_is_none_is_one_line(heavy: None, text: str, message: str) -> None:
    with pytest.raises(BadInput, match=message):
        plants.load_plant(text)


def test_live_boats_have_plants_of_any_kind(heavy: None, boat: Path, tmp_path: Path) -> None:
    (plan,) = plans_of([str(boat)], "heavy", None, [])
    assert plan.plant == PlantChoice(HEAVY, None)
    file = tmp_path / "gateway.toml"
    file.write_text(
        "".join(
            f'[[boats]]\nvessel = "boat.toml"\nsystem_id = {i}\n{line}'
            for i, line in enumerate(
                ("", 'plant = "boat.toml"\n', 'plant = "heavy:boat.toml"\n', 'plant = "heavy"\n'), 1
            )
        ),
        encoding="utf-8",
    )
    boats = load_settings(file).boats
    assert [b.plant for b in boats] == [None, str(boat), f"heavy:{boat}", "heavy"]
    assert [plan.plant for plan in plans_in(boats, [])] == [
        OWN_VESSEL,
        PlantChoice(VESSEL, IACQUABOT),
        PlantChoice(HEAVY, IACQUABOT),
        PlantChoice(HEAVY, None),
    ]


@pytest.fixture
def plugged_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A package with a plant, installed in a folder."""
    (tmp_path / "lazyplant.py").write_text(PLUG_IN, encoding="utf-8")
    info = tmp_path / "lazyplant-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: lazyplant\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[shadow.plants]\nlazy = lazyplant:LAZY\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "lazyplant", raising=False)
    plants.known_plants.cache_clear()
    yield
    plants.known_plants.cache_clear()


def test_a_plug_ins_plant_is_listed_and_chosen(plugged_in: None, run: Run, boat: Path) -> None:
    listed = json.loads(run("plants", "--json").out)["plants"]
    assert [kind["name"] for kind in listed] == ["vessel", "mujoco", "fmu", "lazy"]
    assert "half the force" in run("plants").out
    assert plants.load_plant(f"lazy:{boat}").vessel == IACQUABOT


@pytest.mark.slow
def test_a_plug_ins_plant_is_driven_from_the_command_line(
    plugged_in: None, run: Run, tmp_path: Path
) -> None:
    log, demo = ROOT / "recordings" / "otter_piece.tlog", str(vessel_path("otter"))
    errors = {}
    for plant in ("vessel", "lazy", f"lazy:{demo}"):
        words = ("replay", log, "-v", demo, "--plant", plant, "--no-publish", "--json")
        result = json.loads(run(*words).out)["replays"][0]
        errors[plant] = np.array(list(result["following_rmse"].values()))
        recording = Recording.open(tmp_path / "shadow-out" / "otter_piece-shadow.mcap")
        kind = recording.metadata["shadow"].get("plant")
        assert kind == (None if plant == "vessel" else "lazy")
        assert ("plant.toml" in recording.attachments) == (":" in plant)
    np.testing.assert_array_equal(errors["lazy"], errors[f"lazy:{demo}"])
    assert (errors["lazy"][3:] > 1.5 * errors["vessel"][3:]).all()
