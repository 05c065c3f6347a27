"""A name that nobody knows: which of those there are was meant, where that can be told."""

from collections.abc import Iterable
from difflib import SequenceMatcher, get_close_matches

TYPO = 0.8  # as alike two names are where one is the other with a letter wrong, as difflib tells
LEAST_ALIKE = 0.6  # of names as short as m11, where one letter is a third of it


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """`did you mean NAME? `, to go before what there is; empty where none is alike enough."""
    small, names = name.lower(), {one.lower(): one for one in known}
    one_wrong = (len(name) - 1) / max(len(name), 1)
    near = get_close_matches(small, names, 3, min(TYPO, max(LEAST_ALIKE, one_wrong)))
    alike = [SequenceMatcher(None, one, small).ratio() for one in near]
    best = {one for one, ratio in zip(near, alike, strict=True) if ratio == alike[0]}
    meant = [name for one, name in names.items() if one in best]
    return f"did you mean {' or '.join(meant)}? " if meant else ""
