"""Commands for what a model lacks: find it, put it in, read about it."""

from pathlib import Path
from typing import Annotated

import typer

from gateway.commands.options import (
    AsJson,
    EffectFiles,
    LogFiles,
    Mapping,
    System,
    VesselFile,
    effects_from,
    print_result,
)
from gateway.errors import BadInput


def diagnose(
    logs: LogFiles,
    vessel: VesselFile,
    improve: Annotated[
        bool, typer.Option(help="Look on beside what was found, until nothing more is justified.")
    ] = True,
    pictures: Annotated[
        Path | None, typer.Option(help="Folder for pictures (PNG): ladder, ranking, evidence.")
    ] = None,
    save: Annotated[
        Path | None, typer.Option("--save", help="The answer as JSON, for shadow add --from.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="The better vessel file to write.")
    ] = None,
    prior: Annotated[
        float | None,
        typer.Option(
            metavar="SHARE",
            help="How far off the base numbers may be; left out: 0.15 (15 %), or 1 where the file "
            "says that they were guessed.",
        ),
    ] = None,
    effects: EffectFiles = None,
    system: System = None,
    mapping: Mapping = None,
    json: AsJson = False,
) -> None:
    """Which physical effect is missing from the model, how sure that is, and what to do next."""
    from gateway.offline.diagnose import check_folders, diagnose_logs, save_diagnosis
    from gateway.terminal.console import status
    from gateway.terminal.diagnosis import show_diagnosis

    if prior is not None and not 0.0 < prior <= 10.0:
        raise BadInput(f"--prior {prior:g}: expected a share of the numbers, as 0.15")
    check_folders(save, out)
    own = effects_from(effects)
    with status("diagnosing") as tell:
        found = diagnose_logs(
            logs, vessel, improve=improve, prior=prior, system=system, mapping=mapping,
            effects=own, tell=tell,
        )  # fmt: skip
        save_diagnosis(found, save=save, out=out, pictures=pictures, effects=own, tell=tell)
    print_result(json, found.to_dict, lambda: show_diagnosis(found, save, out, pictures))


def add(
    names: Annotated[list[str], typer.Argument(metavar="EFFECT", help="Effects, by name.")],
    vessel: VesselFile,
    source: Annotated[
        Path, typer.Option("--from", help="What shadow diagnose --save wrote.", metavar="JSON")
    ],
    out: Annotated[Path, typer.Option("--out", help="The vessel file to write.")],
    effects: EffectFiles = None,
) -> None:
    """The better model: effects and re-fitted base from a diagnosis, into a new vessel file."""
    from gateway.offline.add import add_effects
    from gateway.offline.diagnose import check_folders
    from gateway.terminal.diagnosis import show_addition

    check_folders(out)
    done = add_effects(names, vessel, source, out, effects_from(effects))
    show_addition(done, names, vessel, out)


def show_effects(
    name: Annotated[str | None, typer.Argument(help="One effect, explained.")] = None,
    picture: Annotated[
        Path | None, typer.Option(help="With NAME: what it does, as .png or .svg.")
    ] = None,
    write: Annotated[
        Path | None, typer.Option(help="With NAME: its file under another name, to make your own.")
    ] = None,
    effects: EffectFiles = None,
) -> None:
    """The catalogue of physical effects: equation, parameters, what it looks like in the data."""
    from gateway.terminal.effects import show_catalogue, show_effect, show_effect_file
    from gateway.user_effects import known_effects, write_effect_copy

    known = [*known_effects(), *effects_from(effects)]
    if name is None and picture is not None:
        raise BadInput("--picture: of which effect? shadow effects NAME --picture FILE.png")
    if name is None and write is not None:
        raise BadInput("--write: like which effect? shadow effects NAME --write FILE.py")
    if name is None:
        show_catalogue(known)
        return
    chosen = [effect for effect in known if effect.name == name]
    if not chosen:
        raise BadInput(f"no effect named {name!r}: there are {', '.join(e.name for e in known)}")
    if write is not None:
        write_effect_copy(chosen[0], write)
        show_effect_file(chosen[0], write)
        return
    show_effect(chosen[0], picture)
