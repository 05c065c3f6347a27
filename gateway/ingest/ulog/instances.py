"""Which instances of a topic are read, and which outputs are pulses: the rules for one ULog.

PX4 numbers the publishers of one topic: receivers, batteries, drivers of outputs, its several EKFs.

**Receivers, batteries and the like**: each instance is a source, the one that tells most first.

**The EKF** is the one in use (`estimator_selector_status`).

**Outputs.** What `actuator_outputs` holds depends on the driver: pulses of 800 to 2200 µs (PWM),
0 … 1999 (DShot), 0 … 8191 (CAN), 0 … 1000 or −1 … 1 (simulators). A driver whose values leave the
range of pulses has none; DShot may stay inside it and is known by its parameters, where all groups
of outputs are set to it. Where such a driver moves anything, the commands of motors and servos are
read instead of all pulses, since the channels of both would be mixed up.

Source: PX4-Autopilot, src/drivers/*/module.yaml (limits of each output), v1.13 to v1.16.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gateway.ingest.dataflash.lanes import MAX_LANES, LanesInUse
from gateway.ingest.log import Log, Table, numbers
from gateway.ingest.mapping import FIX_3D, Rule
from gateway.ingest.ulog.mapping import (
    COMMANDS,
    ESTIMATORS,
    INSTANCE,
    OUTPUTS,
    PORTS,
    RULES,
    output_rule,
)
from sim.state import Floats

LOWEST_US, HIGHEST_US = 800.0, 2200.0  # of all pulses that PX4's drivers can be set to
STRAY = 0.01  # share of an instance's rows that may be damaged
SELECTOR, SELECTED = "estimator_selector_status", "primary_instance"
TIMER = re.compile(r"PWM_(MAIN|AUX)_TIM\d+")  # protocol of a group of outputs
DSHOT = range(-8, -1)


def rules_for(log: Log, settings: Mapping[str, float]) -> tuple[list[Rule], tuple[str, ...]]:
    """The rules of a log with its instances, and what is told of its outputs."""
    outputs, notices = _output_rules(log, settings)
    out = list[Rule]()
    for rule in RULES:
        if rule.message == OUTPUTS:
            out += outputs
        elif rule.message in ESTIMATORS:
            out.append(_lowest(rule, log))
        else:
            out += _of_each_instance(rule, log)
    return out, notices


def _lowest(rule: Rule, log: Log) -> Rule:
    """The rule for the first instance, which counts where nothing says which one is in use."""
    numbers_of = log.table(rule.message).columns.get(INSTANCE, np.zeros(1))
    return replace(rule, number=int(np.min(numbers_of)))


def _of_each_instance(rule: Rule, log: Log) -> list[Rule]:
    """The rule once for each instance, the best first; the first of them keeps its name."""
    if rule.message not in log.counts():
        return [rule]
    table = log.table(rule.message)
    number = np.asarray(table.columns[INSTANCE])
    present = sorted(np.unique(number).tolist(), key=lambda one: (-_fixes(table, one), one))
    return [
        replace(rule, number=one, source=rule.source + (f"/{one}" if one != present[0] else ""))
        for one in present
    ]


def _fixes(table: Table, instance: int) -> int:
    """How often a receiver had a 3-D fix; 0 for what is none."""
    if "fix_type" not in table.columns:
        return 0
    mine = np.asarray(table.columns[INSTANCE]) == instance
    return int(np.count_nonzero(numbers(table.columns["fix_type"])[mine] >= FIX_3D))


def _output_rules(log: Log, settings: Mapping[str, float]) -> tuple[list[Rule], tuple[str, ...]]:
    """Rules of the instances whose outputs are pulses, and what there is to say of them."""
    if OUTPUTS not in log.counts():
        return [], ()
    table = log.table(OUTPUTS)
    values = table.columns.get("output")
    if values is None or values.ndim != 2 or values.dtype.kind not in "fiu":
        return [output_rule(0, 0)], ()  # said by whoever tries to read it
    number = np.asarray(table.columns[INSTANCE])
    told = {
        one: part
        for one in np.unique(number).tolist()
        for part in [np.asarray(values[number == one], np.float64)]
        if _any_output(part)
    }
    strange = [text for one, part in told.items() if (text := _no_pulses(one, part, settings))]
    if strange:
        return [], (_instead(strange, log),)
    return _channels_of(sorted(told))


def _any_output(values: Floats) -> bool:
    """Whether a driver (K, 16) ever puts anything out."""
    return bool((np.isfinite(values) & (values != 0.0)).any())


def _no_pulses(instance: int, values: Floats, settings: Mapping[str, float]) -> str:
    """What an instance (K, 16) holds instead of pulses; empty where it holds pulses."""
    told = np.isfinite(values) & (values != 0.0)
    stray = told & ((values < LOWEST_US) | (values > HIGHEST_US))
    rows = np.count_nonzero(told.any(axis=1))
    leaves = stray.sum(axis=0) > STRAY * rows  # an unused channel may hold nothing but damage
    if leaves.any():
        there = values[:, leaves][told[:, leaves]]
        low, high = there.min(), there.max()
        return f"instance {instance} of {OUTPUTS} holds {low:g} … {high:g}, which are no pulses"
    timers = {v for name, v in settings.items() if TIMER.fullmatch(name)}
    if any(timer in DSHOT for timer in timers) and not any(timer > 0 for timer in timers):
        return f"instance {instance} of {OUTPUTS} holds DShot values, which are no pulses"
    return ""


def _instead(strange: Sequence[str], log: Log) -> str:
    """What is read where outputs are no pulses."""
    present = [name for name in COMMANDS if name in log.counts()]
    if not present:
        return f"{', '.join(strange)}, and there is no actuator_motors: no commands are read"
    return f"{', '.join(strange)}: the commands of {' and '.join(present)} are read instead"


def _channels_of(instances: Sequence[int]) -> tuple[list[Rule], tuple[str, ...]]:
    """Instances 0 and 1 have channels of their own, others those that are free."""
    port = {one: one for one in instances if one < PORTS}
    free = [one for one in range(PORTS) if one not in port]
    others = [one for one in instances if one >= PORTS]
    port |= dict(zip(others, free, strict=False))
    rules = [output_rule(instance, block) for instance, block in port.items()]
    notices = [
        f"instance {rule.number} of {OUTPUTS} stands as channels {rule.channels[0]} to "
        f"{rule.channels[1]}"
        for rule in rules
        if rule.number >= PORTS
    ]
    unread = [str(one) for one in others if one not in port]
    if unread:
        notices.append(
            f"instance {', '.join(unread)} of {OUTPUTS} is not read: there are channels for "
            f"{PORTS} instances only"
        )
    return rules, tuple(notices)


def estimator_in_use(log: Log) -> LanesInUse | None:
    """Which EKF is in use when; None where only one is logged or nothing says it."""
    table = log.table(SELECTOR)
    if not len(table) or SELECTED not in table.columns:
        return None
    told = numbers(table.columns[SELECTED])
    known = (told >= 0.0) & (told < MAX_LANES)  # 255: none yet
    if not known.any():
        return None
    lane = told[known].astype(np.int64)
    new = np.append(True, np.diff(lane) != 0)
    return LanesInUse(table.order[known][new], table.receive_time_ns[known][new], lane[new])
