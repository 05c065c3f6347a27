"""The one table: what becomes of each message. SIM_STATE, SIMSTATE and SIM* are never read."""

from collections.abc import Mapping

from gateway.ingest.mapping import dataflash
from gateway.ingest.mapping.motion import ATTITUDE_RULES, INERTIAL_RULES, MOTION_RULES
from gateway.ingest.mapping.rule import Rule
from gateway.ingest.mapping.vehicle import ACTUATOR_RULES, CONDITION_RULES, DATAFLASH_ACTUATOR_RULES

MAVLINK: tuple[Rule, ...] = (
    *ATTITUDE_RULES,
    *MOTION_RULES,
    *INERTIAL_RULES,
    *ACTUATOR_RULES,
    *CONDITION_RULES,
)
DATAFLASH: tuple[Rule, ...] = (*dataflash.RULES, *DATAFLASH_ACTUATOR_RULES)


def rules(kind: str) -> tuple[Rule, ...]:
    """The rules for a kind of log: the same name means different things in the two dialects."""
    return DATAFLASH if kind == "dataflash" else MAVLINK


def by_message(table: tuple[Rule, ...]) -> Mapping[str, tuple[Rule, ...]]:
    """Message name -> its rules."""
    names = {rule.message for rule in table}
    return {name: tuple(rule for rule in table if rule.message == name) for name in names}
