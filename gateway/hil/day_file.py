"""day.toml: what a day brings to a boat in the loop. TOML → validated tables → `sim.hil.day.Day`.

docs/hil.md describes the format. Every mistake is one line: file, key, what was expected.
"""

from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

from annotated_types import Ge, Gt, Le
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from gateway.errors import BadInput
from gateway.toml_file import MAX_TOLD, explain, read_toml, shortened, validated
from gateway.user_effects import known_effects
from gateway.vessel_file import check_effect, no_effect
from gateway.vessel_tables import Bearing, StrictTable, Word
from sim.effects.catalogue import EFFECTS
from sim.effects.effect import Effect, Need
from sim.hil.day import Day, Moment, Wind
from sim.near_names import did_you_mean
from sim.plants import OWN_VESSEL, PlantChoice
from sim.plants.waves import Sea
from sim.vessel import AddedEffect, Vessel
from sim.wind import areas_text

NotNegative = Annotated[float, Ge(0.0)]
MAX_GAIN = 2.0  # of a thruster: more than twice its thrust is a mistake; chosen


class WindTable(StrictTable):
    """[wind]: speed [m/s], direction that it blows from [rad from north]"""

    speed: NotNegative
    direction: Bearing


class WavesTable(StrictTable):
    """[waves]: significant height [m], peak period [s], direction that they run to [rad]"""

    height: NotNegative
    period: Annotated[float, Gt(0.0)]
    direction: Bearing = 0.0


class StartTable(StrictTable):
    """[start]: where the boat lies at first [m, m, rad], and where that is counted from [deg]"""

    north: float = 0.0
    east: float = 0.0
    yaw: Bearing = 0.0
    latitude: Annotated[float, Ge(-89.0), Le(89.0)] = Day().place[0]
    longitude: Annotated[float, Ge(-180.0), Le(180.0)] = Day().place[1]


class MomentTable(StrictTable):
    """[[moments]]: what changes `at` [s]; numbers of an effect stand beside its name"""

    model_config = ConfigDict(extra="allow", frozen=True, allow_inf_nan=False)

    at: NotNegative
    over: NotNegative = 0.0
    effect: Word | None = None
    thruster: Word | None = None
    gain: Annotated[float, Ge(0.0), Le(MAX_GAIN)] | None = None
    wind: WindTable | None = None


class DayFile(StrictTable):
    """A day as written."""

    depth: Annotated[float, Gt(0.0)] | None = None
    start: StartTable = StartTable()
    wind: WindTable | None = None
    waves: WavesTable | None = None
    effects: tuple[dict[str, Any], ...] = ()
    moments: Annotated[tuple[MomentTable, ...], Field()] = ()


_DAY_FILE = TypeAdapter(DayFile)


def load_day(file: Path, more_effects: Sequence[Effect] = ()) -> tuple[Day, str]:
    """A day and its text; BadInput with one line where it is wrong."""
    known = {effect.name: effect for effect in (*known_effects(), *more_effects)}
    try:
        read = validated(_DAY_FILE, read_toml(file, "the day"))
    except ValidationError as error:
        raise BadInput(f"{file}: {explain(error)}") from None
    try:
        return _day(read, known), file.read_text(encoding="utf-8")
    except (ValueError, BadInput) as error:
        raise BadInput(f"{file}: {shortened(str(error), MAX_TOLD)}") from None


def _day(read: DayFile, known: Mapping[str, Effect]) -> Day:
    return Day(
        effects=tuple(_effect(i, entry, known) for i, entry in enumerate(read.effects)),
        moments=tuple(_moment(i, table, known) for i, table in enumerate(read.moments)),
        wind=None if read.wind is None else Wind(**dict(read.wind)),
        sea=None if read.waves is None else Sea(**dict(read.waves)),
        depth=read.depth,
        start=(read.start.north, read.start.east, read.start.yaw),
        place=(read.start.latitude, read.start.longitude),
    )


def _effect(i: int, entry: dict[str, Any], known: Mapping[str, Effect]) -> AddedEffect:
    values = dict(entry)
    effect = _known(f"effects[{i}].type", values.pop("type", None), known)
    added = AddedEffect(effect, _numbers(f"effects[{i}]", values))
    check_effect(f"effects[{i}]", effect.parameters, added.values)
    return added


def _moment(i: int, table: MomentTable, known: Mapping[str, Effect]) -> Moment:
    key = f"moments[{i}]"
    values = _numbers(key, table.model_extra or {})
    changes = [table.effect, table.thruster, table.wind]
    if all(change is None for change in changes):
        raise ValueError(f"{key}: nothing changes: expected effect, thruster or wind")
    if (table.thruster is None) != (table.gain is None):
        raise ValueError(f"{key}: thruster and gain (share of its thrust that is left) go together")
    if table.effect is None and values:
        raise ValueError(f"{key}: unknown key {shortened(next(iter(values)))}")
    effect = None if table.effect is None else _known(f"{key}.effect", table.effect, known)
    parameters = effect.parameters if effect is not None else ()
    names = [p.name for p in parameters]
    unknown = [name for name in values if name not in names]
    if effect is not None and (unknown or not values):
        what = f"unknown key {shortened(unknown[0])}" if unknown else "no number of it changes"
        meant = did_you_mean(unknown[0], names) if unknown else ""
        raise ValueError(f"{key}: {what}: {meant}{effect.name} has {', '.join(names)}")
    check_effect(key, [p for p in parameters if p.name in values], values)
    wind = None if table.wind is None else Wind(**dict(table.wind))
    gain = 1.0 if table.gain is None else table.gain
    return Moment(table.at, table.over, effect, values, table.thruster, gain, wind)


def _known(key: str, name: Any, known: Mapping[str, Effect]) -> Effect:
    if name not in known:
        raise ValueError(no_effect(key, name, known))
    return known[name]


def _numbers(key: str, values: Mapping[str, Any]) -> dict[str, float]:
    for name, value in values.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
            raise ValueError(
                f"{key}.{shortened(name)} = {shortened(repr(value))}: expected a number"
            )
    return {name: float(value) for name, value in values.items()}


def _is_steady_wind(effect: Effect) -> bool:
    """Whether it is wind alone, of a speed from a direction, and nothing of when."""
    given = {parameter.name for parameter in effect.parameters if parameter.default is None}
    return Need.WIND_AREA in effect.needs and given == {"speed", "direction"}


def wind_told(day: Day, boat: Vessel, plant: PlantChoice = OWN_VESSEL) -> str:
    """That the day's wind pushes nothing, or on which areas it acts that nobody gave; else empty.

    `boat` has the effects of the day. What the table of a plant makes of wind is its own business.
    """
    winds = [wind for wind in (day.wind, *(moment.wind for moment in day.moments)) if wind]
    strongest = max(winds, key=lambda wind: wind.speed, default=Wind(0.0, 0.0))
    vessels = [boat] if plant.vessel is None else [boat, plant.vessel]
    if boat.assumes_wind_area:
        return f"{areas_text(*boat.hull.areas)}; give hull.wind_area in the vessel file"
    felt = any(Need.WIND_AREA in added.effect.needs for v in vessels for added in v.effects)
    if felt or plant.table or strongest.speed <= 0.0:
        return ""
    pushed = next(effect for effect in EFFECTS if _is_steady_wind(effect))
    return (
        f"the day's wind of {strongest.speed:g} m/s turns the wind vane and pushes nothing, since "
        "the vessel has no effect for wind: to have it pushed, add [[effects]] to the day with "
        f'type = "{pushed.name}", speed = {strongest.speed:g} and direction = '
        f"{strongest.direction:g}"
    )
