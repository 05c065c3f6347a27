"""How long a diagnosis takes: the whole catalogue, on ten minutes and on an hour of telemetry.

    python -m benchmarks.diagnosis_time [--hour] [--rungs] [--lake] [--seed 1]

Voyages of `benchmarks.hidden` with a current on board, from reading the log to the verdict, each in
a process of its own: first with an empty cache of kernels, then with a full one. Seconds of wall
clock and of CPU, beside those of reading and smoothing the same log once (the peer).

--rungs   ten minutes with four causes instead of one
--lake    eleven recordings of a real boat together, from a vessel fitted to them
          (`benchmarks.blueboat`, its data beside the checkout; skipped without)
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks import blueboat
from benchmarks.hidden.boats import BOATS
from benchmarks.hidden.causes import Hidden
from benchmarks.hidden.vessel_toml import vessel_toml
from benchmarks.hidden.voyage import write_voyage
from gateway.vessel_file import dump_vessel

ONE = [Hidden("steady_current", {"speed": 0.3, "direction": 1.2})]
FOUR = [
    *ONE,
    Hidden("thruster_imbalance", {"port_gain": 0.75}),
    Hidden("heading_offset", {"angle": 0.15}),
    Hidden("payload_change", {"factor": 1.5, "time": 300.0}),
]
WORK = {
    "read": "from gateway.offline.diagnose import DIAGNOSIS_TRIALS; "
    "from gateway.offline.trials import load_trials; load_trials('{log}', None, DIAGNOSIS_TRIALS)",
    "diagnose": "from gateway.offline.diagnose import diagnose_logs; "
    "print(diagnose_logs(['{log}'], '{vessel}').diagnosis.summary)",
    "lake": "import sys; from dataclasses import replace; from glob import glob; "
    "from benchmarks.blueboat import JUDGE, MAPPING; "
    "from gateway.offline.diagnose import DIAGNOSIS_TRIALS, diagnose_logs; "
    "logs = [f for f in sorted(glob('{log}/*.csv')) if f[-7:-4] not in JUDGE]; "
    "options = replace(DIAGNOSIS_TRIALS, mapping=MAPPING); "
    "print(diagnose_logs(logs, '{vessel}', options=options).diagnosis.summary)",
}


def took(what: str, log: Path, vessel: Path, cache: Path) -> tuple[float, float]:
    """Wall and CPU seconds of one piece of work in a process of its own."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begun = time.perf_counter()
    code = WORK[what].format(log=log, vessel=vessel)
    environment = os.environ | {"XDG_CACHE_HOME": str(cache), "OMP_NUM_THREADS": "1"}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment, stdout=sys.stderr)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - begun, cpu


def lake(place: Path) -> None:
    """Eleven recordings together; nothing where there are none."""
    folder = Path(os.environ.get("SHADOW_BLUEBOAT", blueboat.BESIDE))
    if not folder.is_dir():
        print("no lake recordings beside the checkout: skipped")
        return
    runs = [run for run in blueboat.runs_in(folder) if run.number not in blueboat.JUDGE]
    vessel = place / "lake.toml"
    vessel.write_text(dump_vessel(blueboat.fitted(runs, [], []).vessel), encoding="utf-8")
    for _ in range(2):
        wall, cpu = took("lake", folder, vessel, place / "cache")
        print(f"{len(runs)} recordings of a lake {wall:6.1f} s wall  {cpu:6.1f} s CPU")


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.diagnosis_time")
    parser.add_argument("--hour", action="store_true", help="an hour too")
    parser.add_argument("--rungs", action="store_true", help="four causes instead of one")
    parser.add_argument("--lake", action="store_true", help="eleven real recordings too")
    parser.add_argument("--seed", type=int, default=1)
    a = parser.parse_args(arguments)
    boat = BOATS["grebe"]
    hidden = FOUR if a.rungs else ONE
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        vessel = place / "boat.toml"
        vessel.write_text(vessel_toml(boat.misjudged(a.seed)), encoding="utf-8")
        for seconds in (600.0, 3600.0) if a.hour else (600.0,):
            log = place / f"{seconds:.0f}.tlog"
            write_voyage(log, boat, hidden, "excitation", a.seed, seconds)
            for name in ("read", "diagnose", "diagnose"):
                wall, cpu = took(name, log, vessel, place / "cache")
                print(f"{seconds / 60.0:3.0f} min  {name:9} {wall:6.1f} s wall  {cpu:6.1f} s CPU")
        if a.lake:
            lake(place)
    return 0


if __name__ == "__main__":
    sys.exit(main())
