"""Sentences of the story, each from the numbers that it is about: it says what they say."""

from collections.abc import Mapping, Sequence

from sim.comparison.compare import ADEQUATE_FLOORS, Comparison
from sim.identification.intervals import Estimate
from sim.vessel import AddedEffect


def intervals_sentence(estimates: Sequence[Estimate], true: Mapping[str, float]) -> str:
    """How many intervals hold the number that the boat in the loop really has."""
    known = [e for e in estimates if e.name in true]
    holding = [e.name for e in known if e.ci95[0] <= true[e.name] <= e.ci95[1]]
    missing = [e.name for e in known if e.name not in holding]
    text = f"{len(holding)} of {len(known)} intervals hold the number that the boat really has"
    return f"{text}; not that of {', '.join(missing)}" if missing else text


def error_sentence(what: str, before: Comparison, after: Comparison) -> str:
    """Two errors on one recording, and whether the second is lower, and at the floor."""
    numbers = f"{before.nrmse:.3f} → {after.nrmse:.3f}"
    if after.nrmse < before.nrmse:
        verdict = f"the error of {what} falls"
    elif after.nrmse > before.nrmse:
        verdict = f"the error of {what} does not fall, it rises"
    else:
        verdict = f"the error of {what} stays as it is"
    floor = after.noise_floor_nrmse
    at_floor = after.nrmse <= ADEQUATE_FLOORS * floor
    rest = "no more than noise" if at_floor else "more than noise"
    return f"{verdict}: {numbers}, which is {rest} (noise alone may show {floor:.3f})"


def effect_text(added: AddedEffect) -> str:
    """`NAME (PARAMETER 0.8, …)`."""
    numbers = ", ".join(f"{name} {value:.3g}" for name, value in added.values.items())
    return f"{added.effect.name} ({numbers})"


def named_sentence(hidden: Sequence[AddedEffect], found: Sequence[AddedEffect]) -> str:
    """What a diagnosis has named, held against what was hidden."""
    was, named = {a.effect.name for a in hidden}, {a.effect.name for a in found}
    said = " and ".join(map(effect_text, found))
    truth = " and ".join(map(effect_text, hidden))
    if not named:
        return f"it names nothing; hidden was {truth}"
    if named == was:
        return f"it names {said}: that is what was hidden, {truth}"
    if was <= named:
        return f"it names {said}: what was hidden, {truth}, and more that was not"
    if named & was:
        return f"it names {said}: a part of what was hidden, {truth}"
    return f"it names {said}: that is not what was hidden, {truth}"
