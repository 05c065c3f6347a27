"""Parameters that an ArduPilot boat is asked for: those that tell how its telemetry came about.

Reading changes nothing aboard. One name at a time and slowly, behind the requests for rates; what
is not answered is asked once more, and then left. Pure: time comes from outside.
"""

from dataclasses import dataclass, replace
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

GAP_NS = 200_000_000  # between two requests: answers share a radio with telemetry
ROUNDS = 2
SERVOS = 16
WANTED = (
    "INS_GYRO_FILTER",  # the delay of reported yaw rates
    "GPS_DELAY_MS",
    "GPS1_DELAY_MS",  # the same since 4.6
    *(
        f"SERVO{n}_{what}"
        for what in ("FUNCTION", "TRIM", "MIN", "MAX", "REVERSED")
        for n in range(1, SERVOS + 1)
    ),
)


@dataclass(frozen=True)
class ParameterRequests:
    """The requests to one boat. Times [ns] are those of any clock that only goes forward."""

    system: int
    component: int
    pending: tuple[str, ...] = ROUNDS * WANTED  # to be sent, the next one first
    due_ns: int = 0

    @property
    def next_ns(self) -> int | None:
        """When the next request is due; None: never."""
        return self.due_ns if self.pending else None

    def due(self, now_ns: int) -> tuple["ParameterRequests", tuple[Any, ...]]:
        """The state after now, and the request to send, if any."""
        if not self.pending or now_ns < self.due_ns:
            return self, ()
        first, *others = self.pending
        after = replace(self, pending=tuple(others), due_ns=now_ns + GAP_NS)
        request = dialect.MAVLink_param_request_read_message(
            self.system, self.component, first.encode(), -1
        )
        return after, (request,)

    def answered(self, name: str) -> "ParameterRequests":
        """PARAM_VALUE came, whoever asked for it."""
        return replace(self, pending=tuple(other for other in self.pending if other != name))
