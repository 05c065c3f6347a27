"""Files that ship with the program: vessels, recordings, layouts.

In a checkout they stand in the repository's folders `configs` and `recordings`; a wheel carries the
same folders inside the package.
"""

from pathlib import Path

INSTALLED = Path(__file__).parent / "_shipped"
ROOT = INSTALLED if INSTALLED.is_dir() else Path(__file__).resolve().parent.parent
VESSELS = ROOT / "configs" / "vessels"
RECORDINGS = ROOT / "recordings"
LAYOUT = ROOT / "configs" / "foxglove-layout.json"


def vessel_names() -> list[str]:
    """Names under which the vessels that ship can be given instead of a file."""
    return sorted(file.stem for file in VESSELS.glob("*.toml"))


def vessel_path(given: str | Path) -> Path:
    """A vessel file as it was given, or that of a shipped vessel by its name (`otter`).

    A file of that name in the working folder goes first.
    """
    file, name = Path(given), str(given)
    if not file.exists() and name in vessel_names():
        return VESSELS / f"{name}.toml"
    return file
