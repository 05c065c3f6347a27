"""Mutation testing: which share of small faults in the code that decides do its tests not notice?

    python -m benchmarks.mutants --sample 80 --seed 7

In a copy of the sources one operator, comparison, sign, number or condition is changed at a time,
drawn by `seed` from all places in `TARGETS` (each subsystem gets the same share). The test files
that stand beside the module are run, uncompiled, up to the first that fails; tests that fail or
take long so where nothing is wrong are left out, which can only make survivors. A mutant that all
of them pass has survived. Not every survivor is a gap: some are equivalent (a bound that nothing
reaches, a number that was chosen for a picture); the list names each with its line, to be judged by
a person.
"""

import argparse
import ast
import copy
import importlib
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple

import pytest

ROOT = Path(__file__).resolve().parent.parent
PATIENCE_S = 200.0  # of one mutant's tests: one that takes longer is counted as noticed (a hang)
LONG_S = 8.0  # a test that takes longer uncompiled is left out
LOADED = (
    "numpy", "numba", "scipy.optimize", "scipy.signal", "scipy.linalg", "msgspec", "orjson",
    "pydantic", "pymavlink", "matplotlib", "filterpy.kalman",
)  # fmt: skip
HOUSE = "tests/test_architecture.py::test_values_are_frozen"  # a rule of all subsystems
COPIED = ("sim", "gateway", "tests", "configs", "recordings", "pyproject.toml")


class Target(NamedTuple):
    """Files of one subsystem, and the test files that stand beside them, the fastest first."""

    files: tuple[str, ...]
    tests: tuple[str, ...]


ESTIMATION = "tests/gateway/estimation"
DIAGNOSIS = "tests/sim/diagnosis"
EFFECTS = "tests/sim/effects"
MONITORING = "tests/sim/monitoring"
TARGETS = {
    "balance": Target(("sim/balance.py",), ("tests/sim/test_balance.py",)),
    "effects": Target(
        ("sim/effects/*.py",),
        (f"{EFFECTS}/test_laws_by_hand.py", f"{EFFECTS}/test_learned.py",
         f"{EFFECTS}/test_learned_formula.py", f"{EFFECTS}/test_learned_reading.py",
         f"{EFFECTS}/test_learned_pair.py", f"{EFFECTS}/test_learned_rhythm.py",
         f"{EFFECTS}/test_learned_places.py", f"{EFFECTS}/test_learned_anomaly.py",
         f"{EFFECTS}/test_lever_arm.py", f"{EFFECTS}/test_pushes.py",
         "tests/gateway/figures/test_effect_sentences.py",
         f"{EFFECTS}/test_laws.py", f"{EFFECTS}/test_single_effects.py",
         f"{EFFECTS}/test_effects.py"),
    ),
    "estimation": Target(
        ("gateway/estimation/events.py", "gateway/estimation/filter.py",
         "gateway/estimation/model.py"),
        (f"{ESTIMATION}/test_gates.py", f"{ESTIMATION}/test_events.py",
         f"{ESTIMATION}/test_oracle.py", f"{ESTIMATION}/test_estimator.py"),
    ),
    "clock": Target(("gateway/ingest/clock.py",), ("tests/gateway/ingest/test_clock.py",)),
    "diagnosis": Target(
        ("sim/diagnosis/verdict.py", "sim/diagnosis/free_curve.py", "sim/diagnosis/heldout.py",
         "sim/diagnosis/evidence.py"),
        (f"{DIAGNOSIS}/test_verdict.py", f"{DIAGNOSIS}/test_heldout.py",
         f"{DIAGNOSIS}/test_evidence.py", f"{DIAGNOSIS}/test_free_curve.py"),
    ),
    "disturbances": Target(
        ("sim/monitoring/disturbances.py", "sim/monitoring/causes.py",
         "sim/monitoring/filters.py", "sim/monitoring/kalman.py"),
        (f"{MONITORING}/test_causes.py", f"{MONITORING}/test_disturbances.py"),
    ),
}  # fmt: skip

SWAPPED: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt,
    ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
    ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip


class Mutant(NamedTuple):
    """One change: the file, its line, what it was and what it became, and the whole new text."""

    file: str
    line: int
    before: str
    after: str
    text: str


def changed_nodes(node: ast.AST) -> Iterator[ast.AST]:
    """Copies of a node, each with one fault; none where the node is of another kind."""
    match node:
        case ast.BinOp() | ast.BoolOp() if type(node.op) in SWAPPED:
            yield _with(node, op=SWAPPED[type(node.op)]())
        case ast.Compare() if type(node.ops[0]) in SWAPPED:
            yield _with(node, ops=[SWAPPED[type(node.ops[0])](), *node.ops[1:]])
        case ast.UnaryOp(op=ast.USub() | ast.Not()):
            yield node.operand
        case ast.Constant(value=float() | int() as value) if not isinstance(value, bool):
            yield _with(node, value=value + 1 if isinstance(value, int) else 2.0 * value + 0.5)
        case ast.Constant(value=bool() as value):
            yield _with(node, value=not value)


def _with(node: ast.AST, **parts: object) -> ast.AST:
    new = copy.copy(node)
    for name, part in parts.items():
        setattr(new, name, part)
    return new


def mutants_of(file: str, text: str) -> Iterator[Mutant]:
    """All mutants of one file: its code within functions and at the top, not its annotations."""
    tree = ast.parse(text)
    lines = text.splitlines(keepends=True)
    skipped = {id(inner) for node in ast.walk(tree) for inner in _no_code(node)}
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        for new in changed_nodes(node):
            if node.lineno != node.end_lineno:
                continue
            line, start, end = node.lineno, node.col_offset, node.end_col_offset
            old = lines[line - 1].encode()
            swapped = old[:start] + f"({ast.unparse(new)})".encode() + old[end:]
            changed = [*lines[: line - 1], swapped.decode(), *lines[line:]]
            yield Mutant(file, line, old[start:end].decode(), ast.unparse(new), "".join(changed))


def _no_code(node: ast.AST) -> Iterator[ast.AST]:
    """Parts whose change says nothing: annotations, formatted text, decorators, enum numbers."""
    parts: list[ast.AST | None] = []
    match node:
        case ast.FunctionDef():
            parts = [node.returns, *node.decorator_list]
        case ast.AnnAssign() | ast.arg():
            parts = [node.annotation]
        case ast.JoinedStr():
            parts = [node]
        case ast.ClassDef() if any("Enum" in ast.unparse(base) for base in node.bases):
            parts = [node]
    for part in parts:
        if part is not None:
            yield from ast.walk(part)


def sample_of(count: int, seed: int, names: Sequence[str]) -> list[tuple[str, Mutant]]:
    """Mutants of each subsystem, as many of each, drawn with a seed; subsystems take turns."""
    rng, drawn = random.Random(seed), []
    for place, name in enumerate(names):
        files = sorted({f for pattern in TARGETS[name].files for f in ROOT.glob(pattern)})
        everything = [
            mutant
            for file in files
            for mutant in mutants_of(str(file.relative_to(ROOT)), file.read_text("utf-8"))
        ]
        share = count // len(names) + (place < count % len(names))
        drawn.append([(name, m) for m in rng.sample(everything, min(share, len(everything)))])
    return [one for turn in zip_longest(*drawn) for one in turn if one is not None]


class Watcher:
    """What failed, and what took how long [s]: a plugin of pytest."""

    def __init__(self) -> None:
        self.unfit: list[str] = []

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Of each test, its setup, call and teardown."""
        if report.failed or report.duration > LONG_S:
            self.unfit.append(report.nodeid)


def preload() -> None:
    """Load what all children need, but nothing of this project."""
    sys.dont_write_bytecode = True
    for name in LOADED:
        importlib.import_module(name)


def run_tests(folder: Path, tests: Sequence[str], report: Path | None = None) -> bool:
    """Whether all these tests pass there, in a child; those unfit to judge go to `report`.

    The child is forked from this process, which has loaded the large libraries once. Nothing is
    compiled: laws, kernels and loops run as the Python that they are written in.
    """
    child = os.fork()
    if child == 0:
        status = 70
        try:
            importlib.import_module("numba").config.DISABLE_JIT = 1
            os.chdir(folder)
            sys.path.insert(0, str(folder))
            with open(os.devnull, "w") as nowhere:  # noqa: PTH123
                os.dup2(nowhere.fileno(), 1)
                os.dup2(nowhere.fileno(), 2)
            watcher = Watcher()
            words = ["-q", "-n", "0", "-m", "not slow", "-p", "no:cacheprovider", *tests]
            words += ["-W", "ignore::RuntimeWarning"]  # numpy warns where compiled code gives a NaN
            plugins = [watcher] if report is not None else []
            status = int(pytest.main(words if report else ["-x", *words], plugins=plugins))
            if report is not None:
                report.write_text("\n".join(sorted(set(watcher.unfit))))
        finally:
            os._exit(status)
    end = time.monotonic() + (PATIENCE_S if report is None else 5.0 * PATIENCE_S)
    while time.monotonic() < end:
        done, state = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(state) == 0
        time.sleep(0.05)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return False


def fit_tests(folder: Path, target: Target) -> list[str]:
    """The tests without those that fail or take long where nothing is wrong, as words of pytest."""
    report = folder / "unfit.txt"
    tests = (HOUSE, *target.tests)
    run_tests(folder, tests, report)
    if not report.exists():
        return []
    unfit = [name for name in report.read_text().split("\n") if name]
    return [*tests, *(f"--deselect={name}" for name in unfit)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print each survivor, and the share that survives of each subsystem."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--sample", type=int, default=80, help="mutants in all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=sorted(TARGETS), action="append")
    given = parser.parse_args(arguments)
    preload()
    names = given.only or list(TARGETS)
    counts = {name: [0, 0] for name in names}  # survived, all
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        for part in COPIED:
            source = ROOT / part
            (shutil.copytree if source.is_dir() else shutil.copy)(source, folder / part)
        words = {name: fit_tests(folder, TARGETS[name]) for name in names}
        for name, chosen in words.items():
            left_out = sum(word.startswith("--deselect") for word in chosen)
            sound = bool(chosen) and run_tests(folder, chosen)
            print(f"{name}: {left_out} tests left out{'' if sound else ': UNFIT'}", flush=True)
            words[name] = chosen if sound else []
        for name, mutant in sample_of(given.sample, given.seed, [n for n in names if words[n]]):
            whole, start = (folder / mutant.file).read_text("utf-8"), time.monotonic()
            (folder / mutant.file).write_text(mutant.text, "utf-8")
            survived = run_tests(folder, words[name])
            (folder / mutant.file).write_text(whole, "utf-8")
            counts[name][0] += survived
            counts[name][1] += 1
            state = "SURVIVED" if survived else "noticed "
            print(
                f"{state} {mutant.file}:{mutant.line}: {mutant.before} -> {mutant.after} "
                f"({time.monotonic() - start:.0f} s)",
                flush=True,
            )
    for name, (survived, tried) in counts.items():
        print(f"{name:14s} {survived:3d} of {tried:3d} survived")
    survived, tried = (sum(row[i] for row in counts.values()) for i in (0, 1))
    print(
        f"{'all':14s} {survived:3d} of {tried:3d} survived ({100 * survived / max(tried, 1):.0f} %)"
    )


if __name__ == "__main__":
    main()
