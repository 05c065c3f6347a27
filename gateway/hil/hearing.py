"""Whether the autopilot of one boat is heard, and what is said when it is not.

A program that was itself stopped, or kept waiting by the machine, has heard nothing either: that
time is not the autopilot's silence.
"""

from gateway.hil import Notices, Session

SILENT_S = 5.0  # an autopilot that has said nothing for so long is reported
HELD_UP_S = 3.0  # beyond what was asked for; a busy machine takes a second now and then; chosen


class Hearing:
    """Moments are of the clock on the wall [s, monotonic]; `begun`: when the first bytes came."""

    def __init__(self, session: Session, notices: Notices, now: float) -> None:
        self._session, self._notices = session, notices
        self.begun: float | None = None
        self._heard = self._looked = now
        self._told = False

    def waited(self, asked_s: float, now: float) -> None:
        """A wait is over that was asked to last so long [s] at most."""
        held_up_s = max(now - self._looked - asked_s, 0.0)
        self._heard, self._looked = min(self._heard + held_up_s, now), now
        if self.begun is not None and held_up_s > HELD_UP_S:
            self._notices.say(
                "held up",
                f"this program itself was stopped or kept waiting for {held_up_s:.0f} s, and the "
                "boat stood still meanwhile: keep the machine awake and its load low; if the "
                "firmware's filter has failed, restart the firmware",
            )

    def heard(self, now: float) -> None:
        """Bytes have come."""
        self.begun = self.begun or now
        self._heard, self._told = now, False

    def look(self, now: float, connected: bool) -> bool:
        """Say what keeps an autopilot away, or that it has fallen silent -> whether it has just."""
        silent, talks = now - self._heard > SILENT_S, self._session.talks
        if not silent:
            return False
        if self.begun is None:
            if self._session.absent and not (connected and talks):
                self._notices.once("absent", self._session.absent)
            return False
        if self._told or not talks:
            return False
        self._told = True
        self._notices.say("silent", f"the autopilot is silent for {now - self._heard:.0f} s")
        return True
