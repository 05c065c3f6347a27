"""Which vessel shadows which boat: `--vessel` of the command line, `[[boats]]` of a file."""

from collections.abc import Sequence

from gateway.config import BoatSettings
from gateway.errors import BadInput
from gateway.files import check_name, named_vessel
from gateway.live.boats import BoatPlan
from gateway.plants import load_plant
from gateway.vessel_file import load_vessel
from sim.effects.effect import Effect


def plans_of(
    vessels: Sequence[str], plant: str | None, name: str | None, effects: Sequence[Effect]
) -> list[BoatPlan]:
    """`--vessel FILE` and `--vessel SYSID=FILE` -> the vessel of each boat."""
    if name is not None:
        check_name(name, "--name")
    played_by = load_plant(plant, effects)
    plans = []
    for text in vessels:
        number, file = named_vessel(text)
        if number is None or not number.isdecimal():
            number, file = "", text
        elif not 1 <= int(number) <= 254:
            raise BadInput(f"--vessel {text}: expected FILE or SYSID=FILE, SYSID 1 to 254")
        system = int(number) if number else None
        key = name if name is None or len(vessels) == 1 else f"{name}-{number or 'any'}"
        plans.append(BoatPlan(load_vessel(file, effects), played_by, system, key))
    return _distinct(plans, "--vessel: two vessels for one boat; give SYSID=FILE for each boat")


def plans_in(boats: Sequence[BoatSettings], effects: Sequence[Effect]) -> list[BoatPlan]:
    """`[[boats]]` of the configuration -> the vessel of each boat."""
    plans = [
        BoatPlan(
            load_vessel(boat.vessel, effects),
            load_plant(boat.plant, effects),
            boat.system_id,
            boat.name,
        )
        for boat in boats
    ]
    return _distinct(plans, "[[boats]]: two vessels for one boat; give each its system_id")


def _distinct(plans: list[BoatPlan], message: str) -> list[BoatPlan]:
    systems = [plan.system for plan in plans]
    if len(set(systems)) < len(systems):
        raise BadInput(message)
    return plans
