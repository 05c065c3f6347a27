"""Strangers: what the curve that a diagnosis learned is worth on another voyage.

    python -m benchmarks.hidden.learned --out DIR     of `python -m benchmarks.hidden --out DIR`

Of each answer that holds a curve the vessel with it, as `shadow add` writes it, is held against the
other voyage, every second block of it for what belongs to the day. Beside it stands the vessel as
given, the one with the effects that were named alone, and *known*: the vessel as given on the same
voyage without the stranger, which is what a model leaves that holds the true law.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.hidden.boats import EVERY
from benchmarks.hidden.cases import SEEDS, VESSEL, Case, cases
from benchmarks.hidden.judge import improved
from benchmarks.hidden.oracle import halves, nrmse
from benchmarks.hidden.run import read_json, result_of, twin_of, write_json
from benchmarks.hidden.twins import on_another_day
from gateway.offline.add import add_effects
from gateway.offline.trials import load_trials
from gateway.vessel_file import load_vessel


def main(arguments: Sequence[str] | None = None) -> int:
    """A line for each case that was diagnosed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hidden.learned")
    parser.add_argument("--set", choices=SEEDS, default="reporting")
    parser.add_argument("--family", default="unlisted")
    parser.add_argument("--out", type=Path, required=True, help="folder of the blind test")
    a = parser.parse_args(arguments)
    print("| case | hidden, pilot | answer | as given | effects | with the curve | known | ratio |")
    print("|---|---|---|---|---|---|---|---|")
    for case in cases(a.set):
        if case.family == a.family and result_of(case.name, a.out).exists():
            print(row_of(case, a.out), flush=True)
    return 0


def row_of(case: Case, out: Path) -> str:
    """A line of the table."""
    hidden = f"{case.voyage.hidden[0].name}, {case.voyage.pilot}"
    result = read_json(result_of(case.name, out))
    if "diagnosis" not in result:
        return f"| {case.name} | {hidden} | failed | | | | | |"
    found = result["diagnosis"]
    said = f"`{found['verdict']}` {', '.join(found['effects'])}"
    *others, known = errors_of(case, found, out)
    cells = [f"{error:.3f}" for error in others]
    ratio = f"{others[2] / known:.2f}" if found["curve"] is not None else ""
    cells += [] if ratio else ["no curve"]
    return f"| {case.name} | {hidden} | {said} | {' | '.join(cells)} | {known:.3f} | {ratio} |"


def errors_of(case: Case, found: Mapping[str, Any], out: Path) -> list[float]:
    """Errors on the other voyage: as given, with the effects, with the curve too if there is one,
    and last *known*.
    """
    file = out / "questions" / case.name / VESSEL
    plain = load_vessel(file)
    vessels = [plain, improved(plain, found)]
    with TemporaryDirectory() as folder:
        if found["curve"] is not None:
            diagnosis, better = Path(folder) / "diagnosis.json", Path(folder) / "better.toml"
            write_json(diagnosis, found)
            add_effects(found["curve"]["effects"], file, diagnosis, better)
            vessels.append(load_vessel(better))
        without = Path(folder) / "without.tlog"
        replace(case.twin, hidden=()).write(without, EVERY[case.boat])
        known = nrmse(halves(load_trials(without)[0])[1], [plain])[0]
    twin = load_trials(twin_of(case.name, out))[0]
    return [*on_another_day(twin, vessels, []), known]


if __name__ == "__main__":
    sys.exit(main())
