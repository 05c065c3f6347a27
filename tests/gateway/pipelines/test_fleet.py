"""Which boat is shadowed by which vessel, under which name, and who is ignored."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import orjson
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.config import load_settings
from gateway.errors import BadInput
from gateway.ingest.log import Boat
from gateway.links import Datagram, Frame
from gateway.live.boats import MAX_BOATS, MAX_OTHERS, BoatPlan, Fleet, LiveBoat, sender
from gateway.live.plans import plans_in, plans_of
from gateway.vessel_file import dump_vessel
from tests.gateway.pipelines.aboard import SETTINGS
from tests.sim.vessels import IACQUABOT, WAMV

STATION = dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID
BOAT = dialect.MAV_TYPE_SURFACE_BOAT, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA


class Harbour:
    """A fleet and those whom it met."""

    def __init__(self, *plans: BoatPlan) -> None:
        self.found: list[tuple[str, str]] = []
        self.ignored: list[int] = []
        self.fleet = Fleet(plans, SETTINGS, self._found, self._ignored)

    def beat(self, *systems: int, kind: tuple[int, int] = BOAT, component: int = 1) -> "Harbour":
        for system in systems:
            message = dialect.MAVLink_heartbeat_message(*kind, 0, 0, 4, 3)
            list(
                self.fleet.datagrams([Datagram("l", 10**18, (framed(message, system, component),))])
            )
        return self

    def _found(self, boat: LiveBoat, plan: BoatPlan) -> None:
        self.found.append((boat.name, plan.vessel.name))

    def _ignored(self, boat: Boat) -> None:
        self.ignored.append(boat.system)


def framed(message: Any, system: int, component: int = 1) -> Frame:
    mav = dialect.MAVLink(None, system, component)
    raw = message.pack(mav)
    return Frame(raw, mav.decode(bytearray(raw)))


def test_each_boat_gets_the_vessel_meant_for_it_and_strangers_none() -> None:
    harbour = Harbour(BoatPlan(WAMV, system=1), BoatPlan(IACQUABOT, system=7))
    harbour.beat(7, 9, 1, 9, 7)
    assert harbour.found == [("iacquabot", "IAcquaBot"), ("wam-v", "WAM-V")]
    assert harbour.ignored == [9]


def test_a_plan_for_a_system_goes_before_one_for_whoever_comes() -> None:
    harbour = Harbour(BoatPlan(WAMV), BoatPlan(IACQUABOT, system=2)).beat(2, 3)
    assert harbour.found == [("iacquabot", "IAcquaBot"), ("wam-v", "WAM-V")]


@pytest.mark.parametrize("order", [(1, 2, 12), (12, 2, 1)])
def test_names_never_collide_and_do_not_depend_on_who_comes_first(order: tuple[int, ...]) -> None:
    plans = [BoatPlan(WAMV, system=1), BoatPlan(WAMV, system=2)]
    harbour = Harbour(*plans, BoatPlan(WAMV, system=12, name="wam-v-1")).beat(*order)
    names = dict(zip(order, [name for name, _ in harbour.found], strict=True))
    assert names == {1: "wam-v-1-1", 2: "wam-v-2", 12: "wam-v-1"}


def test_ground_stations_and_cameras_are_no_boats() -> None:
    harbour = Harbour(BoatPlan(WAMV))
    harbour.beat(255, kind=STATION).beat(1, kind=(dialect.MAV_TYPE_CAMERA, 8), component=100)
    assert (harbour.found, harbour.ignored) == ([], [])
    harbour.beat(1)
    assert [name for name, _ in harbour.found] == ["wam-v"]


def test_only_the_autopilots_own_words_are_heard() -> None:
    harbour = Harbour(BoatPlan(WAMV)).beat(1)
    said = dialect.MAVLink_attitude_message(1000, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0)
    frames = (framed(said, 1, 100), framed(said, 2), framed(said, 1), Frame(b"unknown", None))
    answers = harbour.fleet.datagrams([Datagram("l", 10**18 + 1, frames)])
    assert {answer.boat.boat.system for answer in answers} == {1}
    (payload,) = harbour.fleet.boats[1].health.row(10**18 + 2, 0, 0).payloads
    assert orjson.loads(payload)["rate_hz"] == 2 / 5


def test_a_message_without_a_definition_is_not_lost() -> None:
    """PX4 sends some; one more frame is missing."""
    harbour, mav = Harbour(BoatPlan(WAMV)).beat(1), dialect.MAVLink(None, 1, 1)
    said, frames = dialect.MAVLink_attitude_message(1000, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0), []
    for k in range(21):
        raw = said.pack(mav)
        mav.seq += 1
        frames.append(Frame(raw, None) if k % 3 == 1 else Frame(raw, mav.decode(bytearray(raw))))
    del frames[13]
    list(harbour.fleet.datagrams([Datagram("l", 10**18 + 1, tuple(frames))]))
    (payload,) = harbour.fleet.boats[1].health.row(10**18 + 2, 0, 0).payloads
    heard = sum(frame.message is not None for frame in frames) + 1  # and the heartbeat
    assert orjson.loads(payload)["loss"] == pytest.approx(1 / (1 + heard))


def test_a_vessel_for_any_boat_follows_the_first_and_no_other() -> None:
    harbour = Harbour(BoatPlan(WAMV)).beat(9, 1, 9, *range(10, 251))
    assert list(harbour.fleet.boats) == [9]
    assert harbour.ignored == [1, *range(10, 251)]


def test_a_boat_that_has_its_own_plan_does_not_use_up_that_for_any() -> None:
    harbour = Harbour(BoatPlan(WAMV), BoatPlan(IACQUABOT, system=2)).beat(2, 3, 4)
    assert harbour.found == [("iacquabot", "IAcquaBot"), ("wam-v", "WAM-V")]
    assert harbour.ignored == [4]


def test_whoever_is_asked_for_by_id_is_bounded() -> None:
    plans = [BoatPlan(WAMV, system=number) for number in range(1, MAX_BOATS + 3)]
    harbour = Harbour(*plans).beat(*range(1, MAX_BOATS + 3))
    assert len(harbour.found) == MAX_BOATS
    assert harbour.ignored == [MAX_BOATS + 1, MAX_BOATS + 2]


def test_a_recording_holds_the_frames_of_its_boat_and_of_no_other() -> None:
    harbour = Harbour(BoatPlan(WAMV, system=1), BoatPlan(WAMV, system=2)).beat(1, 2, 3)
    said = dialect.MAVLink_attitude_message(1000, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0)
    unknown = Frame(framed(said, 255).raw, None)
    frames = (*(framed(said, system) for system in (1, 2, 3, 255)), unknown)
    assert harbour.fleet.recorded(frames) == {  # 3 is a boat without a vessel
        1: [frames[0].raw, frames[3].raw, unknown.raw],
        2: [frames[1].raw, frames[3].raw, unknown.raw],
    }


def test_invented_systems_do_not_fill_a_recording() -> None:
    harbour = Harbour(BoatPlan(WAMV)).beat(1)
    said = dialect.MAVLink_attitude_message(1000, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0)
    frames = tuple(framed(said, system) for system in range(2, 250))
    for _ in range(2):
        kept = harbour.fleet.recorded(frames)
        assert kept == {1: [frame.raw for frame in frames[:MAX_OTHERS]]}
    own = framed(said, 1)
    assert harbour.fleet.recorded((own,)) == {1: [own.raw]}


def test_frames_too_short_for_a_sender_have_none() -> None:
    assert sender(b"") == 0
    assert sender(b"\xfd\0\0\0\0") == 0
    assert sender(b"\xfe\0\0\x07") == 7


@pytest.fixture
def files(tmp_path: Path) -> tuple[str, str]:
    for name, vessel in (("a=b.toml", WAMV), ("c.toml", IACQUABOT)):
        (tmp_path / name).write_text(dump_vessel(vessel))
    return str(tmp_path / "a=b.toml"), str(tmp_path / "c.toml")


def test_vessels_by_system_id_on_the_command_line(files: tuple[str, str]) -> None:
    first, second = files
    plans = plans_of([f"1={first}", second], None, None, ())
    assert [(p.vessel.name, p.system, p.key) for p in plans] == [
        ("WAM-V", 1, "wam-v"), ("IAcquaBot", None, "iacquabot"),
    ]  # fmt: skip
    named = plans_of([f"1={second}", f"2={second}"], second, "duo", ())
    assert [(p.key, p.plant.vessel and p.plant.vessel.name) for p in named] == [
        ("duo-1", "IAcquaBot"), ("duo-2", "IAcquaBot"),
    ]  # fmt: skip


def test_a_file_that_is_called_like_a_system_is_that_file(
    files: tuple[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "1=b.toml").write_bytes(Path(files[1]).read_bytes())
    (plan,) = plans_of(["1=b.toml"], None, None, ())
    assert (plan.vessel.name, plan.system) == ("IAcquaBot", None)


@pytest.mark.parametrize("name", ["", "a/b", "*", "shadow#1"])
def test_a_name_that_is_no_key_is_one_line_at_the_start(files: tuple[str, str], name: str) -> None:
    with pytest.raises(BadInput, match="--name"):
        plans_of([files[0]], None, name, ())


def test_boats_of_the_configuration_are_shadowed(tmp_path: Path) -> None:
    (tmp_path / "boats").mkdir()
    for name in ("one", "two"):
        (tmp_path / "boats" / f"{name}.toml").write_text(dump_vessel(replace(WAMV, name=name)))
    config = tmp_path / "gateway.toml"
    config.write_text(
        '[[boats]]\nvessel = "boats/one.toml"\nsystem_id = 3\nname = "uno"\n'
        '[[boats]]\nvessel = "boats/two.toml"\nplant = "boats/one.toml"\n'
    )
    first, second = plans_in(load_settings(config).boats, ())
    assert (first.vessel.name, first.plant.vessel, first.system, first.name) == (
        "one",
        None,
        3,
        "uno",
    )
    assert second.vessel.name == "two"
    assert second.plant.vessel is not None
    assert second.plant.vessel.name == "one"
    assert (second.system, second.name) == (None, None)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('[[boats]]\nvessel = "a"\nname = "a/b"\n', "must not be empty nor contain"),
        ('[[boats]]\nvessel = "a"\nsystem_id = 255\n', "expected 1 to 254"),
    ],
)
def test_a_boat_of_the_configuration_that_cannot_be(tmp_path: Path, text: str, says: str) -> None:
    config = tmp_path / "gateway.toml"
    config.write_text(text)
    with pytest.raises(BadInput, match=says):
        load_settings(config)


@pytest.mark.parametrize(
    ("wanted", "says"),
    [
        (["0={}"], "SYSID 1 to 254"),
        (["255={}"], "SYSID 1 to 254"),
        (["x={}"], "x=/"),
        (["1={}", "1={}"], "two vessels for one boat"),
        (["{}", "{}"], "two vessels for one boat"),
        (["{}.not"], r"c\.toml\.not"),
    ],
)
def test_what_cannot_be_meant_is_one_line(
    files: tuple[str, str], wanted: list[str], says: str
) -> None:
    with pytest.raises(BadInput, match=says):
        plans_of([text.format(files[1]) for text in wanted], None, None, ())
