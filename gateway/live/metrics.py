"""Prometheus metrics of a live gateway: what the health topic says, and its links' counts.

    shadow_health_<field>{vessel}     every number of the newest health message
    shadow_health_age_seconds{vessel} how old that message is
    shadow_unfit{vessel}              1 where the boat's data cannot judge its model
    shadow_link_<count>_total{link}   datagrams, bytes, frames, … of a link since the start
    shadow_faults_total               defects of the gateway

The loop only hands over the newest payload; the HTTP server of prometheus_client runs on threads of
its own and decodes when it is asked.
"""

import time
from collections.abc import Callable, Iterator, Mapping
from threading import Thread
from typing import Any, Self

import orjson

from gateway.errors import BadInput, ShadowError
from gateway.recording.foxglove_server import on_this_machine, parse_address
from gateway.topics import TIMES, TOPICS, FieldType

HEALTH = [f for f in TOPICS["health"].fields if f.type is not FieldType.STRING]
assert not {f.name for f in HEALTH} & {f.name for f in TIMES}

Counts = Callable[[], Mapping[str, Mapping[str, Any]]]  # link -> count -> value


class Metrics:
    """A server of metrics at [HOST:]PORT while it is open; `health` gives it something to say."""

    def __init__(self, address: str, links: Counts, faults: Callable[[], int]) -> None:
        self.host, self._port = parse_address(address, "metrics")
        self._address, self._links, self._faults = address, links, faults
        self._newest: dict[str, tuple[bytes, float]] = {}
        self._server: Any = None
        self._thread: Thread | None = None

    def __enter__(self) -> Self:
        try:
            import prometheus_client
        except ImportError:
            raise BadInput(
                "--metrics needs prometheus_client: pip install 'shadow-gateway[metrics]'"
            ) from None
        registry = prometheus_client.CollectorRegistry()
        registry.register(self)  # type: ignore[arg-type]
        try:
            self._server, self._thread = prometheus_client.start_http_server(
                self._port, self.host, registry
            )
        except OSError as error:
            raise ShadowError(
                f"--metrics {self._address}: cannot listen there: {error.strerror}: is another "
                "program using the port?"
            ) from None
        return self

    def __exit__(self, *_: object) -> None:
        if self._server is not None and self._thread is not None:
            self._server.shutdown()
            self._server.server_close()
            self._thread.join()

    @property
    def port(self) -> int:
        """Where it listens, also where any free port was asked for."""
        return int(self._server.server_address[1])

    @property
    def text(self) -> str:
        """Where it is, and who reaches it."""
        who = "this machine" if on_this_machine(self.host) else "everyone who reaches this machine"
        return f"metrics on http://{self.host}:{self.port}/metrics, for {who}"

    def health(self, vessel: str, payload: bytes) -> None:
        """The newest health message of a boat."""
        self._newest[vessel] = payload, time.monotonic()

    def describe(self) -> list[Any]:
        """Nothing in advance: names follow from what there is."""
        return []

    def collect(self) -> Iterator[Any]:
        """All metrics as they are now."""
        from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily

        rows = {
            vessel: (orjson.loads(payload), time.monotonic() - at)
            for vessel, (payload, at) in list(self._newest.items())
        }
        for field in HEALTH:
            name = f"shadow_health_{field.name}"
            gauge = GaugeMetricFamily(name, field.description, labels=["vessel"])
            for vessel, (row, _) in rows.items():
                gauge.add_metric([vessel], float(row[field.name]))
            yield gauge
        age = GaugeMetricFamily("shadow_health_age_seconds", "Age of that", labels=["vessel"])
        unfit = GaugeMetricFamily(
            "shadow_unfit", "1 where the boat's data cannot judge its model", labels=["vessel"]
        )
        for vessel, (row, seconds) in rows.items():
            age.add_metric([vessel], seconds)
            unfit.add_metric([vessel], float(bool(row["unfit"])))
        yield age
        yield unfit
        links = self._links()
        for count in sorted({count for counts in links.values() for count in counts}):
            counter = CounterMetricFamily(
                f"shadow_link_{count}", f"{count} of a link", labels=["link"]
            )
            for link, counts in links.items():
                counter.add_metric([link], float(counts[count]))
            yield counter
        yield CounterMetricFamily("shadow_faults", "Defects of the gateway", value=self._faults())
