"""The paper's tables, run again beside the paper's figures.

    python -m benchmarks.paper [--out out/paper] [--write] [--seed 7]

Prints Tables 4 to 8 and the digital shadow, saves plots; `--write` renews results.md here.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.paper.campaign import Campaign, Lengths, run
from benchmarks.paper.instruments import ALL
from benchmarks.paper.part import Part
from benchmarks.paper.shadow import shadows
from benchmarks.paper.table4 import table_4
from benchmarks.paper.table5 import table_5
from benchmarks.paper.table6 import table_6
from benchmarks.paper.table7 import table_7
from benchmarks.paper.table8 import table_8
from gateway.figures.matplotlib_draw import save_figure

HERE = Path(__file__).parent


def parts(c: Campaign, folder: Path) -> Iterator[Part]:
    """All experiments on one campaign."""
    for table in (table_4, table_5, table_6, table_7, table_8):
        yield table(c)
    yield shadows(c, folder)


def preface(lengths: Lengths) -> str:
    """What was assumed, in words."""
    return "\n".join([
        "# The paper again: measured", "",
        "Written by `python -m benchmarks.paper --write`; figures of the paper are from "
        "Saldarriaga-Mesa et al., Robotics 2025, 14(9), 124.", "",
        f"Plants have the parameters of Table 5. {lengths.identification:g} s of sinusoidal, "
        f"square, mixed, constant and random commands to identify, {lengths.validation:g} s of "
        f"others to validate, {lengths.joystick:g} s of joystick; seed {lengths.seed}; first "
        "guesses 10 % off. Sensor errors (Gauss–Markov, and white on top), then the gateway's own "
        "decoding and smoother:", "",
        *(f"- {carried.says()}" for carried in ALL), "",
    ])  # fmt: skip


def summary(done: Sequence[Part]) -> str:
    """Every demand and whether it is met."""
    lines = ["## In short", ""]
    for part in done:
        lines += [f"- {'✓' if good else '✗'} {part.title.split(':')[0]}: {name}"
                  for name, good in part.held.items()]  # fmt: skip
    return "\n".join([*lines, ""])


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.paper", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/paper"), help="folder for the plots")
    parser.add_argument("--write", action="store_true", help="renew benchmarks/paper/results.md")
    parser.add_argument("--seed", type=int, default=Lengths().seed)
    a = parser.parse_args(arguments)
    begun, lengths, done = time.perf_counter(), Lengths(seed=a.seed), []
    with tempfile.TemporaryDirectory() as folder:
        campaign = run(lengths, Path(folder), lambda says: print(says, file=sys.stderr))
        print(preface(lengths))
        for part in parts(campaign, Path(folder)):
            print(part.text(), flush=True)
            done.append(part)
    print(summary(done))
    for part in done:
        for name, picture in part.pictures.items():
            save_figure(picture, a.out / f"{name}.png")
    if a.write:
        text = "\n".join([preface(lengths), summary(done), *(part.text() for part in done)])
        (HERE / "results.md").write_text(text, encoding="utf-8")
    print(f"{time.perf_counter() - begun:.0f} s; plots in {a.out}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
