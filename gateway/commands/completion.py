"""What a shell offers for a word that was begun: vessels, effects, manoeuvres, formats.

What there is is imported when a shell asks: a command starts without it.
"""

from collections.abc import Callable, Iterable
from pathlib import Path


def _completing(names: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """What a shell offers for a word that was begun."""

    def begun(incomplete: str) -> list[str]:
        return [name for name in names() if name.startswith(incomplete)]

    return begun


def _vessels() -> list[str]:
    from gateway.files import vessel_names

    return [*vessel_names(), *sorted(map(str, Path().glob("*.toml")))]


def _effects() -> list[str]:
    from sim.effects.catalogue import EFFECTS

    return [effect.name for effect in EFFECTS]


def _manoeuvres() -> list[str]:
    from sim.excitation.catalogue import MANOEUVRES

    return [manoeuvre.name for manoeuvre in MANOEUVRES]


def _formats() -> list[str]:
    from gateway.offline.export import ExportFormat

    return list(ExportFormat)


vessels_begun = _completing(_vessels)
effects_begun = _completing(_effects)
manoeuvres_begun = _completing(_manoeuvres)
formats_begun = _completing(_formats)
