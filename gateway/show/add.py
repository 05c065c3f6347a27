"""What `shadow add` put into a vessel, what it was worth, and how to see that on other data."""

from collections.abc import Sequence
from pathlib import Path
from shlex import quote

from rich.console import Console
from rich.table import Table

from gateway.pipelines.add import Added
from sim.effects.effect import Scope


def show_added(done: Added, names: Sequence[str], vessel: Path, out: Path) -> None:
    """Numbers with intervals, error before and after, the next command line."""
    console = Console(highlight=False)
    table = Table(title=f"{done.vessel.name} with {', '.join(names)}", title_justify="left")
    for name in ("parameter", "value", "95 % interval", "unit"):
        right = name in ("value", "95 % interval")
        table.add_column(name, justify="right" if right else "left", no_wrap=True)
    for effect, numbers in done.effects.items():
        for key, n in numbers.items():
            low, high = n.ci95
            interval = f"{low:.4g} … {high:.4g}" if low < high else "chosen, not fitted"
            table.add_row(f"{effect}.{key}", f"{n.value:.4g}", interval, n.unit)
    console.print(table)
    console.print(
        f"error on unseen time of {', '.join(done.recordings) or 'the recording'}: "
        f"{done.before:.3f} before, {done.after:.3f} after; the base was re-fitted along",
        markup=False,
    )
    console.print(f"written: {out}", soft_wrap=True, markup=False)
    today = any(
        a.effect.scope is Scope.VOYAGE for a in done.vessel.effects if a.effect.name in names
    )
    console.print(
        f"next: shadow compare ANOTHER_LOG --vessel {quote(str(vessel))} "
        f"--vessel {quote(str(out))}{' --refit voyage' if today else ''}",
        soft_wrap=True, markup=False,
    )  # fmt: skip
