"""Commands about physical effects: the catalogue, and whose code may run."""

from pathlib import Path
from typing import Annotated

import typer

from gateway.commands import AsJson, EffectFiles, Force, effects_from, print_result
from gateway.commands.completion import effects_begun
from gateway.errors import BadInput, printable
from gateway.files import guarded_outputs, named_as


def show_effects(
    name: Annotated[
        str | None,
        typer.Argument(help="One effect, explained.", autocompletion=effects_begun),
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(help="With NAME: what it does, as .png or .svg.")
    ] = None,
    write: Annotated[
        Path | None, typer.Option(help="With NAME: its file under another name, to make your own.")
    ] = None,
    source: Annotated[
        Path | None,
        typer.Option(
            "--from", help="With --write: begin with the formula of this diagnosis.", metavar="JSON"
        ),
    ] = None,
    effects: EffectFiles = None,
    force: Force = False,
    json: AsJson = False,
) -> None:
    """The catalogue of physical effects: equation, parameters, what it looks like in the data."""
    from gateway.offline.add import formula_in
    from gateway.terminal.diagnosis import show_catalogue, show_effect, show_effect_file
    from gateway.user_effects import (
        described,
        known_effects,
        write_effect_copy,
        write_effect_formula,
    )
    from gateway.vessel_file import which_effect

    known = [*known_effects(), *effects_from(effects)]
    if name is None and picture is not None:
        raise BadInput("--picture: of which effect? shadow effects NAME --picture FILE.png")
    if name is None and write is not None:
        raise BadInput("--write: like which effect? shadow effects NAME --write FILE.py")
    if source is not None and write is None:
        raise BadInput("--from: the formula of a diagnosis goes into a file: add --write own.py")
    if name is None:
        print_result(
            json,
            lambda: {"effects": [described(e) for e in known]},
            lambda: show_catalogue(known),
        )
        return
    chosen = [effect for effect in known if effect.name == name]
    if not chosen:
        which = which_effect(name, (effect.name for effect in known))
        raise BadInput(f"no effect named {name!r}: {which}")
    inputs = [*(effects or ()), *([source] if source else [])]
    outputs = [named_as(picture, ".png", ".svg"), named_as(write, ".py")]
    with guarded_outputs("effects", inputs, outputs, force):
        if write is not None:
            if source is None:
                write_effect_copy(chosen[0], write)
            else:
                write_effect_formula(chosen[0], *formula_in(source), write)
            print_result(
                json, lambda: {"written": str(write)}, lambda: show_effect_file(chosen[0], write)
            )
            return
        if json and picture is not None:
            raise BadInput("--picture: is drawn beside the text; leave out --json")
        print_result(json, lambda: described(chosen[0]), lambda: show_effect(chosen[0], picture))


def trust(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE", help="A Python file with effects, or a vessel file's all."),
    ],
    json: AsJson = False,
) -> None:
    """Let an effect of your own run where a vessel file names it, as long as nobody edits it."""
    from gateway.user_effects import effect_file_beside
    from gateway.user_effects import trust as work
    from gateway.vessel_file import read_vessel_file

    trusted, empty = list[dict[str, object]](), list[str]()
    for file in files:
        if file.suffix.lower() != ".toml":
            named = [file]
        else:
            entries = read_vessel_file(file).effects
            named = [effect_file_beside(file, e["file"]) for e in entries if "file" in e]
        for one in named:
            names = [effect.name for effect in work(one)]
            trusted.append({"file": str(one), "effects": names})
            if not json:
                print(printable(f"{one}: trusted as it is now: {', '.join(names)}"))
        if not named:
            empty.append(str(file))
            if not json:
                text = f"{file}: names no effects of one's own: there is nothing to trust"
                print(printable(text))
    print_result(json, lambda: {"trusted": trusted, "without_effects": empty}, lambda: None)
