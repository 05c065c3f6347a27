"""`shadow vessel`: the passport of a vessel file."""

from pathlib import Path
from typing import Annotated

import typer

from gateway.commands.options import AsJson, EffectFiles, effects_from, print_result

app = typer.Typer(
    rich_markup_mode=None,
    no_args_is_help=True,
    help="Where the numbers of a vessel file come from, how two files differ, what changed when.",
)
File = Annotated[Path, typer.Argument(metavar="FILE", help="A vessel file, or one that ships.")]


@app.command()
def show(file: File, effects: EffectFiles = None, json: AsJson = False) -> None:
    """Every number with its interval and its origin: recording, fit, date."""
    from gateway.offline.passport import passport
    from gateway.terminal.passport import show_passport

    read = passport(file, effects_from(effects))
    print_result(json, read.to_dict, lambda: show_passport(read))


@app.command()
def diff(
    first: File,
    second: Annotated[Path, typer.Argument(metavar="FILE2", help="The other one.")],
    effects: EffectFiles = None,
    json: AsJson = False,
) -> None:
    """What differs between two vessel files, and whether it is beyond their intervals."""
    from gateway.offline.passport import diff_as_dict, passport
    from gateway.terminal.passport import show_difference

    own = effects_from(effects)
    a, b = passport(first, own), passport(second, own)
    print_result(json, lambda: diff_as_dict(a, b), lambda: show_difference(a, b))


@app.command()
def history(file: File, effects: EffectFiles = None, json: AsJson = False) -> None:
    """Which commands changed which numbers, when, on which recordings."""
    from gateway.offline.passport import passport
    from gateway.terminal.passport import show_history

    read = passport(file, effects_from(effects))
    print_result(json, read.history_as_dict, lambda: show_history(read))
