"""Vessel files: what is written is what is read, and every mistake is one line that helps."""

import hashlib
from dataclasses import fields, replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.errors import BadInput
from gateway.files import remember
from gateway.user_effects import TRUSTED, load_effects, trust
from gateway.vessel_file import dump_vessel, listed, load_vessel, name_after, read_vessel_file
from gateway.vessel_tables import MAX_NAME, Provenance
from sim.effects.catalogue import EFFECTS
from sim.effects.effect import Kind, Parameter
from sim.vessel import AddedEffect, Dynamics, Hull, Rudder, Sensors, Servo, Thruster, Vessel
from sim.wind import AREA_FACTOR, assumed_wind_areas
from tests.conftest import ROOT
from tests.gateway.test_effect_files import FILE
from tests.sim.vessels import SHAPES, WAMV, every_effect

SHIPPED = sorted((ROOT / "configs" / "vessels").glob("*.toml"))
STEERED = (ROOT / "configs" / "vessels" / "steered.toml").read_text(encoding="utf-8")
TABLE = "[[-1, -1], [0, 0], [0.2, 0.4], [0.5, 0.3], [1, 1]]"
CURRENT = '[[effects]]\ntype = "steady_current"\nspeed = 0.3\ndirection = 1.2\n'
LONG = "n" * 300_000

positive = st.floats(1.0, 1e6)
damping = st.floats(-1e3, 0.0)
number = st.floats(-1e6, 1e6)
point = st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
length = st.floats(0.01, 500.0)
areas = st.just((0.0, 0.0)) | st.tuples(positive, positive)
share = st.floats(0.0, 1.0)  # of the range of a number
name = st.text(st.characters(codec="utf-8", exclude_categories=["Cs", "Cc", "Cf"]), min_size=1,
               max_size=12)  # fmt: skip
word = st.text(st.characters(codec="utf-8", exclude_categories=["Cs"]), min_size=1, max_size=12)
servo = st.builds(
    Servo,
    st.integers(1, 32),
    st.tuples(st.floats(500, 1300), st.floats(1300, 1700), st.floats(1701, 2500)),
    st.booleans(),
)
thruster = st.builds(
    Thruster,
    name,
    servo,
    point,
    st.tuples(st.floats(-1e4, 0.0), st.floats(0.1, 1e4)),
    st.floats(-3.14, 3.14),
    st.sampled_from(["linear", "quadratic"]),
)
dynamics = st.builds(
    Dynamics,
    *[positive] * 3,
    *[damping] * 6,
    st.floats(-1e3, 1e3),
    *[number] * (len(fields(Dynamics)) - 10),
)


@st.composite
def vessels(draw: st.DrawFn) -> Vessel:
    """Any vessel that a file can hold."""
    distinct = (lambda t: t.name, lambda t: t.servo.channel)
    thrusters = draw(st.lists(thruster, min_size=1, max_size=4, unique_by=distinct))
    rudder = st.builds(
        Rudder,
        name.map(lambda name: "rudder " + name),
        servo,
        point,
        st.tuples(st.floats(-1.5, -0.1), st.floats(-0.05, 1.5)),
        area=positive,
        aspect=positive,
        wash=st.none() | st.sampled_from([t.name for t in thrusters]),
        motor=st.none() | st.sampled_from([t.name for t in thrusters]),
    )
    names = {t.name for t in thrusters}
    driven = {t.servo.channel for t in thrusters}
    rudders = draw(st.lists(rudder, max_size=2, unique_by=lambda r: r.name))
    bare = Vessel(
        draw(name),
        draw(st.builds(Hull, length, length, positive, areas)),
        draw(dynamics),
        tuple(thrusters),
        tuple(r for r in rudders if r.name not in names and r.servo.channel not in driven),
        draw(st.builds(Sensors, point, point)),
        source=draw(word),
    )
    fitting = st.sampled_from([effect for effect in EFFECTS if not bare.unmet_needs(effect)])
    effects = draw(st.lists(fitting, max_size=3))

    def value(p: Parameter) -> float:
        x = p.lower + draw(share) * (p.upper - p.lower)
        return round(x) if p.kind is Kind.CHOICE else x

    drawn = [AddedEffect(e, {p.name: value(p) for p in e.parameters}) for e in effects]
    return bare.with_effects(
        *(a for a in drawn if a.effect.mismatch is None or not a.effect.mismatch(bare, a.values))
    )


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_vessel_that_ships_is_read(path: Path) -> None:
    vessel = load_vessel(path)
    assert vessel.name
    assert vessel.source


LOAD = '[[effects]]\ntype = "towed_load"\n{of}drag = 4.0\nx = -1.0\n'


def test_an_effect_of_a_day_that_the_boat_has_every_day_says_so(tmp_path: Path) -> None:
    file = tmp_path / "boat.toml"
    for of, alike in (("", False), ('of = "boat"\n', True)):
        file.write_text(STEERED + LOAD.format(of=of), encoding="utf-8")
        vessel = load_vessel(file)
        assert vessel.effects[-1].effect.is_alike is alike
        file.write_text(dump_vessel(vessel), encoding="utf-8")
        assert load_vessel(file) == vessel
        assert ('of = "boat"' in file.read_text(encoding="utf-8")) is alike
    file.write_text(STEERED + LOAD.format(of='of = "day"\n'), encoding="utf-8")
    with pytest.raises(BadInput, match=r"\.of = 'day': expected 'boat', or none"):
        load_vessel(file)
    file.write_text(STEERED + CURRENT + 'of = "boat"\n', encoding="utf-8")
    with pytest.raises(BadInput, match=r"steady_current is none that a boat has every .*towed_lo"):
        load_vessel(file)


@given(vessel=vessels())
def test_what_is_written_is_what_is_read(
    vessel: Vessel, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / "vessel.toml"
    path.write_text(dump_vessel(vessel), encoding="utf-8", newline="\n")
    assert load_vessel(path) == vessel


@pytest.mark.parametrize("vessel", SHAPES, ids=lambda vessel: vessel.name)
def test_every_shape_with_every_effect_comes_back(vessel: Vessel, tmp_path: Path) -> None:
    full = vessel.with_effects(*every_effect(vessel))
    path = tmp_path / "full.toml"
    path.write_text(dump_vessel(full), encoding="utf-8")
    assert load_vessel(path) == full


def test_where_a_number_came_from_is_kept(tmp_path: Path) -> None:
    origin = Provenance(recording="a.tlog", date="2026-01-01", version="0.1", ci95=(1.0, 2.0))
    path = tmp_path / "v.toml"
    path.write_text(dump_vessel(WAMV, {"dynamics.m11": origin}), encoding="utf-8")
    assert read_vessel_file(path).provenance == {"dynamics.m11": origin}


def message(tmp_path: Path, text: str) -> str:
    """What is said of a file with that text: one line that names the file."""
    path = tmp_path / "boat.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(BadInput) as caught:
        load_vessel(path)
    says = str(caught.value)
    assert says.startswith(f"{path}: ")
    assert "\n" not in says
    return says.removeprefix(f"{path}: ")


def curve(**values: float) -> str:
    """A learned table with these choices."""
    example = next(e for e in EFFECTS if e.name == "learned").example or {}
    lines = (f"{name} = {x}\n" for name, x in {**example, **values}.items())
    return f'[[effects]]\ntype = "learned"\n{"".join(lines)}'


def plugs(order: int = 0, reversed: int = 0) -> str:
    """Actuators in other sockets, or turned."""
    return f'[[effects]]\ntype = "actuator_wiring"\norder = {order}\nreversed = {reversed}\n'


FAULT = '[[effects]]\ntype = "thruster_fault"\nthruster = 3\ngain = 0.5\ntime = 60.0\n'
MISTAKES = {
    "unknown key": ("X_u = -10.0", "X_u = -10.0\nX_q = 1.0", "unknown key dynamics.X_q"),
    "unknown table": ("[hull]", "[hulls]", "unknown key hulls; missing key hull"),
    "missing": ("mass = 90.0", "", "missing key hull.mass"),
    "text": ("mass = 90.0", 'mass = "90"', "hull.mass = '90': input should be a valid number"),
    "two lines": ('name = "outboard"', 'name = "out\\nboard"', "must be one line of characters"),
    "escape": ('name = "blade"', 'name = "\\u001b[2J"', "rudders[0].name = '\\x1b[2J': must be"),
    "truth": ("mass = 90.0", "mass = true", "hull.mass = True: input should be a valid number"),
    "infinite": ("mass = 90.0", "mass = inf", "hull.mass = inf: input should be a finite number"),
    "no size": ("mass = 90.0", "mass = 0.0", "hull.mass = 0.0: input should be greater than 0"),
    "sign": ("X_u = -10.0", "X_u = 10.0", "dynamics.X_u = 10.0: input should be less than or eq"),
    "short": ("[-1.1, 0.0]", "[-1.1]", "missing key thrusters[0].position[1]"),
    "channel 0": ("channel = 3", "channel = 0", "thrusters[0].channel = 0: input should be gr"),
    "channel 33": ("channel = 3", "channel = 33", "thrusters[0].channel = 33: input should be le"),
    "fraction": ("channel = 3", "channel = 3.5", "thrusters[0].channel = 3.5: input should be a v"),
    "pwm": ("channel = 4", "channel = 4\npwm = [1900, 1500, 1100]", "must be ascending pulse"),
    "pwm range": ("channel = 4", "channel = 4\npwm = [0, 1, 2]", "must be ascending pulse"),
    "thrust": ("[-60.0, 120.0]", "[60.0, 120.0]", "thrusters[0].thrust = [60.0, 120.0]: must be"),
    "curve": (
        '"quadratic"',
        '"cubic"',
        "thrusters[0].curve = 'cubic': expected linear, quadratic, or a table of [command, share "
        "of full thrust]",
    ),
    "table": ('"quadratic"', "[[-1, -1], [0, 0.1], [1, 1]]", "must run from [-1, -1] through"),
    "falls": ('"quadratic"', TABLE, "share of full thrust must not fall"),
    "degrees": (
        "[-0.6, 0.6]",
        "[-35.0, 35.0]",
        "rudders[0].angle[0] = -35.0: expected less than a quarter turn, in radi",
    ),
    "azimuth": (
        "channel = 4",
        "channel = 4\nazimuth = 90.0",
        "thrusters[1].azimuth = 90.0: expected -3.1416 to 3.1416, in radians: is",
    ),
    "wash": ('wash = "main"', 'wash = "mian"', "no thruster named 'mian': did you mean main?"),
    "motor": ('motor = "outboard"', 'motor = "x"', "rudders[1]: no thruster named 'x': there are"),
    "blade": ("area = 0.02", "", "rudders[0]: a blade needs its area"),
    "twins": ('"outboard_steering"', '"blade"', "the name 'blade' is given to 2 actuators"),
    "effect": (
        "[hull]",
        '[[effects]]\ntype = "x"\n[hull]',
        "effects[0].type = 'x': no such effect: `shadow effects`",
    ),
    "no type": ("[hull]", "[[effects]]\nspeed = 1.0\n[hull]", "missing key effects[0].type"),
    "parameter": ("[hull]", CURRENT.replace("direction", "to") + "[hull]", "missing direction; u"),
    "no number": ("[hull]", CURRENT.replace("0.3", '"a"') + "[hull]", "effects[0].speed = 'a': e"),
    "not finite": ("[hull]", CURRENT.replace("0.3", "nan") + "[hull]", "effects[0].speed = nan:"),
    "no file": ("[hull]", CURRENT + 'file = "x.py"\n[hull]', "effects[0].file: "),
    "no path": ("[hull]", CURRENT + "file = 3\n[hull]", "effects[0].file: 3: expected a path"),
    "one output": ("channel = 4", "channel = 3", "thrusters[1].channel = 3: drives 'main' too: "),
    "rudder's": (
        "channel = 1",
        "channel = 3",
        "rudders[0].channel = 3: is that of thruster 'main'",
    ),
    "reversed": ("[-0.6, 0.6]", "[0.6, -0.6]", "must be rad at command -1, then at 1, ascending"),
    "170°": ("[hull]", CURRENT.replace("1.2", "170") + "[hull]", "170° are 2.967 rad"),
    "knots": ("[hull]", CURRENT.replace("0.3", "300") + "[hull]", "effects[0].speed = 300: expec"),
    "no axis": ("[hull]", curve(by=1, acts=7) + "[hull]", "effects[0].acts = 7: expected 1 to 6"),
    "no such motor": ("[hull]", FAULT + "[hull]", "effects[0]: thruster = 3: the vessel has 2"),
    "no such plug": (
        "[hull]",
        plugs(order=5143) + "[hull]",
        "order = 5143: expected 0, or one digit",
    ),
    "too few plugs": ("[hull]", plugs(order=21) + "[hull]", "for each of the 4 actuators"),
    "none so turned": ("[hull]", plugs(reversed=15) + "[hull]", "reversed = 15: expected 0, or"),
    "half a choice": ("[hull]", curve(by=1.5, acts=1) + "[hull]", "by = 1.5: expected a whole num"),
    "outward": ("[hull]", curve(by=1, acts=6) + "[hull]", "(outward) goes with by = 5 (a motor's"),
    "angle": ("[hull]", curve(by=5, acts=5) + "[hull]", "(angle commanded) go with one another"),
    "rudder's push": ("[hull]", curve(by=6, acts=2) + "[hull]", "go with one another alone"),
    "hard stop": ("X_u = -10.0", "X_u = -1.8e7", "stops the boat in less than 0.001 s"),
    "too heavy": ("mass = 90.0", "mass = 1e20", "hull.mass = 1e+20: input should be less than"),
    "too strong": (
        "[-60.0, 120.0]",
        "[-60.0, 3e301]",
        "thrust = [-60.0, 3e+301]: must be at most 1e",
    ),
    "too weak": (
        "[-60.0, 120.0]",
        "[60.0, 120.0]",
        "= [60.0, 120.0]: must be thrust in N full ast",
    ),
    "far away": ("[-1.1, 0.0]", "[-1100.0, 0.0]", "thrusters[0].position[0] = -1100.0: input sh"),
    "long word": ("mass = 90.0", f"mass = '{'9' * 9000}'", "9…: input should be a valid number"),
    "long number": ("mass = 90.0", f"mass = {'9' * 5000}", "a number in it has too many digits"),
    "nested": ("[hull]", f"a = {'[' * 9000}{']' * 9000}\n[hull]", "nest too deeply"),
    "nested in tables": (
        "[hull]",
        f"a = {('{' + 'a.' * 18 + 'a=') * 60}1{'}' * 60}\n[hull]",
        "nest too deeply",
    ),
    "long name": ('"Steered example"', f"'{'n' * 376_000}'", "name = 'nnn"),
    "long thruster": ('"outboard"', f"'{'n' * 101}'", "thrusters[1].name = 'nnn"),
    "long rudder": ('"blade"', f"'{'n' * 101}'", "rudders[0].name = 'nnn"),
    "long wash": ("angle =", f"motor = '{LONG}'\nangle =", "motor = 'nnn"),
    "long curve": ('"quadratic"', f"'{LONG}'", "expected a name of at most 100"),
    "long source": ("made up", "s" * 1001, "source = 'sss"),
    "long origin": ("[hull]", f"[provenance.m]\nfit = '{LONG}'\n[hull]", "provenance.m.fit = 'nnn"),
    "long key": ("[hull]", f"[provenance.{LONG}]\n[hull]", "at most 300 characters"),
    "long date": (
        "[hull]",
        f"[[history]]\ndate = '{LONG}'\nby = 'me'\n[hull]",
        "history[0].date = 'nnn",
    ),
    "long parameter": ("[hull]", f"{CURRENT}{LONG} = 1\n[hull]", "takes speed, direction; unkn"),
    "long path": ("[hull]", f"{CURRENT}file = '/{LONG}'\n[hull]", "effects[0].file: /nnn"),
    "1,000 effects": ("[hull]", CURRENT * 1000 + "[hull]", "at most 48 items"),
    "many digits": (
        "[hull]",
        CURRENT.replace("0.3", "9" * 400) + "[hull]",
        "9…: expected a number",
    ),
    "padded": ("[hull]", "#" * 1_000_001 + "\n[hull]", "larger than 1,000,000 bytes (MAX_BYTES)"),
    "not TOML": ("[hull]", "[hull", "not a TOML file"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_line_with_key_and_what_was_expected(tmp_path: Path, mistake: str) -> None:
    right, wrong, expected = MISTAKES[mistake]
    assert right in STEERED
    says = message(tmp_path, STEERED.replace(right, wrong, 1))
    assert expected in says
    assert len(says) < 1000  # nothing quotes a file at length


def test_a_whole_number_is_a_number(tmp_path: Path) -> None:
    path = tmp_path / "boat.toml"
    path.write_text(STEERED.replace("mass = 90.0", "mass = 90"), encoding="utf-8")
    assert load_vessel(path).hull.mass == 90.0


def test_a_file_as_notepad_writes_it_is_read(tmp_path: Path) -> None:
    file = tmp_path / "boat.toml"
    file.write_text(dump_vessel(WAMV), encoding="utf-8-sig", newline="\r\n")
    assert load_vessel(file) == WAMV


def test_what_is_no_vessel_file_is_said(tmp_path: Path) -> None:
    binary = tmp_path / "noise.toml"
    binary.write_bytes(b"\xff\xfe\x00\x01")
    for path, expected in (
        (tmp_path / "absent.toml", "cannot read the vessel file: No such file"),
        (tmp_path, "cannot read the vessel file: Is a directory"),
        (binary, "not a text file"),
    ):
        with pytest.raises(BadInput, match=f"^{path}: {expected}"):
            load_vessel(path)


def test_an_effect_of_ones_own_is_found_beside_the_vessel_file(tmp_path: Path) -> None:
    (tmp_path / "line.py").write_text(FILE.replace("FACTOR", "1"))
    entry = '[[effects]]\ntype = "line_drag"\nk = 20.0\n'
    path = tmp_path / "boat.toml"
    path.write_text(STEERED + entry + 'file = "line.py"\n', encoding="utf-8")
    trust(tmp_path / "line.py")
    named = load_vessel(path).effects
    path.write_text(STEERED + entry, encoding="utf-8")
    given_too = load_vessel(path, load_effects(tmp_path / "line.py")).effects
    assert [(a.effect.name, a.values) for a in named] == [("line_drag", {"k": 20.0})]
    assert given_too == named
    with pytest.raises(
        BadInput, match=r"type = 'line_drag': no such effect: `shadow.*--effects FILE.py"
    ):
        load_vessel(path)


def test_a_broken_effect_file_is_one_line_that_names_both_files(tmp_path: Path) -> None:
    good = FILE.replace("FACTOR", "1")
    (tmp_path / "line.py").write_text(good + "from pathlib import Path\nPath('/absent').stat()\n")
    remember(TRUSTED, hashlib.sha256((tmp_path / "line.py").read_bytes()).hexdigest(), {})
    entry = '[[effects]]\ntype = "line_drag"\nfile = "line.py"\nk = 20.0\n'
    says = message(tmp_path, STEERED + entry)
    assert "effects[0].file: " in says
    assert "line.py: FileNotFoundError" in says


def test_two_files_differ_where_two_vessels_differ(tmp_path: Path) -> None:
    heavier = replace(WAMV, hull=replace(WAMV.hull, mass=200.0))
    assert dump_vessel(heavier) != dump_vessel(WAMV)


def test_an_effect_that_cannot_act_is_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "boat.toml"
    unsteered = replace(WAMV, effects=())
    entry = '[[effects]]\ntype = "steering_lag"\ntau = 0.3\n'
    path.write_text(dump_vessel(unsteered) + entry, encoding="utf-8")
    with pytest.raises(BadInput, match=rf"^{path}: effect steering_lag needs a rudder"):
        load_vessel(path)


WIND = '[[effects]]\ntype = "steady_wind"\nspeed = 5.0\ndirection = 0.0\n'


def test_assumed_areas_are_written_with_their_origin_and_stay_assumed(tmp_path: Path) -> None:
    path = tmp_path / "boat.toml"
    path.write_text(STEERED + WIND, encoding="utf-8")
    vessel = load_vessel(path)
    assert vessel.hull.wind_area == (0.0, 0.0)
    path.write_text(dump_vessel(vessel), encoding="utf-8")
    written = read_vessel_file(path)
    assert written.hull.wind_area == vessel.hull.areas
    assert written.provenance["hull.wind_area"].says.startswith("assumed from length and beam")
    assert load_vessel(path) == vessel
    assert load_vessel(path).assumptions


def test_areas_that_someone_put_in_the_place_of_assumed_ones_count(tmp_path: Path) -> None:
    path = tmp_path / "boat.toml"
    path.write_text(STEERED + WIND, encoding="utf-8")
    front, side = load_vessel(path).hull.areas
    text = dump_vessel(load_vessel(path))
    assert text.count(str(side)) == 1
    path.write_text(text.replace(str(side), "0.91"), encoding="utf-8")
    assert load_vessel(path).hull.wind_area == (front, 0.91)
    assert not any("wind_area" in text for text in load_vessel(path).assumptions)


def test_a_file_without_wind_has_no_areas_that_nobody_gave(tmp_path: Path) -> None:
    path = tmp_path / "boat.toml"
    path.write_text(STEERED, encoding="utf-8")
    assert "wind_area" not in dump_vessel(load_vessel(path))


def test_one_area_alone_is_a_mistake(tmp_path: Path) -> None:
    text = STEERED.replace("[hull]\n", "[hull]\nwind_area = [0.2, 0.0]\n", 1)
    assert "hull.wind_area = [0.2, 0.0]: must be the frontal and the lateral area" in message(
        tmp_path, text
    )


@pytest.mark.parametrize("name", ["blueboat", "demo_boat", "wam-v"])
def test_areas_of_shipped_vessels_are_half_to_twice_what_would_be_assumed(name: str) -> None:
    hull = load_vessel(name).hull
    for known, assumed in zip(
        hull.wind_area, assumed_wind_areas(hull.length, hull.beam), strict=True
    ):
        assert 1.0 / AREA_FACTOR < known / assumed < AREA_FACTOR


def test_a_table_of_thrust_comes_back_and_may_be_shared(tmp_path: Path) -> None:
    table = "[[-1, -1], [-0.5, -0.3], [0, 0], [0.1, 0.0], [0.5, 0.28], [1, 1]]"
    path = tmp_path / "boat.toml"
    text = STEERED.replace('"quadratic"', table, 1)
    text = text.replace('name = "outboard"', 'name = "outboard"\ncurve = "main"', 1)
    path.write_text(text, encoding="utf-8")
    vessel = load_vessel(path)
    assert vessel.thrusters[0].curve[4] == (0.5, 0.28)
    assert vessel.thrusters[1].curve == "main"
    path.write_text(dump_vessel(vessel), encoding="utf-8")
    assert load_vessel(path) == vessel


def test_what_commands_list_and_names_after_files_fit_into_a_file() -> None:
    recordings = listed(f"voyage {k}" for k in range(30_000))
    assert recordings.startswith("voyage 0, voyage 1, ")
    assert Provenance(recording=recordings).recording[-1] == "…"
    assert listed(["a", "b"]) == "a, b"
    assert name_after(Path("logs/otter.tlog")) == "otter"
    assert len(f"{name_after(Path('a' * 250))} fitted") <= MAX_NAME
