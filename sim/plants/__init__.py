"""What the follower drives: one kind of plant per file, and one table of them all.

A new kind is one new file and one line here.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from sim.model import Model
from sim.plants.mujoco_hull import MujocoHull
from sim.plants.plant import Plant, VesselPlant
from sim.vessel import Vessel


class PlantKind(NamedTuple):
    """A kind of plant.

    name         as the command line takes it
    description  what it is, in one line
    build        makes a plant from the model of a vessel
    reads        of a kind that is no vessel: makes `build` from a file's name, with the file's text
    """

    name: str
    description: str
    build: Callable[[Model], Plant]
    reads: Callable[[str], tuple[Callable[[Model], Plant], str]] | None = None


VESSEL = PlantKind("vessel", "the equations of a vessel file, moved by a force", VesselPlant)
MUJOCO = PlantKind(
    "mujoco",
    "the hull afloat in MuJoCo, six degrees of freedom, waves included (extra: mujoco)",
    MujocoHull.of,
)


class PlantChoice(NamedTuple):
    """The plant for a boat: its kind, and the vessel it is made from (None: the boat's own).

    `table` is the text of its file, where that is no vessel.
    """

    kind: PlantKind = VESSEL
    vessel: Vessel | None = None
    table: str = ""


OWN_VESSEL = PlantChoice()

PLANTS: Mapping[str, PlantKind] = {kind.name: kind for kind in (VESSEL, MUJOCO)}
