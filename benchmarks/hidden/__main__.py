"""The blind test of the diagnosis, whole: sail, diagnose, judge, print the table.

    python -m benchmarks.hidden [--set reporting] [--workers 2] [--out DIR] [--write]

A run that was stopped goes on where it was. To diagnose anew after a change remove DIR/results and
DIR/judged: voyages and the fits by who knows stay. Whoever else was tested in DIR (`--by`, see
`peers`) stands beside in the table.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.hidden import tables
from benchmarks.hidden.cases import SEEDS, Case, cases
from benchmarks.hidden.judge import judge
from benchmarks.hidden.run import DIAGNOSIS, NoDiagnosisError, diagnose, label, prepare
from benchmarks.hidden.score import rows_of

HERE = Path(__file__).resolve().parent
STAGES = ("sail", "diagnose", "judge", "score")


def chosen(name: str, family: str, only: str, limit: int) -> list[Case]:
    """Part of a set."""
    found = [case for case in cases(name) if family in ("", case.family)]
    found = [
        case
        for case in found
        if not only or only in case.name or any(only in h.name for h in case.voyage.hidden)
    ]
    return found[:limit] if limit else found


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hidden")
    parser.add_argument("--set", choices=SEEDS, default="reporting")
    parser.add_argument("--family", default="", help="only this family of cases")
    parser.add_argument("--only", default="", help="only cases with this in their name or effects")
    parser.add_argument("--every", type=int, default=1, help="only every so many of the cases")
    parser.add_argument("--limit", type=int, default=0, help="at most so many cases")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, help="default: out/hidden/SET")
    parser.add_argument("--until", choices=STAGES, default="score", help="stop after this stage")
    parser.add_argument("--no-judge", action="store_true", help="no oracle, no other voyage: fast")
    parser.add_argument("--by", default=DIAGNOSIS, help="module:function that diagnoses")
    parser.add_argument("--write", action="store_true", help="write the table beside this program")
    a = parser.parse_args(arguments)
    out, last = a.out or Path("out") / "hidden" / a.set, STAGES.index(a.until)
    todo = chosen(a.set, a.family, a.only, a.limit)[:: a.every]
    names = [case.name for case in todo]
    prepare(todo, out, a.workers, tell)
    try:
        if last >= 1:
            diagnose(names, out, a.workers, tell, a.by)
    except NoDiagnosisError as problem:
        parser.error(str(problem))
    if last >= 2 and not a.no_judge:
        judge(names, out, a.workers, tell, a.by)
    if last >= 3:
        print_table(out, names, a.by, a.set, a.write)
    return 0


def print_table(out: Path, names: Sequence[str], by: str, which: str, write: bool) -> None:
    """The table on standard output, the picture into the run's folder; both here if asked to."""
    tested = [label(by), *sorted({f.name for f in (out / "results").iterdir()} - {label(by)})]
    who = {name: rows_of(out, names, name) for name in tested}
    rows = who[label(by)]
    text = tables.report(rows, f"The blind test, {which} set, {label(by)}: {len(rows)} cases")
    if len(who) > 1:
        text += "\n## Others on the same data\n" + tables.side_by_side(who).strip() + "\n"
    print(text)
    for folder in (out, HERE) if write else (out,):
        (folder / "results.md").write_text(text, encoding="utf-8")
        tables.picture(rows, folder / "confusion.png")


def tell(line: str) -> None:
    """Progress."""
    print(line, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
