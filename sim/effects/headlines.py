"""What an effect with its fitted numbers says, in a sentence: terminal, report and studio say it
alike. An effect without words of its own (`Effect.in_words`) says what it looks like.
"""

from collections.abc import Mapping

from sim.effects.effect import Effect
from sim.effects.words import FittedValues


def headline(
    effect: Effect, values: Mapping[str, float],
    ci95: Mapping[str, tuple[float, float]] | None = None, start_time_ns: int = 0,
) -> str:  # fmt: skip
    """The sentence, without a full stop; it begins with a capital letter.

    start_time_ns  UTC of the first sample, for moments by the clock; 0: not known
    """
    if effect.in_words is not None:
        text = effect.in_words(FittedValues(values, ci95 or {}, start_time_ns))
    else:
        text = f"{effect.name.replace('_', ' ')}: {effect.looks_like}"
    return text[0].upper() + text[1:]
