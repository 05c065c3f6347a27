"""What looks wrong with recordings, and with their wiring: a sentence each, said once for all."""

import re
from collections.abc import Sequence

from sim.identification.wiring import says, wiring_of
from sim.trial import Trial
from sim.vessel import Vessel

NUMBER = re.compile(r"[+-]?\d+(\.\d+)?")


def notices_of(trials: Sequence[Trial], vessel: Vessel) -> tuple[str, ...]:
    """First the wiring, which comes before everything else; then recording by recording."""
    wiring = says(wiring_of(trials, vessel), vessel)
    alike: dict[str, list[tuple[str, str]]] = {}
    for trial in trials:
        for notice in trial.notices:
            alike.setdefault(NUMBER.sub("", notice), []).append((trial.name, notice))
    return (*wiring, *(_together(told) for told in alike.values()))


def _together(told: Sequence[tuple[str, str]]) -> str:
    """One sentence with the names of those that it is about; numbers are the first one's."""
    names = list(dict.fromkeys(name for name, _ in told))
    listed = names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
    return f"{listed}: {told[0][1]}"
