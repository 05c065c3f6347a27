"""`shadow live` as a program: which vessel for which boat, and how it ends."""

import gc
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from threading import Event
from typing import Any

from gateway.config import BoatSettings, check_name
from gateway.errors import BadInput
from gateway.live.boats import BoatPlan
from gateway.live.gateway import Gateway, LiveOptions
from gateway.vessel_file import load_vessel
from sim.effects.effect import Effect

# Python lets a thread that is busy keep the interpreter for so long when another one wants it: the
# recorder, when a datagram comes. The default is 5 ms.
SWITCH_S = 0.0005


def plans_of(
    vessels: Sequence[str], plant: Path | None, name: str | None, effects: Sequence[Effect]
) -> list[BoatPlan]:
    """What `--vessel FILE` and `--vessel SYSID=FILE` say -> which vessel shadows which boat."""
    if name is not None:
        check_name(name, "--name")
    own = None if plant is None else load_vessel(plant, effects)
    plans = []
    for text in vessels:
        number, mark, file = text.partition("=")
        if not (mark and number.isdecimal()):
            number, file = "", text
        elif not 1 <= int(number) <= 254:
            raise BadInput(f"--vessel {text}: expected FILE or SYSID=FILE, SYSID 1 to 254")
        system = int(number) if number else None
        key = name if name is None or len(vessels) == 1 else f"{name}-{number or 'any'}"
        plans.append(BoatPlan(load_vessel(file, effects), own, system, key))
    return _told_apart(plans, "--vessel: two vessels for one boat; give SYSID=FILE for each boat")


def plans_in(boats: Sequence[BoatSettings], effects: Sequence[Effect]) -> list[BoatPlan]:
    """What `[[boats]]` of the configuration say."""
    plans = [
        BoatPlan(
            load_vessel(boat.vessel, effects),
            None if boat.plant is None else load_vessel(boat.plant, effects),
            boat.system_id,
            boat.name,
        )
        for boat in boats
    ]
    return _told_apart(plans, "[[boats]]: two vessels for one boat; give each its system_id")


def _told_apart(plans: list[BoatPlan], otherwise: str) -> list[BoatPlan]:
    systems = [plan.system for plan in plans]
    if len(set(systems)) < len(systems):
        raise BadInput(otherwise)
    return plans


def run_until_stopped(
    plans: Sequence[BoatPlan], options: LiveOptions, tell: Callable[[str], None]
) -> None:
    """Run until SIGINT or SIGTERM; then everything is finished cleanly."""
    stop = Event()

    def ask_to_stop(number: int, _: Any) -> None:
        stop.set()
        signal.signal(number, signal.SIG_DFL)  # whoever asks twice does not want to wait

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, ask_to_stop)
    sys.setswitchinterval(SWITCH_S)
    tell("getting ready: the first start with a vessel compiles for a while")
    with Gateway(plans, options, tell) as gateway:
        gc.collect()
        gc.freeze()  # what was loaded by now stays: no need to look through it again and again
        tell(f"listening on {', '.join(options.endpoints)}; Ctrl-C ends")
        gateway.run(stop)
    tell("finished")
