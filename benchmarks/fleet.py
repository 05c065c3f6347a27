"""What `shadow fleet` itself costs, and how two workers do beside one.

python -m benchmarks.fleet tasks --count 10000     # recordings that end at once
python -m benchmarks.fleet speed FOLDER --vessel boat.toml    # the same folder, one and two workers
"""

import argparse
import os
import resource
import sys
import tempfile
import time
from pathlib import Path

from gateway.fleet import fleet_of_one
from gateway.fleet.analysis import AnalysisSettings
from gateway.fleet.run import FleetResult, run_fleet


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


def speed(folder: Path, vessel: str) -> None:
    """One and two workers on the same recordings, the second kernel-warm in both."""
    print(f"load before: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    with tempfile.TemporaryDirectory() as name:
        for workers in (1, 2):
            seconds, result = timed(folder, vessel, Path(name) / str(workers), workers)
            rows = [r for r in result.rows.values() if r.get("seconds_of_work")]
            work = sum(r["seconds_of_work"] for r in rows)
            memory = max(r["peak_memory_mb"] for r in rows)
            print(f"{workers} workers: {len(rows)} recordings in {seconds:.0f} s, {work:.0f} s of "
                  f"work, at most {memory:.0f} MB a worker", flush=True)  # fmt: skip


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fleet", description=__doc__)
    parser.add_argument("what", choices=("tasks", "speed"))
    parser.add_argument("folder", type=Path, nargs="?", default=Path("recordings"))
    parser.add_argument("--vessel", default="demo_boat")
    parser.add_argument("--count", type=int, default=10_000)
    a = parser.parse_args()
    if a.what == "tasks":
        tasks(a.count)
    else:
        speed(a.folder, a.vessel)
    return 0


if __name__ == "__main__":
    sys.exit(main())
