"""`shadow live` as a program: the vessel for each boat, and a clean end."""

import gc
import signal
import sys
from collections.abc import Sequence
from threading import Event
from typing import Any

from gateway.config import BoatSettings, check_name
from gateway.errors import BadInput
from gateway.live.boats import BoatPlan
from gateway.live.gateway import Gateway, LiveOptions
from gateway.plants import load_plant
from gateway.vessel_file import load_vessel
from sim.effects.effect import Effect
from sim.state import Progress

# A busy thread (the recorder) keeps the interpreter for so long when another one (the loop, when a
# datagram comes) wants it. Python's default is 5 ms; benchmarks/live_latency.py measures the delay.
SWITCH_S = 0.0005


def plans_of(
    vessels: Sequence[str], plant: str | None, name: str | None, effects: Sequence[Effect]
) -> list[BoatPlan]:
    """`--vessel FILE` and `--vessel SYSID=FILE` -> the vessel of each boat."""
    if name is not None:
        check_name(name, "--name")
    played_by = load_plant(plant, effects)
    plans = []
    for text in vessels:
        number, mark, file = text.partition("=")
        if not (mark and number.isdecimal()):
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


def run_until_stopped(plans: Sequence[BoatPlan], options: LiveOptions, progress: Progress) -> None:
    """Run until SIGINT or SIGTERM; then everything is finished cleanly."""
    stop = Event()

    def ask_to_stop(number: int, _: Any) -> None:
        stop.set()
        signal.signal(number, signal.SIG_DFL)  # a second signal ends it without waiting

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, ask_to_stop)
    sys.setswitchinterval(SWITCH_S)
    progress("getting ready: the first start with a vessel compiles for a while")
    with Gateway(plans, options, progress) as gateway:
        gc.collect()
        gc.freeze()  # what was loaded by now stays: it is not searched again and again
        progress(f"listening on {', '.join(options.endpoints)}; Ctrl-C ends")
        gateway.run(stop)
    progress("finished")
