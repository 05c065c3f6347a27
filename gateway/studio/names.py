"""Names of files and recordings on the pages: each its own.

Files of several folders may be called alike, and so may a .tlog and a .BIN of one voyage.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from gateway.errors import BadInput, printable
from gateway.studio import Scope
from sim.trial import Trial


def labels(files: Sequence[Path]) -> dict[str, Path]:
    """Files by their names to choose from; behind a name that several have stands the folder."""
    times = Counter(file.name for file in files)
    return {
        file.name if times[file.name] == 1 else f"{file.name} ({file.parent})": file
        for file in files
    }


def recording_names(paths: Sequence[str]) -> dict[str, str]:
    """Recordings that are worked on together: path -> name, no longer than it takes to be its own.

    A recording that is alone is called as everywhere else, by its file's name without the suffix.
    """
    every = dict.fromkeys(paths)
    stems = Counter(map(_stem, every))
    return {
        path: _stem(path) if stems[_stem(path)] == 1 else printable(label)
        for path, label in zip(every, labels([Path(path) for path in every]), strict=True)
    }


def with_name(trial: Trial, path: str, name: str) -> Trial:
    """A trial of a recording under another name of that recording; which part it is stays."""
    return replace(trial, name=f"{name}{trial.name.removeprefix(_stem(path))}")


def scope_alone(scope: Scope, names: Mapping[str, str], learnt: Sequence[str]) -> Scope:
    """A scope for work on a few of the recordings, which are called there by their files' names.

    BadInput where that name is the same for two of them.
    """
    twice = [stem for stem, times in Counter(map(_stem, learnt)).items() if times > 1]
    if twice:
        raise BadInput(f"{' and '.join(twice)}: several recordings to learn from have this name: "
                       "learn from one of them, or rename one")  # fmt: skip
    for path in learnt:
        part = scope.recording.removeprefix(names[path])
        if scope.recording == names[path] or (part != scope.recording and part.startswith(" #")):
            return replace(scope, recording=f"{_stem(path)}{part}")
    return scope


def _stem(path: str) -> str:
    return printable(Path(path).stem)
