"""An FMU as a plant: built here from Python, driven, followed; what is wrong in one line."""

import sys
import zipfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from fmpy import read_model_description
from pythonfmu.builder import FmuBuilder
from pythonfmu3.builder import FmuBuilder as Fmi3Builder

from gateway.commands.live import simulate as simulate_command
from gateway.errors import BadInput
from gateway.offline.simulate import simulate
from gateway.plants import fmu, load_plant
from sim.following.follower import FollowerOptions
from sim.following.stepwise import follower_for
from sim.hil.boat import Boat
from sim.hil.day import Day
from sim.model import Model
from sim.plants.plant import FloatingPlant, PlantInputs, PlantMotion
from sim.plants.waves import Sea
from sim.state import Pose, Velocity, Wrench
from tests.sim.vessels import WAMV

AIR = PlantInputs(0.0, np.nan, np.nan, np.nan)
# A boat whose thrusters lag, in axes of its own: x north, y to port, angles in degrees to port
BOAT = """
from math import cos, radians, sin, degrees
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real


class LaggedBoat(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.x = self.y = self.psi = self.u = self.v = self.r = 0.0
        self.tau_x = self.tau_y = self.tau_n = self.fx = self.fy = self.fn = 0.0
        self.heel, self.mass, self.count = 0.0, 30.0, 0
        for name in ("tau_x", "tau_y", "tau_n"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        for name in ("x", "y", "psi", "u", "v", "r", "heel"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))
        for name in ("fx", "fy", "fn"):
            self.register_variable(Real(name, causality=Fmi2Causality.local))
        self.register_variable(Integer("count", causality=Fmi2Causality.output))
        self.register_variable(
            Real("mass", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable)
        )

    def do_step(self, time, dt):
        n = max(1, round(dt / 0.005))
        for _ in range(n):
            h, m, r = dt / n, self.mass, radians(self.r)
            self.fx += h * (self.tau_x - self.fx) / 0.15
            self.fy += h * (self.tau_y - self.fy) / 0.15
            self.fn += h * (self.tau_n - self.fn) / 0.15
            u_dot = (self.fx - 12 * self.u - 15 * abs(self.u) * self.u) / m + self.v * r
            v_dot = (self.fy - 40 * self.v - 60 * abs(self.v) * self.v) / (1.4 * m) - self.u * r
            self.r += degrees(h * (self.fn - 9 * r - 8 * abs(r) * r) / (0.2 * m))
            self.u, self.v = self.u + h * u_dot, self.v + h * v_dot
            c, s = cos(radians(self.psi)), sin(radians(self.psi))
            self.x += h * (c * self.u - s * self.v)
            self.y += h * (s * self.u + c * self.v)
            self.psi += h * self.r
        self.heel = 0.1 * self.v
        return True
"""
CLOCK = """        self.time = 0.0
        self.register_variable(
            Real("time", causality=Fmi2Causality.independent,
                 variability=Fmi2Variability.continuous)
        )
"""
DEGREES = "factor = -0.017453292519943295"
TABLE = f"""file = "LaggedBoat.fmu"
[inputs]
X = "tau_x"
Y = {{ variable = "tau_y", factor = -1.0 }}
N = {{ variable = "tau_n", factor = -1.0 }}
[outputs]
north = "x"
east = {{ variable = "y", factor = -1.0 }}
yaw = {{ variable = "psi", {DEGREES} }}
u = "u"
v = {{ variable = "v", factor = -1.0 }}
r = {{ variable = "r", {DEGREES} }}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """An FMU that saves its state, the same without, and the table of the first."""
    folder = tmp_path_factory.mktemp("fmu")
    script = folder / "boat.py"
    script.write_text(BOAT, encoding="utf-8")
    for name, saves in (("plain.fmu", False), ("LaggedBoat.fmu", True)):
        built = FmuBuilder.build_FMU(script, folder, canGetAndSetFMUstate=saves)
        Path(built).rename(folder / name)
    (folder / "boat.toml").write_text(TABLE, encoding="utf-8")
    (folder / "plain.toml").write_text(TABLE.replace("LaggedBoat.fmu", "plain.fmu"))
    return folder


@pytest.fixture(scope="module", params=["2.0", "3.0"])
def either(request, folder, tmp_path_factory):
    """The table of an FMU of FMI 2, and of the same boat in FMI 3."""
    if request.param == "2.0":
        return folder
    other = tmp_path_factory.mktemp("fmi3")
    script = other / "boat_of_fmi3.py"
    script.write_text(of_fmi3(BOAT), encoding="utf-8")
    Fmi3Builder.build_FMU(script, other, canGetAndSetFMUState=True)
    assert read_model_description(other / "LaggedBoat.fmu").fmiVersion == "3.0"
    (other / "boat.toml").write_text(TABLE, encoding="utf-8")
    return other


def of_fmi3(text):
    """A boat written for PythonFMU, for PythonFMU3: FMI 3 wants the time among the variables."""
    text = text.replace("        self.heel,", f"{CLOCK}        self.heel,")
    for two, three in (("Fmi2", "Fmi3"), ("pythonfmu", "pythonfmu3"), ("Integer", "Int32")):
        text = text.replace(two, three)
    return text.replace("Real", "Float64")


def plant_of(folder, table="boat.toml"):
    return load_plant(f"fmu:{folder / table}").kind.build(Model.of(WAMV))


def test_it_starts_where_the_boat_is_and_moves_as_mapped(either):
    """Ahead and to starboard, in our axes, from a place and a heading that it knows nothing of."""
    plant = plant_of(either)
    state = plant.initial_state(PlantMotion(Pose(10.0, -5.0, 1.2), Velocity(0, 0, 0)), AIR)
    assert plant.motion(state).pose == pytest.approx((10.0, -5.0, 1.2))
    for k in range(100):
        state = plant.step(state, Wrench(40.0, 0.0, 2.0), AIR._replace(time=0.02 * k), 0.02)
    (north, east, yaw), (u, _, r) = plant.motion(state)
    assert u > 0.7
    assert r > 0.1
    assert yaw > 1.25
    ahead = np.array([np.cos(1.2), np.sin(1.2)]) @ [north - 10.0, east + 5.0]
    assert 1.0 < ahead < 2.0


def test_a_state_is_a_value(either):
    """Two ways on from one moment, and back."""
    plant, push = plant_of(either), Wrench(40.0, 0.0, 0.0)
    state = plant.initial_state(PlantMotion(Pose(0, 0, 0), Velocity(0, 0, 0)), AIR)
    for _ in range(20):
        state = plant.step(state, push, AIR, 0.02)
    one = plant.step(state, push, AIR, 0.02)
    other = plant.step(state, Wrench(-40.0, 0.0, 0.0), AIR, 0.02)
    assert other.values[3] < one.values[3]
    assert plant.step(state, push, AIR, 0.02).values == one.values


def test_it_follows_a_boat_that_is_another(either):
    """By prediction, its lag of 0.15 s included: no inverse of it is known."""
    times = 0.02 * np.arange(150)
    commands = np.column_stack([0.4 + 0.2 * np.sin(times), 0.4 - 0.1 * np.sin(times)])
    reference = Model.of(WAMV).simulate(commands, 0.02)[1][0, :-1]
    kind = load_plant(f"fmu:{either / 'boat.toml'}").kind
    follower = follower_for(Model.of(WAMV), FollowerOptions(), kind)
    error = follower.advance(follower.start(), times, reference).shadows - reference
    assert np.abs(error[50:, [0, 1, 3, 4]]).max() < 0.03
    assert np.abs(error[50:, 5]).max() < 0.02


def test_an_autopilot_drives_one_that_does_not_save_its_state(folder):
    choice = load_plant(f"fmu:{folder / 'plain.toml'}")
    boat = Boat.of(WAMV, Day(sea=Sea(0.3, 3.0, 0.7)), plant=choice)
    state = boat.start()
    for _ in range(200):
        state, readings, truth = boat.step(state, {1: 1700.0, 2: 1700.0}, 0.01)
    assert truth.u > 0.5
    assert truth.roll != 0.0  # by hydrostatics: it has three degrees itself
    north = truth.u * np.cos(truth.yaw) - truth.v * np.sin(truth.yaw)
    assert readings.velocity[0] == pytest.approx(north)
    with pytest.raises(ValueError, match="it does not go back to a state"):
        follower_for(Model.of(WAMV), FollowerOptions(), choice.kind)


def test_an_fmu_that_saves_a_part_of_its_state_is_not_followed(folder, tmp_path):
    script = tmp_path / "forgetful.py"  # PythonFMU keeps one module of a name
    forgetful = BOAT.replace('for name in ("fx", "fy", "fn")', "for name in ()")
    script.write_text(forgetful.replace("LaggedBoat", "Forgetful"), encoding="utf-8")
    FmuBuilder.build_FMU(script, tmp_path, canGetAndSetFMUstate=True)
    table = TABLE.replace("LaggedBoat", "Forgetful")
    (tmp_path / "boat.toml").write_text(table, encoding="utf-8")
    assert not plant_of(tmp_path).rewinds
    assert plant_of(folder).rewinds


def test_one_of_six_degrees_tells_heave_roll_and_pitch(folder):
    six = "".join(f'{n} = "heel"\n' for n in ("down", "pitch", "w", "roll_rate", "pitch_rate"))
    text = TABLE + 'roll = { variable = "heel", factor = 2.0 }\n' + six
    (folder / "six.toml").write_text(text, encoding="utf-8")
    plant = plant_of(folder, "six.toml")
    assert isinstance(plant, FloatingPlant)
    assert not isinstance(plant_of(folder), FloatingPlant)
    state = plant.initial_state(PlantMotion(Pose(0, 0, 0), Velocity(0, 0, 0)), AIR)
    for _ in range(50):
        state = plant.step(state, Wrench(0.0, 30.0, 0.0), AIR, 0.02)
    at = plant.afloat(state, Wrench(0.0, 0.0, 0.0), AIR)
    assert at.roll == pytest.approx(2.0 * at.down)
    assert at.roll != 0.0


@pytest.mark.parametrize(
    ("before", "after", "wrong"),
    [
        ('X = "tau_x"\n', "", "boat.toml: missing key inputs.X"),
        ('u = "u"', "", "missing key outputs.u"),
        ('"tau_x"', '"thrust"', "LaggedBoat.fmu has no variable thrust: it has tau_x, tau_y"),
        ('"LaggedBoat.fmu"', '"gone.fmu"', "'gone.fmu': there is no such file beside it"),
        ('"LaggedBoat.fmu"', '"boat.py"', "boat.py: not an FMU"),
        ('north = "x"', 'north = "count"', "count of LaggedBoat.fmu is Integer: expected a real"),
        ('north = "x"', 'nroth = "x"', "nroth"),
    ],
)
def test_what_is_wrong_with_a_table_is_one_line(folder, before, after, wrong):
    wrong_table = folder / "wrong" / "boat.toml"
    wrong_table.parent.mkdir(exist_ok=True)
    for name in ("LaggedBoat.fmu", "boat.py"):
        if not (wrong_table.parent / name).exists():
            (wrong_table.parent / name).symlink_to(folder / name)
    wrong_table.write_text(TABLE.replace(before, after), encoding="utf-8")
    with pytest.raises(BadInput) as caught:
        load_plant(f"fmu:{wrong_table}")
    assert wrong in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_fmu_that_fails_is_one_line(folder, monkeypatch):
    text = f"{TABLE}[parameters]\nmass = 0.0\n"
    (folder / "failing.toml").write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=r"LaggedBoat stopped after 0.00 s"):
        plant_of(folder, "failing.toml")
    monkeypatch.setattr(fmu._Instance, "get", lambda self, names: [np.nan] * len(names))
    with pytest.raises(ValueError, match=r"LaggedBoat gave no number 0.02 s after start"):
        plant_of(folder)


@pytest.mark.parametrize(
    ("before", "after", "wrong"),
    [
        ("<CoSimulation ", "<ModelExchange ", "for model exchange alone: expected co-simulation"),
        ('fmiVersion="2.0"', 'fmiVersion="7.0"', "not an FMU"),
        ("<ModelVariables>", "<ModelVariables", "not an FMU"),
    ],
)
def test_an_fmu_of_another_kind_is_one_line(folder, tmp_path, before, after, wrong):
    with (
        zipfile.ZipFile(folder / "LaggedBoat.fmu") as given,
        zipfile.ZipFile(tmp_path / "LaggedBoat.fmu", "w") as made,
    ):
        text = given.read("modelDescription.xml").decode()
        made.writestr("modelDescription.xml", text.replace(before, after))
    (tmp_path / "boat.toml").write_text(TABLE, encoding="utf-8")
    with pytest.raises(BadInput, match=wrong) as caught:
        load_plant(f"fmu:{tmp_path / 'boat.toml'}")
    assert "\n" not in str(caught.value)


def test_an_fmu_of_fmi_1_is_one_line(folder, monkeypatch):
    old = SimpleNamespace(fmiVersion="1.0", coSimulation=object())
    monkeypatch.setattr("fmpy.read_model_description", lambda *given, **options: old)
    with pytest.raises(BadInput, match=r"LaggedBoat.fmu: FMI 1.0: expected 2 or 3"):
        load_plant(f"fmu:{folder / 'boat.toml'}")


def test_one_without_a_program_for_this_machine_is_one_line(folder, tmp_path):
    with (
        zipfile.ZipFile(folder / "LaggedBoat.fmu") as given,
        zipfile.ZipFile(tmp_path / "LaggedBoat.fmu", "w") as made,
    ):
        made.writestr("modelDescription.xml", given.read("modelDescription.xml"))
    (tmp_path / "boat.toml").write_text(TABLE, encoding="utf-8")
    with pytest.raises(ValueError, match="does not run here"):
        plant_of(tmp_path)


def test_fmpy_that_is_missing_is_one_line(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "fmpy", None)
    with pytest.raises(BadInput, match=r"pip install 'shadow-gateway\[fmu\]'"):
        load_plant(f"fmu:{folder / 'boat.toml'}")


def test_commands_move_it_under_the_vessels_thrusters(folder, tmp_path):
    """`shadow simulate --plant`: the FMU's motion, the vessel's force."""
    commands = tmp_path / "ahead.csv"
    commands.write_text("time,left,right\n0,0.5,0.5\n4,0,0\n", encoding="utf-8")
    choice = load_plant(f"fmu:{folder / 'plain.toml'}")
    moved = simulate(commands, WAMV, None, tmp_path, plant=choice)
    own = simulate(commands, WAMV, None, tmp_path)
    np.testing.assert_array_equal(moved.commanded, own.commanded)
    assert moved.motion[0, 3] == 0.0
    assert moved.motion[-1, 3] > own.motion[-1, 3] + 0.3  # it is lighter
    with pytest.raises(BadInput, match="--plant goes with a table of commands"):
        simulate_command(vessel=Path("otter"), plant="mujoco", log=tmp_path / "x.tlog")


def test_fmu_without_a_table_is_one_line():
    with pytest.raises(BadInput, match="plant fmu: expected fmu:FILE"):
        load_plant("fmu")
