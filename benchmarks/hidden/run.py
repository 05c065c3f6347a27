"""The blind runner: it shows the diagnosis a log and a vessel file, and writes down what it says.

    DIR/questions/NAME/voyage.tlog, vessel.toml     all that the diagnosis is given
    DIR/answers/NAME.json, NAME/twin.tlog           for `score` alone
    DIR/results/BY/NAME.json                        {"name", "seconds", "diagnosis" or "error"}

Whatever is there already is not done again, so that a run that was stopped goes on.
"""

import json
import multiprocessing
import os
import time
import traceback
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from importlib import import_module
from pathlib import Path
from typing import Any

from benchmarks.hidden.answers import answer
from benchmarks.hidden.cases import LOG, TWIN, VESSEL, Case, materialise, materialise_twin

DIAGNOSIS = "gateway.offline.diagnose:diagnose_logs"
TASKS_PER_WORKER = 25  # then a new one: compiled code piles up
Tell = Callable[[str], None]


class NoDiagnosisError(RuntimeError):
    """What should be tested is not there."""


def prepare(chosen: Sequence[Case], out: Path, workers: int, tell: Tell) -> None:
    """Sail all voyages that are not there yet; the answer is written last."""
    todo = [case for case in chosen if not (out / "answers" / f"{case.name}.json").exists()]
    in_workers(sailed, [(case, out) for case in todo], workers, tell)


def sailed(case: Case, out: Path) -> str:
    """One question and its answer, in two folders."""
    materialise(case, out / "questions" / case.name)
    materialise_twin(case, out / "answers" / case.name)
    write_json(out / "answers" / f"{case.name}.json", answer(case))
    return f"{case.name} sailed"


def diagnose(
    names: Iterable[str], out: Path, workers: int, tell: Tell, by: str = DIAGNOSIS
) -> None:
    """Diagnose all that has no result yet; NoDiagnosisError where there is nothing to do it."""
    diagnosis_of(by)
    todo = [name for name in names if not result_of(name, out, by).exists()]
    in_workers(asked, [(name, out / "questions" / name, out, by) for name in todo], workers, tell)


def asked(name: str, question: Path, out: Path, by: str) -> str:
    """One question put, and what came of it written down; a failure is a result too."""
    begun, said = time.perf_counter(), {"name": name, "by": by}
    try:
        found = diagnosis_of(by)([question / LOG], question / VESSEL, improve=True)
        said["diagnosis"] = found.to_dict()
    except Exception:  # a benchmark counts failures, it does not end with them
        said["error"] = traceback.format_exc()
    seconds = time.perf_counter() - begun
    write_json(result_of(name, out, by), {**said, "seconds": seconds})
    return f"{name} {seconds:.0f} s: {said.get('diagnosis', {}).get('verdict', 'FAILED')}"


def diagnosis_of(name: str) -> Callable[..., Any]:
    """`module:function` -> the function."""
    module, _, function = name.partition(":")
    try:
        return getattr(import_module(module), function)
    except (ImportError, AttributeError) as problem:
        raise NoDiagnosisError(f"nothing to test: {name}: {problem}") from None


def in_workers(
    work: Callable[..., str], todo: Sequence[tuple[Any, ...]], workers: int, tell: Tell
) -> None:
    """Call `work` on all, in processes of their own, telling each that is done."""
    if not todo:
        return
    if workers > 1:  # each library's own threads would fight over the cores
        os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"))
    fresh = multiprocessing.get_context("spawn")
    some = TASKS_PER_WORKER * workers
    for begun in range(0, len(todo), some):  # the pool's own max_tasks_per_child may hang
        with ProcessPoolExecutor(workers, fresh) as pool:
            waiting = [pool.submit(work, *one) for one in todo[begun : begun + some]]
            for number, done in enumerate(as_completed(waiting), start=begun + 1):
                tell(f"{number}/{len(todo)} {done.result()}")


def write_json(file: Path, content: Any) -> None:
    """All of it or nothing: a run that is stopped leaves no half file."""
    file.parent.mkdir(parents=True, exist_ok=True)
    half = file.with_suffix(".part")
    half.write_text(json.dumps(content, indent=1), encoding="utf-8")
    half.replace(file)


def read_json(file: Path) -> Any:
    """What was written there."""
    return json.loads(file.read_text(encoding="utf-8"))


def result_of(name: str, out: Path, by: str = DIAGNOSIS) -> Path:
    """Where a result is kept: a folder for each of those who are tested."""
    return out / "results" / label(by) / f"{name}.json"


def label(by: str) -> str:
    """`module:function` -> the function's name; `diagnosed` for the program's own diagnosis."""
    return "diagnosed" if by == DIAGNOSIS else by.rpartition(":")[2]


def twin_of(name: str, out: Path) -> Path:
    """The other voyage of a case."""
    return out / "answers" / name / TWIN
