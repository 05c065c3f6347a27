"""The one table: what becomes of each message. SIM_STATE, SIMSTATE and SIM* are never read."""

from collections.abc import Mapping

from gateway.ingest.mapping import actuators, attitude, condition, dataflash, inertial, motion
from gateway.ingest.mapping.rule import Rule

MAVLINK: tuple[Rule, ...] = (
    *attitude.RULES,
    *motion.RULES,
    *inertial.RULES,
    *actuators.MAVLINK,
    *condition.RULES,
)
DATAFLASH: tuple[Rule, ...] = (*dataflash.RULES, *actuators.DATAFLASH)


def rules(kind: str) -> tuple[Rule, ...]:
    """The rules for a kind of log: the same name means different things in the two dialects."""
    return DATAFLASH if kind == "dataflash" else MAVLINK


def by_message(table: tuple[Rule, ...]) -> Mapping[str, tuple[Rule, ...]]:
    """Message name -> its rules."""
    names = {rule.message for rule in table}
    return {name: tuple(rule for rule in table if rule.message == name) for name in names}
