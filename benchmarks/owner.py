"""What the owner of another author's hull does: guess a vessel, fit it, ask what is missing.

The nine numbers of the vessel are guessed from the size, as `shadow init` does, and fitted to one
voyage; what that lacks is diagnosed and added. What is hidden on later voyages is looked for with
the better vessel.
"""

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path

from benchmarks.hidden.boats import NINE, Boat
from benchmarks.hidden.vessel_toml import vessel_toml

GUESSED = "".join(
    f'\n[provenance."dynamics.{name}"]\nsays = "guessed from size: identify it"\n' for name in NINE
)


def first_voyage(out: Path, boat: Boat, sail: Callable[[Path], object]) -> Path:
    """The first voyage and what it taught, unless it is there already -> the better vessel."""
    out.mkdir(parents=True, exist_ok=True)
    log, plain, fitted = (out / n for n in ("first.tlog", "plain.toml", "fitted.toml"))
    better, answer = out / "better.toml", out / "first.json"
    if not answer.exists():
        sail(log)
        plain.write_text(vessel_toml(boat) + GUESSED, encoding="utf-8")
        shadow("identify", log, "--vessel", plain, "--out", fitted, "--force")
        shadow("diagnose", log, "--vessel", fitted, "--save", answer, "--out", better, "--force")
    print("first voyage:", told(answer), flush=True)
    return better if better.exists() else fitted  # nothing was missing


def tell_each(
    names: Iterable[str], out: Path, vessel: Path, sail: Callable[[str, Path], str]
) -> None:
    """A line for each voyage that `sail` writes to a log; it returns what is hidden there."""
    for name in names:
        began = time.perf_counter()
        log = out / f"{name}.tlog"
        hidden = sail(name, log)
        answer = told(diagnosed(log, vessel))
        print(f"{hidden}: {answer}; {time.perf_counter() - began:.0f} s", flush=True)


def tell_together(
    names: Iterable[str], out: Path, vessel: Path, sail: Callable[[str, Path], list[Path]]
) -> None:
    """Two lines for the voyages of each name that `sail` writes into a folder: the answer to all
    but the last of them together, and what the vessel that was found predicts of the last.
    """
    for name in names:
        began = time.perf_counter()
        *logs, kept = sail(name, out)
        answer, better = out / f"{name}.json", out / f"{name}.toml"
        better.unlink(missing_ok=True)
        shadow("diagnose", *logs, "--vessel", vessel, "--save", answer, "--out", better, "--force")
        print(f"{name}: {told(answer)}; {time.perf_counter() - began:.0f} s", flush=True)
        if better.exists():
            both = ("--vessel", vessel, "--vessel", better, "--refit", "voyage")
            rows = json.loads(shadow("compare", kept, *both, "--json"))["trials"]
            before, after = (row["nrmse"] for row in rows)
            floor = rows[0]["noise_floor_nrmse"]
            print(f"    kept back: {before:.3f} → {after:.3f} (noise {floor:.3f})", flush=True)


def diagnosed(log: Path, vessel: Path) -> Path:
    """The answer of `shadow diagnose`, beside the log."""
    answer = log.with_suffix(".json")
    shadow("diagnose", log, "--vessel", vessel, "--save", answer, "--force")
    return answer


def shadow(*words: str | Path) -> str:
    """One command, as typed; an error ends here."""
    done = subprocess.run(
        [Path(sys.executable).parent / "shadow", *map(str, words)], capture_output=True, text=True
    )
    if done.returncode:
        raise SystemExit(f"shadow {words[0]}: {done.stderr.strip()}")
    return done.stdout


def told(answer: Path) -> str:
    """The answer of a diagnosis in one line."""
    said = json.loads(answer.read_text(encoding="utf-8"))
    first, last = said["ladder"][0]["heldout_nrmse"], said["ladder"][-1]["heldout_nrmse"]
    names = " and ".join(said["effects"])
    rivals = dict.fromkeys(name for row in said["ranking"] for name in row["confounded_with"])
    alike = "".join(f" or {name}" for name in rivals if names and name not in said["effects"])
    base = ", base moved" if said["base_changed"] else ""
    curve = f", curve of {said['curve']['effects'][-1]}" if said.get("curve") else ""
    return (
        f"{said['verdict']}{base}{': ' if names else ''}{names}{alike}{curve}; "
        f"{first:.3f} → {last:.3f} (noise {said['noise_floor_nrmse']:.3f})"
    )
