"""Is what is hidden visible at all? Errors of the plain and of the complete vessel, as files say.

    python -m benchmarks.hidden.visible [--set tuning] [--family excitation] [--all-boats]

The gain is the error of the vessel without the effect over that with its true parameters, on the
same voyage, neither fitted. `--all-boats` tries each effect at full strength on each boat that it
can act on. Below 1.3 an effect is hard to see; `refit` shows what of it a re-fitted base absorbs.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.hidden.answers import answer
from benchmarks.hidden.boats import FLEET
from benchmarks.hidden.cases import LOG, SEEDS, VESSEL, Case, Voyage, cases, materialise
from benchmarks.hidden.causes import Hidden
from benchmarks.hidden.oracle import fitted, nrmse, with_effects
from benchmarks.hidden.strengths import RECIPES, boats_for, strong
from gateway.offline.trials import load_trials
from gateway.vessel_file import load_vessel
from sim.trial import Trial
from sim.vessel import Vessel

CLEAR = 1.3


def everywhere(seed: int, seconds: float, pilot: str) -> Iterator[Case]:
    """Every effect at full strength on every boat that it can act on."""
    for i, name in enumerate(RECIPES):
        for j, boat in enumerate(boats_for((name,))):
            values = strong(name, FLEET[boat], np.random.default_rng([seed, i, j]), 1.0, seconds)
            voyage = Voyage(pilot, seed + 100 * i + j, seconds, "raised", (Hidden(name, values),))
            yield Case(f"{name} {boat}", "everywhere", boat, 1.0, False, voyage, voyage)


def read(case: Case, folder: Path) -> tuple[Trial, Vessel]:
    """The voyage as a diagnosis would see it."""
    materialise(case, folder)
    return load_trials(folder / LOG)[0], load_vessel(folder / VESSEL)


def line(case: Case, folder: Path, refit: bool) -> tuple[float, str]:
    """The gain of one case, and a line that tells it."""
    trial, plain = read(case, folder)
    true = with_effects(plain, answer(case)["values"], trial)
    before, after = nrmse(trial, [plain, true])
    said = f"{'+'.join(answer(case)['effects']):28}{case.boat:10}{case.voyage.pilot:11}"
    said += f"{before:7.3f}{after:7.3f}{before / after:7.2f}"
    gain = before / after
    if refit:
        both = [fitted(trial, v).vessel for v in (plain, true)]
        _, left, found = nrmse(trial, [plain, *both])
        gain = left / found
        said += f"   refitted {left:7.3f}{found:7.3f}{gain:7.2f}"
    return gain, said


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hidden.visible")
    parser.add_argument("--set", choices=SEEDS, default="tuning")
    parser.add_argument("--family", default="excitation")
    parser.add_argument("--only", default="", help="effects whose name holds this")
    parser.add_argument("--all-boats", action="store_true")
    parser.add_argument("--pilot", default="excitation", help="with --all-boats")
    parser.add_argument("--seconds", type=float, default=0.0, help="shorter voyages")
    parser.add_argument("--refit", action="store_true", help="fit base and effects too")
    a = parser.parse_args(arguments)
    if a.all_boats:
        chosen = list(everywhere(SEEDS[a.set] + 5_000, a.seconds or 600.0, a.pilot))
    else:
        chosen = [c for c in cases(a.set) if c.family == a.family and not answer(c)["unknown"]]
    chosen = [c for c in chosen if any(a.only in h.name for h in c.voyage.hidden)]
    hard = []
    with tempfile.TemporaryDirectory() as folder:
        for case in chosen:
            if a.seconds:
                case = replace(case, voyage=replace(case.voyage, seconds=a.seconds))
            gain, said = line(case, Path(folder), a.refit)
            print(said, flush=True)
            if gain < CLEAR:
                hard.append(said)
    print(f"\n{len(hard)} of {len(chosen)} gain less than {CLEAR}:", *hard, sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
