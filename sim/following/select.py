"""The one list of plants. A new kind is one new file and one line here."""

from collections.abc import Callable, Mapping

from sim.following.follower import Follower, Following, VesselFollower
from sim.following.stepwise import PlantFollower
from sim.model import Model
from sim.plants.plant import Plant
from sim.plants.vessel_plant import VesselPlant

Build = Callable[[Model], Plant]

PLANTS: Mapping[str, Build] = {
    "vessel": VesselPlant,
}


def follower_for(
    model: Model,
    options: Following | None = None,
    kind: str = "vessel",
    more: Mapping[str, Build] | None = None,
) -> Follower:
    """A follower that drives a plant of that kind, sized after the model's vessel.

    KeyError names the kinds there are. A vessel whose laws numba compiles takes the compiled loop.
    """
    known = {**PLANTS, **(more or {})}
    if kind not in known:
        raise KeyError(f"no plant named {kind!r}: there are {', '.join(sorted(known))}")
    if kind == "vessel" and model.kernel.compiled:
        return VesselFollower.of(model, options)
    return PlantFollower.of(known[kind](model), options, model.vessel)
