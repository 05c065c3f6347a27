"""gateway.toml → one typed, frozen object. Precedence: flag, then file, then default.

[[boats]]                   one per boat; without any, every boat of the log or link
system_id = 1
vessel = "wam-v.toml"       relative to this file
plant = "otter.toml"        what the follower drives; default: the vessel
name = "wam-v"              key on zenoh; default: the vessel's file name

[links]      endpoints = ["udpin:127.0.0.1:14550"]
[filter]     see gateway.estimation.settings
[zenoh]      publish, endpoint, config_file
[recording]  see gateway.recorder
[following]  reference, rate_hz, and the follower's options
"""

import tomllib
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, TypeAdapter, ValidationError, with_config

from gateway.bus import DEFAULT_ENDPOINT, BusSettings
from gateway.errors import BadInput
from gateway.estimation.settings import FilterSettings, White
from gateway.recorder import RecordingSettings
from gateway.vessel_file import checked, explain
from sim.following.options import Following
from sim.following.reference import Mode


@dataclass(frozen=True)
class BoatSettings:
    """One entry of `[[boats]]`."""

    vessel: str
    system_id: int | None = None
    plant: str | None = None
    name: str | None = None


@dataclass(frozen=True)
class LinkSettings:
    """Table `[links]`: where MAVLink comes from."""

    endpoints: tuple[str, ...] = ()


@dataclass(frozen=True)
class ZenohSettings:
    """Table `[zenoh]`: where the shadow is published."""

    publish: bool = True
    endpoint: str = DEFAULT_ENDPOINT  # listen there, or join whoever does
    config_file: str | None = None  # a zenoh configuration file, passed through

    def bus(self) -> BusSettings:
        """What the bus wants to know."""
        return BusSettings(self.endpoint, Path(self.config_file) if self.config_file else None)


@dataclass(frozen=True)
class FollowingSettings:
    """Table `[following]`: what the shadow follows, how, and how often it goes out."""

    reference: Mode = Mode.AUTO
    rate_hz: float = 50.0
    follower: Following = field(default_factory=Following)

    def __post_init__(self) -> None:
        if not 0.0 < self.rate_hz < float("inf"):
            raise BadInput(f"[following] rate_hz = {self.rate_hz}: expected a positive number")


@dataclass(frozen=True)
class Settings:
    """The resolved configuration: it goes into every recording."""

    boats: tuple[BoatSettings, ...] = ()
    links: LinkSettings = field(default_factory=LinkSettings)
    filter: FilterSettings = field(default_factory=FilterSettings)
    zenoh: ZenohSettings = field(default_factory=ZenohSettings)
    recording: RecordingSettings = field(default_factory=RecordingSettings)
    following: FollowingSettings = field(default_factory=FollowingSettings)

    def __post_init__(self) -> None:
        for name in ("chunk_bytes", "flush_seconds", "foxglove_hz"):
            value = getattr(self.recording, name)
            if not value > 0:
                raise BadInput(f"[recording] {name} = {value}: expected a positive number")


for _table in (
    BoatSettings, LinkSettings, ZenohSettings, FollowingSettings, Settings, FilterSettings, White,
    RecordingSettings, Following,
):  # fmt: skip
    with_config(ConfigDict(extra="forbid"))(_table)

_CHECKED = TypeAdapter(Settings)


def load_settings(path: str | Path | None) -> Settings:
    """Read and check gateway.toml; the defaults where no file is given."""
    if path is None:
        return Settings()
    file = Path(path)
    try:
        tables = tomllib.loads(file.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadInput(f"{file}: not a TOML file: {error}") from None
    except OSError as error:
        raise BadInput(f"{file}: cannot read the configuration: {error.strerror}") from None
    return settings_of(tables, str(file))


def settings_of(tables: dict[str, Any], where: str) -> Settings:
    """Tables over the defaults, checked; `where` they stand goes into the message."""
    try:
        return checked(_CHECKED, _over(as_tables(Settings()), tables))
    except ValidationError as error:
        raise BadInput(f"{where}: {explain(error)}") from None
    except BadInput as error:
        raise BadInput(f"{where}: {error}") from None


def _over(defaults: dict[str, Any], given: dict[str, Any]) -> dict[str, Any]:
    """Tables over tables, key by key: one given number leaves its neighbours as they were."""
    out = dict(defaults)
    for key, value in given.items():
        nested = isinstance(value, dict) and isinstance(out.get(key), dict)
        out[key] = _over(out[key], value) if nested else value
    return out


def as_tables(value: Any) -> Any:
    """A settings object as plain tables that TOML and JSON can hold; None is left out."""
    if is_dataclass(value):
        items = {f.name: getattr(value, f.name) for f in fields(value)}
        return {k: as_tables(v) for k, v in items.items() if v is not None}
    if isinstance(value, dict) or hasattr(value, "items"):
        return {k: as_tables(v) for k, v in value.items()}
    if isinstance(value, tuple | list):
        return [as_tables(v) for v in value]
    return value.value if isinstance(value, Enum) else value
