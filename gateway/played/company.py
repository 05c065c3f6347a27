"""Says when a played boat speaks to nobody for a while, and when somebody is there; once each."""

from collections.abc import Callable

from gateway.played.play import Played

PATIENCE_S = 2.0


class Company:
    """Of one endpoint; `note` is called each turn of the play."""

    def __init__(self, endpoint: str, tell: Callable[[str], None]) -> None:
        self._endpoint, self._tell = endpoint, tell
        self._since_s = 0.0
        self._said = False

    def note(self, played: Played) -> None:
        """Tell what has changed."""
        if played.alone is None:
            if self._said:
                self._tell(f"{self._endpoint}: connected")
            self._since_s, self._said = played.seconds, False
        elif not self._said and played.seconds - self._since_s >= PATIENCE_S:
            self._tell(f"{self._endpoint}: {played.alone}")
            self._said = True
