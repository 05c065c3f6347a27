"""Effects from outside the package: a Python file named by its user, or an installed plug-in.

An effect of one's own is a program, a vessel file is data: a file that a vessel file names runs
only where it lies within the vessel's folder and was trusted once as it is now, by its hash
(`shadow trust FILE`). A plug-in registers its `Effect` objects under the entry point group
`shadow.effects`.
"""

import hashlib
import linecache
import sys
from functools import lru_cache
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from gateway.errors import BadInput, ShadowError
from gateway.files import recall, remember, state_folder, write_whole
from sim.effects.catalogue import EFFECTS, mistaken_for
from sim.effects.effect import Effect, Values
from sim.effects.tables import Formula


@lru_cache(maxsize=1)
def known_effects() -> tuple[Effect, ...]:
    """The catalogue, then what installed plug-ins add."""
    plugged = (point.load() for point in entry_points(group="shadow.effects"))
    return (*EFFECTS, *(effect for effect in plugged if isinstance(effect, Effect)))


def described(effect: Effect) -> dict[str, object]:
    """An effect as plain values: what it is, its parameters with units and bounds."""
    return {
        "name": effect.name,
        "scope": effect.scope.value,
        "looks_like": effect.looks_like,
        "mistaken_for": list(mistaken_for(effect)),
        "parameters": [
            {"name": p.name, "unit": p.unit, "lower": p.lower, "upper": p.upper, "start": p.start}
            for p in effect.parameters
        ],
        "explanation": effect.explanation,
    }


TRUSTED = "trusted"  # the kind of entry in the user's state; its key is the hash of a file


def load_effects(path: str | Path) -> tuple[Effect, ...]:
    """All effects that a Python file defines at its top level; BadInput where it cannot be run.

    The file is run: give one that the user named, `load_trusted_effects` for any other.
    """
    file = Path(path)
    return _effects_of(file, _raw(file))


def load_trusted_effects(path: str | Path) -> tuple[Effect, ...]:
    """Effects of a file that nobody named: BadInput unless it was trusted as it is now."""
    file = Path(path)
    return _trusted_effects_of(file, _raw(file))


def _trusted_effects_of(file: Path, raw: bytes) -> tuple[Effect, ...]:
    if not _is_trusted(raw):
        raise BadInput(
            f"an effect of one's own is a program, and this one was not trusted as it is now: "
            f"read it, then `shadow trust {file}` once, or name it with --effects {file}"
        )
    return _effects_of(file, raw)


def trust(path: str | Path) -> tuple[Effect, ...]:
    """Remember that this very file may run wherever a vessel file names it -> its effects."""
    file = Path(path)
    raw = _raw(file)
    found = _effects_of(file, raw)
    if not remember(TRUSTED, _digest(raw), {"file": str(file.resolve())}):
        raise ShadowError(f"{file}: cannot remember it: {state_folder()} cannot be written")
    return found


class EffectFile(NamedTuple):
    """A file of effects, and whether its user named it, rather than a vessel file.

    raw     its content as it was taken; None: as it is when it is loaded
    """

    path: str
    named: bool = True
    raw: bytes | None = None

    @property
    def content(self) -> bytes:
        """What it holds; BadInput where it cannot be read."""
        return _raw(Path(self.path)) if self.raw is None else self.raw

    @property
    def is_trusted(self) -> bool:
        """Whether a vessel file that names it may run it."""
        return _is_trusted(self.content)

    def taken(self) -> "EffectFile":
        """It with its content of now, which stays whatever becomes of the file."""
        return self._replace(raw=_raw(Path(self.path)))

    def load(self) -> tuple[Effect, ...]:
        """Its effects; BadInput where it may not run."""
        load = _effects_of if self.named else _trusted_effects_of
        return load(Path(self.path), self.content)


def effect_file_beside(vessel_file: Path, source: Any) -> Path:
    """The path that a vessel file names; BadInput where it leads out of the vessel's folder."""
    if not isinstance(source, str):
        raise BadInput(f"{source!r}: expected a path")
    file = vessel_file.parent / source
    if not file.resolve().is_relative_to(vessel_file.parent.resolve()):
        raise BadInput(
            f"{source}: is not in the folder of the vessel file: put it there, or name it with "
            "--effects"
        )
    return file


def _is_trusted(raw: bytes) -> bool:
    return recall(TRUSTED, _digest(raw)) is not None


def _digest(raw: bytes) -> str:
    return hashlib.sha256(raw).hexdigest()


def _raw(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise BadInput(f"{file}: cannot read the effect file: {error.strerror}") from None


def _effects_of(file: Path, raw: bytes) -> tuple[Effect, ...]:
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError:
        raise BadInput(f"{file}: not a Python file: its text is not UTF-8") from None
    found = tuple(v for v in vars(_module_of(file, text)).values() if isinstance(v, Effect))
    if not found:
        raise BadInput(f"{file}: defines no Effect (see docs/effects.md for one in twenty lines)")
    return found


def write_effect_copy(like: Effect, file: Path) -> None:
    """Write the source of an effect under another name, as a pattern for an effect of one's own.

    BadInput for a table, which only a diagnosis fills.
    """
    if like.is_curve:
        raise BadInput(
            f"{like.name}: a table that a diagnosis fills is no pattern for a law: --from "
            "diagnosis.json begins with the formula found for it, if there is one; else begin with "
            "an effect that has a law (shadow effects)"
        )
    _write_effect(like.source_code.replace(f'name="{like.name}"', f'name="{file.stem}"'), file)


def write_effect_formula(like: Effect, table: Values, formula: Formula, file: Path) -> None:
    """Write an effect of one's own that has a formula for the table of `like`.

    BadInput where the effect holds no table, or the library no such form.
    """
    if like.formula_source is None and like.is_curve:
        raise BadInput(f"{like.name}: no formula stands for this table: begin with another effect")
    if like.formula_source is None:
        raise BadInput(f"{like.name}: has a law of its own: leave out --from")
    try:
        text = like.formula_source(file.stem, table, formula)
    except (KeyError, ValueError) as error:
        raise BadInput(f"the diagnosis holds a formula that is not known here: {error}") from None
    _write_effect(text, file)


def _write_effect(text: str, file: Path) -> None:
    """A Python file under a name that no effect has."""
    name = file.stem
    if not name.isidentifier() or file.suffix != ".py":
        raise BadInput(f"{file}: a Python file whose name is that of the new effect: keel.py")
    if name in {effect.name for effect in known_effects()}:
        raise BadInput(f"{file}: there is an effect {name}: choose another name")
    write_whole(file, text.encode(), "the effect")


def _module_of(file: Path, text: str) -> ModuleType:
    """Run an effect file's text as a module.

    Python's own loader would take stale bytecode for a file edited twice within a second. The
    content is in the module's name: an edited file is another module, its kernel another kernel.
    """
    name = f"effect_file_{hashlib.sha256(text.encode()).hexdigest()[:16]}"
    if name in sys.modules:
        return sys.modules[name]
    module = ModuleType(name)
    module.__file__ = str(file)
    # None for its time of change: `inspect` and tracebacks then quote what was run
    linecache.cache[str(file)] = (len(text), None, text.splitlines(keepends=True), str(file))
    sys.modules[name] = module
    try:
        exec(compile(text, str(file), "exec"), module.__dict__)
    except (Exception, SystemExit) as error:  # whatever a user's file raises is one line
        del sys.modules[name]
        message = " ".join(str(error).split())
        raise BadInput(f"{file}: {type(error).__name__}: {message}") from None
    return module
