"""Effects of one's own of the vessel that is open: their files as they were taken, and as they are
saved with it.

The studio works on the texts that it took: a file that is edited or removed meanwhile changes no
number before it is said. Within the studio a vessel's text names none of its files, for a path
holds only where the vessel file lies; a vessel file that leaves the studio names them again.
"""

import tomllib
from collections.abc import Mapping, Sequence
from itertools import chain, count
from pathlib import Path
from typing import NamedTuple

import tomli_w

from gateway.user_effects import EffectFile, effect_file_beside
from gateway.vessel_file import read_vessel_file


class TakenVessel(NamedTuple):
    """A vessel file's text without paths, and its effect files with their contents."""

    text: str
    effects: tuple[EffectFile, ...]


def take_vessel(file: Path, named: Sequence[EffectFile] = ()) -> TakenVessel:
    """A vessel file as it is now, with the effect files that its user named and those it names.

    A copy of a file that its user named may run as that one may.
    """
    text, paths = _without_paths(file)
    mine = [one.taken() for one in named]
    known, contents = {Path(one.path).resolve() for one in mine}, {one.raw for one in mine}
    beside = [EffectFile(str(path), named=False).taken() for path in paths
              if path.resolve() not in known]  # fmt: skip
    more = [one._replace(named=one.raw in contents) for one in beside]
    return TakenVessel(text, (*mine, *more))


def _without_paths(file: Path) -> tuple[str, tuple[Path, ...]]:
    entries = read_vessel_file(file).effects
    text = file.read_text(encoding="utf-8")
    named = [entry["file"] for entry in entries if "file" in entry]
    paths = tuple(dict.fromkeys(effect_file_beside(file, one) for one in named))
    if not paths:
        return text, ()
    tables = tomllib.loads(text)
    for entry in tables["effects"]:
        entry.pop("file", None)
    return tomli_w.dumps(tables), paths


def with_effects(
    files: Sequence[EffectFile], taken: Sequence[EffectFile]
) -> tuple[EffectFile, ...]:
    """The files known so far, and those taken now, which go before others of their path or name."""
    again = {Path(one.path).resolve() for one in taken}
    return (*(one for one in files if Path(one.path).resolve() not in again), *taken)


class VesselToSave(NamedTuple):
    """The text of a vessel file, and what has to lie beside it: name -> effect file."""

    text: str
    beside: Mapping[str, EffectFile]

    def to_trust(self, file: str) -> str:
        """What has to be said to the shell before the vessel file can be used; mostly nothing."""
        if all(one.is_trusted for one in self.beside.values()):
            return ""
        return f"; before it can be used without --effects say `shadow trust {file}` once"


def vessel_to_save(
    text: str, files: Sequence[EffectFile], folder: Path | None = None
) -> VesselToSave:
    """A vessel's text that names the files of its own effects.

    `folder`: where it goes; no other file there has the name of one of them.
    """
    own = {effect.name: file for file in files for effect in file.load()}
    tables = tomllib.loads(text)
    beside: dict[str, EffectFile] = {}
    for entry in tables.get("effects", []):
        if entry["type"] in own:
            file = own[entry["type"]]
            entry["file"] = _free_name(file, beside, folder)
            beside[entry["file"]] = file
    return VesselToSave(tomli_w.dumps(tables) if beside else text, beside)


def _free_name(file: EffectFile, beside: Mapping[str, EffectFile], folder: Path | None) -> str:
    """The file's own name, or numbered where another content has it."""
    path = Path(file.path)

    def is_free(name: str) -> bool:
        there = folder / name if folder is not None else None
        if name in beside:
            return beside[name].content == file.content
        return there is None or not there.exists() or there.read_bytes() == file.content

    names = chain([path.name], (f"{path.stem}-{k}.py" for k in count(2)))
    return next(filter(is_free, names))
