"""`make fuzz`: mutants of small specimens against every parser, each for a minute.

    python -m tests.fuzz                       one minute each
    python -m tests.fuzz --minutes 10          ten
    python -m tests.fuzz --only tlog --seed 7

Each target runs in a process of its own. A fault is an exception that the command line would not
turn into one line, a mutant that takes longer than `HANG_S`, or memory that grows by more than
`GROWTH_BYTES`. The mutant is kept under out/fuzz, and the exit status is 1.
"""

import argparse
import faulthandler
import hashlib
import itertools
import resource
import subprocess
import sys
import time
import traceback
import warnings
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings

from tests.fuzz.mutations import mutants
from tests.fuzz.targets import TARGETS, Target, is_fault

HANG_S = 30.0  # for one mutant; specimens take well below one second
GROWTH_BYTES = 1_000_000_000  # beyond what the specimens themselves need
BATCH = 25  # mutants between two looks at the clock
OUT = Path("out/fuzz")


class Found(Exception):
    """A mutant that must not be: what happened, and where it is kept."""


def fuzz(target: Target, budget_s: float, first_seed: int, batches: int | None = None) -> int:
    """Mutants until the budget is used up or so many batches are done -> how many mutants.

    Raises `Found`. With a number of batches alone (a budget of infinity) every machine tries the
    same mutants.
    """
    corpus = list(target.corpus())
    for specimen in corpus:  # compiles what has to be compiled
        _try(target, specimen, hang_s=600.0)
    base, count, until = _peak_bytes(), 0, time.monotonic() + budget_s
    for batch in itertools.count(first_seed):
        if time.monotonic() >= until or batch - first_seed == batches:
            return count
        count += _batch(target, corpus, batch, base)
    raise AssertionError("counting ended")


def _batch(target: Target, corpus: list[bytes], number: int, base: int) -> int:
    """The mutants of one seed."""
    tried: list[int] = []

    @seed(number)
    @settings(
        max_examples=BATCH, deadline=None, database=None, phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(mutants(corpus, target.text))
    def run(data: bytes) -> None:
        tried.append(len(data))
        _try(target, data)
        grown = _peak_bytes() - base
        if grown > GROWTH_BYTES:
            raise _kept(target, data, f"memory grew by {grown / 1e6:.0f} MB")

    with warnings.catch_warnings():
        # else it stands in the place of what was found: a mutant is longer than what can be shown
        warnings.filterwarnings("ignore", message="Generating overly large repr")
        run()
    return len(tried)


def _try(target: Target, data: bytes, hang_s: float = HANG_S) -> None:
    """One mutant; raises `Found` where it does harm."""
    # compiled code cannot be interrupted: the process ends, and the mutant is there already
    current = OUT / f"{target.name}-running"
    current.write_bytes(data)
    faulthandler.dump_traceback_later(hang_s, exit=True)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            target.read(data)
    except Exception as error:
        if is_fault(error):
            text = "".join(traceback.format_exception(error)[-4:])
            raise _kept(target, data, f"{type(error).__name__}\n{text}") from None
    finally:
        faulthandler.cancel_dump_traceback_later()
    current.unlink()


def _kept(target: Target, data: bytes, what: str) -> Found:
    file = OUT / f"{target.name}-{hashlib.sha256(data).hexdigest()[:12]}"
    file.write_bytes(data)
    return Found(f"{target.name}: {what[:3000]}\nkept: {file}")


def _peak_bytes() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def main() -> int:
    """The targets one after the other, each in a process of its own."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--minutes", type=float, default=1.0, help="for each target")
    parser.add_argument("--only", help="targets, separated by commas")
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--here", action="store_true", help="in this very process")
    given_ = parser.parse_args()
    names = given_.only.split(",") if given_.only else [target.name for target in TARGETS]
    unknown = set(names) - {target.name for target in TARGETS}
    if unknown:
        parser.error(f"unknown: {', '.join(sorted(unknown))}")
    OUT.mkdir(parents=True, exist_ok=True)
    return (_here if given_.here else _apart)(names, given_.minutes, given_.seed)


def _here(names: list[str], minutes: float, first_seed: int) -> int:
    for target in (target for target in TARGETS if target.name in names):
        began = time.monotonic()
        try:
            count = fuzz(target, 60.0 * minutes, first_seed)
        except Found as found:
            print(f"FOUND {found}", flush=True)
            return 1
        peak = _peak_bytes() / 1e6
        print(f"{target.name}: {count} mutants in {time.monotonic() - began:.0f} s, nothing; "
              f"peak {peak:.0f} MB", flush=True)  # fmt: skip
    return 0


def _apart(names: list[str], minutes: float, first_seed: int) -> int:
    bad = []
    for name in names:
        words = ["--here", "--only", name, "--minutes", str(minutes), "--seed", str(first_seed)]
        ended = subprocess.run([sys.executable, "-m", "tests.fuzz", *words], check=False)
        if ended.returncode:
            bad.append(name)
            if ended.returncode != 1 or (OUT / f"{name}-running").exists():
                print(f"{name}: died or hung; see {OUT / f'{name}-running'}", flush=True)
    print(f"seed {first_seed}: " + (f"faults in {', '.join(bad)}" if bad else "no faults"))
    return int(bool(bad))


if __name__ == "__main__":
    sys.exit(main())
