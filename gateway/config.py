"""gateway.toml → one typed, frozen object. Precedence: flag, then file, then default.

[[boats]]                   which boats `shadow live` shadows where no --vessel is given
system_id = 1               may be left out where there is one boat
vessel = "wam-v.toml"       relative to this file
plant = "otter.toml"        what the follower drives, or KIND[:FILE]; default: the vessel
name = "wam-v"              key on zenoh; default: the vessel's name

[links]      endpoints = ["udpin:127.0.0.1:14550"]
[links.rates]               Hz, by message: what boats are asked for; 0: not asked for
preset = "radio"            what stands under these: full (default), or radio for 57600 baud
ATTITUDE = 20.0
[filter]     see gateway.estimation
[zenoh]      publish, endpoint, config_file, keelson (base path of Keelson's keys, beside ours)
[foxglove]   address = "8765", or "HOST:PORT": a WebSocket server for players
[metrics]    address = "9464", or "HOST:PORT": Prometheus metrics of `shadow live`
[recording]  see gateway.recording.recorder
[following]  reference, rate_hz, adapt (off, watch, apply), and the follower's options
[studio]                    the map, fetched once somebody switches it on
tiles = "https://…"         address of a tile with {Z}, {X} and {Y} for its numbers (Web Mercator),
                            or a file, NAME.mbtiles or NAME.pmtiles, from where the studio starts
attribution = "© …"         whose map it is; addresses in it become links
deepest = 19                zoom beyond which the source has no tiles
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Any
from urllib.parse import urlparse

import orjson
import tomli_w
from pydantic import ConfigDict, TypeAdapter, ValidationError, with_config

from gateway.bus import DEFAULT_ENDPOINT, BusSettings
from gateway.errors import BadInput
from gateway.estimation import FilterSettings, WhiteNoise
from gateway.files import check_name
from gateway.ingest.mcap import MAGIC
from gateway.keelson import check_base
from gateway.links.rate_requests import FULL_HZ, PRESETS, check_rates
from gateway.plants import plant_relative_to
from gateway.recording.foxglove_server import parse_address
from gateway.recording.origin_gate import ORIGIN
from gateway.recording.reader import Recording
from gateway.recording.recorder import RecordingSettings
from gateway.shadow.model_monitor import Adapt
from gateway.toml_file import explain, read_toml, validated
from sim.following.follower import FollowerOptions, ReferenceMode
from sim.near_names import did_you_mean

OPENSTREETMAP = "https://tile.openstreetmap.org/{Z}/{X}/{Y}.png"
CREDIT = "© OpenStreetMap contributors, https://www.openstreetmap.org/copyright"
DEEPEST = 24


@dataclass(frozen=True)
class StudioSettings:
    """Table `[studio]`: where map tiles come from."""

    tiles: str = OPENSTREETMAP
    attribution: str = CREDIT
    deepest: int = 19

    def __post_init__(self) -> None:
        if self.file is not None:
            if not self.file.is_file():
                raise BadInput(f"[studio] tiles = {self.tiles!r}: no such file")
            return
        where = urlparse(self.tiles)
        whole = where.scheme in ("http", "https") and where.netloc
        if not whole or any(self.tiles.count(part) != 1 for part in ("{Z}", "{X}", "{Y}")):
            raise BadInput(
                f"[studio] tiles = {self.tiles!r}: expected an address like {OPENSTREETMAP}"
            )
        if not 0 <= self.deepest <= DEEPEST:
            raise BadInput(f"[studio] deepest = {self.deepest}: expected a zoom, 0 to {DEEPEST}")

    @property
    def file(self) -> Path | None:
        """The file that tiles are read from; None where a server is asked."""
        return Path(self.tiles) if self.tiles.endswith((".mbtiles", ".pmtiles")) else None

    @property
    def source(self) -> str:
        """Where tiles come from, as the end of a sentence."""
        file = self.file
        return f"asked of {urlparse(self.tiles).netloc}" if file is None else f"from {file.name}"

    def tile(self, zoom: int, x: int, y: int) -> str:
        """Address of one tile; of a file, at the studio's own server."""
        if self.file is not None:
            return f"tiles/{zoom}/{x}/{y}"
        address = self.tiles.replace("{Z}", str(zoom))
        return address.replace("{X}", str(x)).replace("{Y}", str(y))


@dataclass(frozen=True)
class BoatSettings:
    """One entry of `[[boats]]`."""

    vessel: str
    system_id: int | None = None
    plant: str | None = None
    name: str | None = None

    def __post_init__(self) -> None:
        if self.name is not None:
            check_name(self.name, "[[boats]] name")
        if self.system_id is not None and not 1 <= self.system_id <= 254:
            raise BadInput(f"[[boats]] system_id = {self.system_id}: expected 1 to 254")


@dataclass(frozen=True)
class LinkSettings:
    """Table `[links]`: where MAVLink comes from, and the rates that boats are asked for [Hz]."""

    endpoints: tuple[str, ...] = ()
    rates: Mapping[str, float] = field(default_factory=lambda: FULL_HZ)

    def __post_init__(self) -> None:
        check_rates(self.rates)


@dataclass(frozen=True)
class ZenohSettings:
    """Table `[zenoh]`: where the shadow is published."""

    publish: bool = True
    endpoint: str = DEFAULT_ENDPOINT  # listen there, or join the router that does
    config_file: str | None = None  # a zenoh configuration file, passed through
    keelson: str | None = None  # base path of Keelson's keys; None: ours alone

    def __post_init__(self) -> None:
        if self.keelson is not None:
            check_base(self.keelson)

    def bus(self) -> BusSettings:
        """The settings of a bus."""
        file = Path(self.config_file) if self.config_file else None
        return BusSettings(self.endpoint, file, self.keelson)


@dataclass(frozen=True)
class FoxgloveSettings:
    """Table `[foxglove]`: a live WebSocket server, where an address is given."""

    address: str | None = None  # [HOST:]PORT
    origins: tuple[str, ...] = ()  # of web pages that may watch, beside Foxglove's and Lichtblick's

    def __post_init__(self) -> None:
        if self.address is not None:
            parse_address(self.address)
        for origin in self.origins:
            if not ORIGIN.fullmatch(origin):
                raise BadInput(
                    f'[foxglove] origins: "{origin}": expected such as https://example.org:8443'
                )


@dataclass(frozen=True)
class MetricsSettings:
    """Table `[metrics]`: Prometheus metrics over HTTP, where an address is given."""

    address: str | None = None  # [HOST:]PORT

    def __post_init__(self) -> None:
        if self.address is not None:
            parse_address(self.address, "metrics")


@dataclass(frozen=True)
class FollowingSettings:
    """Table `[following]`: what the shadow follows, how, and how often it goes out.

    adapt  whether the vessel's numbers are followed while sailing, and used for the shadow
    """

    reference: ReferenceMode = ReferenceMode.AUTO
    rate_hz: float = 50.0
    adapt: Adapt = Adapt.OFF
    follower: FollowerOptions = field(default_factory=FollowerOptions)

    def __post_init__(self) -> None:
        if not 0.1 <= self.rate_hz <= 1000.0:
            raise BadInput(f"[following] rate_hz = {self.rate_hz}: expected 0.1 to 1000 Hz")


@dataclass(frozen=True)
class Settings:
    """The resolved configuration: it goes into every recording."""

    boats: tuple[BoatSettings, ...] = ()
    links: LinkSettings = field(default_factory=LinkSettings)
    filter: FilterSettings = field(default_factory=FilterSettings)
    zenoh: ZenohSettings = field(default_factory=ZenohSettings)
    foxglove: FoxgloveSettings = field(default_factory=FoxgloveSettings)
    metrics: MetricsSettings = field(default_factory=MetricsSettings)
    recording: RecordingSettings = field(default_factory=RecordingSettings)
    following: FollowingSettings = field(default_factory=FollowingSettings)
    studio: StudioSettings = field(default_factory=StudioSettings)

    def __post_init__(self) -> None:
        for name in ("chunk_bytes", "flush_seconds", "foxglove_hz", "topics_hz"):
            value = getattr(self.recording, name)
            if not value > 0:
                raise BadInput(f"[recording] {name} = {value}: expected a positive number")


for _table in (
    BoatSettings, LinkSettings, ZenohSettings, FoxgloveSettings, MetricsSettings,
    FollowingSettings, Settings, FilterSettings, WhiteNoise, RecordingSettings, FollowerOptions,
    StudioSettings,
):  # fmt: skip
    with_config(ConfigDict(extra="forbid"))(_table)

_SETTINGS = TypeAdapter(Settings)
HINTS = {  # comments of `as_toml` below the heads of tables
    "[links.rates]": '# Hz; 0: not asked for. preset = "radio": what a pair at 57600 baud carries',
    "[filter]": (
        "# gyro_delay_s and gyro_delay_std_s both 0: as the autopilot's parameters tell, else its\n"
        "# usual; a std alone, 0.001, says that there is none"
    ),
    "[metrics]": '# address = "9464" or "HOST:PORT": Prometheus metrics',
    "[foxglove]": '# address = "8765" or "HOST:PORT": a live WebSocket server',
}


def load_settings(path: str | Path | None) -> Settings:
    """Read and check gateway.toml; the defaults where no file is given."""
    if path is None:
        return Settings()
    file = Path(path)
    tables = read_toml(file, "the configuration")
    settings = settings_of(tables, str(file))
    return replace(settings, boats=tuple(_relative_to(file, boat) for boat in settings.boats))


ESTIMATING = ("filter", "following")  # what a recording's own configuration may decide


def recorded_settings(log_path: Path) -> Settings | None:
    """How a recording of ours was estimated, over the defaults; None for any other log.

    A recording is data: where to listen, publish or write is never taken from it.
    """
    with log_path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            return None
    attached = Recording.open(log_path).attachments.get("config.json")
    if attached is None:
        return None
    try:
        tables = orjson.loads(attached.data)
    except orjson.JSONDecodeError:
        tables = None
    if not isinstance(tables, dict):
        raise BadInput(
            f"{log_path}: its config.json is damaged: give the configuration with --config FILE"
        )
    chosen = {name: tables[name] for name in ESTIMATING if name in tables}
    return settings_of(chosen, f"{log_path}: config.json")


def _relative_to(file: Path, boat: BoatSettings) -> BoatSettings:
    """Vessel files are given relative to the configuration."""
    plant = None if boat.plant is None else plant_relative_to(file.parent, boat.plant)
    return replace(boat, vessel=str(file.parent / boat.vessel), plant=plant)


def settings_of(tables: dict[str, Any], where: str) -> Settings:
    """Tables over the defaults, validated; `where` they come from goes into the message."""
    try:
        given = _without_retired(_with_preset_rates(tables))
        return validated(_SETTINGS, _merged(as_tables(Settings()), given))
    except ValidationError as error:
        raise BadInput(f"{where}: {explain(error)}") from None
    except BadInput as error:
        raise BadInput(f"{where}: {error}") from None


def _with_preset_rates(tables: dict[str, Any]) -> dict[str, Any]:
    """`[links.rates] preset` replaced by its rates; rates that are given go over them."""
    match tables:
        case {"links": {"rates": {"preset": preset, **own}, **links}}:
            if not isinstance(preset, str) or preset not in PRESETS:
                meant = did_you_mean(str(preset), PRESETS)
                raise BadInput(
                    f"links.rates.preset = {preset!r}: {meant}expected {', '.join(PRESETS)}"
                )
            return {**tables, "links": {**links, "rates": {**PRESETS[preset], **own}}}
    return tables


# Of [filter.sources]: nothing ever read it. Recordings and files of before hold it and still load.
RETIRED = "acceleration_mps2"


def _without_retired(tables: dict[str, Any]) -> dict[str, Any]:
    """The same without a key that was once there and did nothing."""
    match tables:
        case {"filter": {"sources": dict() as sources, **others}}:
            kept = {
                name: {key: value for key, value in noise.items() if key != RETIRED}
                for name, noise in sources.items()
                if isinstance(noise, dict)
            }
            return {**tables, "filter": {**others, "sources": {**sources, **kept}}}
    return tables


def _merged(defaults: dict[str, Any], given: dict[str, Any]) -> dict[str, Any]:
    """Tables over defaults, key by key: keys that are not given keep their defaults."""
    out = dict(defaults)
    for key, value in given.items():
        nested = isinstance(value, dict) and isinstance(out.get(key), dict)
        out[key] = _merged(out[key], value) if nested else value
    return out


def as_tables(value: Any) -> Any:
    """A settings object as plain tables that TOML and JSON can hold; None is left out."""
    if is_dataclass(value):
        items = {f.name: getattr(value, f.name) for f in fields(value)}
        return {k: as_tables(v) for k, v in items.items() if v is not None}
    if isinstance(value, Mapping):
        return {k: as_tables(v) for k, v in value.items()}
    if isinstance(value, tuple | list):
        return [as_tables(v) for v in value]
    return value.value if isinstance(value, Enum) else value


def as_toml(settings: Settings) -> str:
    """The configuration as a file that can be read again, with comments on what is not shown."""
    lines = tomli_w.dumps(as_tables(settings)).splitlines()
    return "\n".join([f"{line}\n{HINTS[line]}" if line in HINTS else line for line in lines]) + "\n"
