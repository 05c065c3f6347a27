"""`shadow vessel`: where the numbers of a vessel file come from, and how two files differ."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gateway.vessel_file import edited_numbers, load_vessel, number_name, read_vessel_file
from gateway.vessel_tables import Provenance, VesselFile
from sim.effects.effect import Effect
from sim.identification.parameters import UNITS
from sim.model import parameters_of
from sim.vessel import Vessel

GIVEN = "given"  # the origin of a number that the file says nothing about


@dataclass(frozen=True)
class Number:
    """One number of a vessel; `edited`: it is another one than its provenance gave."""

    name: str
    value: float
    unit: str
    origin: Provenance | None
    edited: bool = False

    @property
    def source(self) -> str:
        """Where it comes from, in words."""
        if self.origin is None:
            return GIVEN
        parts = (self.origin.fit, self.origin.recording, self.origin.date, self.origin.says)
        known = ", ".join(part for part in parts if part)
        if self.edited and self.origin.value is not None:
            return f"edited by hand, within its interval; {self.origin.value:.5g} by {known}"
        return known

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        origin = {} if self.origin is None else self.origin.model_dump(exclude_defaults=True)
        return {"name": self.name, "value": self.value, "unit": self.unit, "edited": self.edited,
                "origin": origin}  # fmt: skip


@dataclass(frozen=True)
class Passport:
    """A vessel file: its vessel, its tables, and every number with its origin."""

    path: Path
    vessel: Vessel
    tables: VesselFile
    numbers: tuple[Number, ...]

    def number(self, name: str) -> Number | None:
        """The number of that name."""
        return next((one for one in self.numbers if one.name == name), None)

    def to_dict(self) -> dict[str, Any]:
        """What `shadow vessel show --json` prints."""
        return {
            "file": str(self.path), "name": self.vessel.name, "source": self.vessel.source,
            "effects": [added.effect.name for added in self.vessel.effects],
            "numbers": [one.to_dict() for one in self.numbers],
        } | self.history_as_dict()  # fmt: skip

    def history_as_dict(self) -> dict[str, Any]:
        """What `shadow vessel history --json` prints."""
        return {"history": [one.model_dump() for one in self.tables.history]}


@dataclass(frozen=True)
class Difference:
    """A number that two files do not share; None where a file has none of that name.

    beyond  whether it has left the 95 % interval of either; None where neither states one
    """

    name: str
    unit: str
    first: float | None
    second: float | None
    beyond: bool | None

    @property
    def share(self) -> float | None:
        """Change relative to the first, more damping positive; None without one, or from zero."""
        if self.first is None or self.second is None or self.first == 0.0:
            return None
        return self.second / self.first - 1.0

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**vars(self), "share": self.share}


def passport(path: str | Path, effects: Iterable[Effect] = ()) -> Passport:
    """Read a vessel file with the origins of its numbers; BadInput where it is wrong."""
    vessel, tables = load_vessel(path, effects), read_vessel_file(path)
    origins = {number_name(key): (key, origin) for key, origin in tables.provenance.items()}
    edited, units = edited_numbers(tables, vessel), _units(vessel)
    numbers = []
    for name, value in parameters_of(vessel).items():
        key, origin = origins.get(name, (name, None))
        numbers.append(Number(name, value, units.get(name, ""), origin, key in edited))
    return Passport(Path(path), vessel, tables, tuple(numbers))


def _units(vessel: Vessel) -> dict[str, str]:
    """Units by name: those of the vessel file's numbers, and those that effects declare."""
    out = {name: UNITS.get(name.rpartition(".")[2], "") for name in parameters_of(vessel)}
    for added in vessel.effects:
        out |= {f"{added.effect.name}.{p.name}": p.unit for p in added.effect.parameters}
    return out


def differences(first: Passport, second: Passport) -> list[Difference]:
    """All numbers that differ, in the order of the first file."""
    names = dict.fromkeys(one.name for one in (*first.numbers, *second.numbers))
    out = []
    for name in names:
        a, b = first.number(name), second.number(name)
        first_value, second_value = (None if n is None else n.value for n in (a, b))
        if first_value != second_value:
            unit = next(n.unit for n in (a, b) if n is not None)
            out.append(Difference(name, unit, first_value, second_value, _beyond(a, b)))
    return out


def _beyond(a: Number | None, b: Number | None) -> bool | None:
    if a is None or b is None:
        return None
    held = [
        one.origin.ci95[0] <= other.value <= one.origin.ci95[1]
        for one, other in ((a, b), (b, a))
        if one.origin is not None and one.origin.ci95 is not None
    ]
    return not all(held) if held else None


def outputs_that_differ(first: Vessel, second: Vessel) -> list[str]:
    """A sentence for each actuator that only one has, or that is wired in another way."""
    ours, theirs = ({a.name: a for a in v.actuators} for v in (first, second))
    out = [f"{name}: only in the first" for name in ours.keys() - theirs.keys()]
    out += [f"{name}: only in the second" for name in theirs.keys() - ours.keys()]
    for name in ours.keys() & theirs.keys():
        if ours[name].servo != theirs[name].servo:
            out.append(f"{name}: {ours[name].servo} is {theirs[name].servo}")
    return sorted(out)


def diff_as_dict(first: Passport, second: Passport) -> dict[str, Any]:
    """What `shadow vessel diff --json` prints."""
    return {
        "first": str(first.path), "second": str(second.path),
        "numbers": [one.to_dict() for one in differences(first, second)],
        "outputs": outputs_that_differ(first.vessel, second.vessel),
    }  # fmt: skip
