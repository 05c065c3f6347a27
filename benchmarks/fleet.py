"""What `shadow fleet` itself costs, and how two workers do beside one.

python -m benchmarks.fleet tasks --count 10000     # recordings that end at once
python -m benchmarks.fleet make FOLDER --count 100 --seconds 600   # a folder for `speed`
python -m benchmarks.fleet speed FOLDER --vessel demo_boat    # the same folder, one and two workers

`make` plays the shipped demo boat, its thrusters each up to 10 % weaker or stronger, with the
simulator's own telemetry at high rates: what is measured here is time, not truth.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from gateway.files import VESSELS
from gateway.fleet import fleet_of_one
from gateway.fleet.analysis import AnalysisSettings
from gateway.fleet.run import FleetResult, run_fleet
from gateway.simulated_boat.play import write_log
from gateway.vessel_file import load_vessel

SHADOW = str(Path(sys.executable).parent / "shadow")


def timed(folder: Path, vessel: str, out: Path, workers: int) -> tuple[float, FleetResult]:
    """Seconds that a run takes, and what came of it."""
    begun = time.monotonic()
    boats, settings = fleet_of_one(vessel), AnalysisSettings(("compare", "identify"))
    result = run_fleet([str(folder)], boats, out, settings, workers=workers)
    return time.monotonic() - begun, result


def tasks(count: int) -> None:
    """So many files that hold no recording: all that is left is Dask, digests and the table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "logs"
        folder.mkdir()
        for i in range(count):
            (folder / f"{i:06d}.tlog").write_bytes(b"no recording %d" % i)
        for run in ("all new", "all known"):
            seconds, result = timed(folder, "otter", Path(name) / "out", 2)
            memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
            print(f"{run}: {len(result.rows)} recordings in {seconds:.1f} s, "
                  f"{1e3 * seconds / count:.2f} ms each; "
                  f"client {memory:.0f} MB", flush=True)  # fmt: skip


def played(folder: Path, seconds: float, i: int) -> None:
    """Recording `i` of a folder."""
    boat = load_vessel(VESSELS / "demo_boat.toml")
    gains = np.random.default_rng([17, i]).uniform(0.9, 1.1, len(boat.thrusters))
    thrusters = tuple(
        replace(t, thrust=(t.thrust[0], t.thrust[1] * float(g)))
        for t, g in zip(boat.thrusters, gains, strict=True)
    )
    log = folder / f"{i:03d}.tlog"
    write_log(replace(boat, thrusters=thrusters), log, fast=True, seed=i, seconds=seconds)


def make(folder: Path, count: int, seconds: float) -> None:
    """A folder of made recordings."""
    folder.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor() as pool:
        list(pool.map(partial(played, folder, seconds), range(count)))


def single(recording: Path, vessel: str) -> float:
    """Seconds of `shadow compare` and `shadow identify`, one after the other, kernels cached."""
    free, fix = AnalysisSettings().fit_of(load_vessel(vessel))
    fitted = [a for name in free for a in ("--free", name)]
    fitted += [a for name in fix for a in ("--fix", name)]
    begun = time.monotonic()
    for command in (["compare"], ["identify", *fitted]):
        subprocess.run(
            [SHADOW, *command, str(recording), "--vessel", vessel],
            check=True, stdout=subprocess.DEVNULL,
        )  # fmt: skip
    return time.monotonic() - begun


def speed(folder: Path, vessel: str) -> None:
    """One worker and two on the same recordings, after one that compiles; the single commands."""
    print(f"load before: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    first = sorted(folder.glob("*.tlog"))[:3]
    single(first[0], vessel)
    alone = [single(recording, vessel) for recording in first]
    print(
        "compare and identify by hand: " + ", ".join(f"{s:.1f}" for s in alone) + " s", flush=True
    )
    for workers in (1, 2):
        with tempfile.TemporaryDirectory() as out:
            seconds, result = timed(folder, vessel, Path(out), workers)
        rows = sorted(result.rows.values(), key=lambda r: str(r["analysed"]))
        work = np.array([r["seconds_of_work"] for r in rows])
        memory = [r["peak_memory_mb"] for r in rows]
        print(
            f"{workers} workers: {len(rows)} recordings in {seconds:.0f} s, median "
            f"{np.median(work):.2f} s of work, {work.sum():.0f} s in all; at most "
            f"{max(memory[: len(rows) // 10 + 1]):.0f} MB a worker after a tenth, "
            f"{max(memory[: len(rows) // 2]):.0f} after half, {max(memory):.0f} at the end; "
            f"states {sorted({r['state'] for r in rows})}",
            flush=True,
        )


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fleet", description=__doc__)
    parser.add_argument("what", choices=("tasks", "make", "speed"))
    parser.add_argument("folder", type=Path, nargs="?", default=Path("recordings"))
    parser.add_argument("--vessel", default="demo_boat")
    parser.add_argument("--count", type=int, help="default: 10000 tasks, 100 recordings")
    parser.add_argument("--seconds", type=float, default=600.0, help="of a made recording")
    a = parser.parse_args()
    if a.what == "tasks":
        tasks(a.count or 10_000)
    elif a.what == "make":
        make(a.folder, a.count or 100, a.seconds)
    else:
        speed(a.folder, a.vessel)
    return 0


if __name__ == "__main__":
    sys.exit(main())
