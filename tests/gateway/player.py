"""A Foxglove client: subscribes to whatever is advertised and keeps what comes."""

import asyncio
import json
import re
import struct
import threading
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from tornado.websocket import WebSocketClientConnection, websocket_connect

from tests.gateway.pipelines.running import wait

PROTOCOL = "foxglove.sdk.v1"
# The SDK (0.30) advertises a channel a moment before it knows it: who subscribes faster is refused
# with these words, and asks again.
UNKNOWN = re.compile(r"Unknown channel ID: (\d+)")
DATA = struct.Struct("<BIQ")  # 1, number of the subscription, log time [ns]; the message follows


@dataclass
class Player:
    """What a server told so far, by topic."""

    info: dict[str, Any] = field(default_factory=dict)
    channels: dict[str, dict[str, Any]] = field(default_factory=dict)
    messages: dict[str, list[tuple[int, bytes]]] = field(default_factory=lambda: defaultdict(list))
    _topics: dict[int, str] = field(default_factory=dict)

    def take(self, said: str | bytes, connection: WebSocketClientConnection) -> None:
        if isinstance(said, bytes):
            kind, number, time_ns = DATA.unpack_from(said)
            assert kind == 1
            self.messages[self._topics[number]].append((time_ns, said[DATA.size :]))
            return
        message = json.loads(said)
        if message["op"] == "serverInfo":
            self.info = message
        elif message["op"] == "advertise":
            self._subscribe(message["channels"], connection)
        elif message["op"] == "status" and (unknown := UNKNOWN.match(message["message"])):
            number = int(unknown[1])
            assert number in self._topics
            self._ask([number], connection)

    def _subscribe(
        self, channels: list[dict[str, Any]], connection: WebSocketClientConnection
    ) -> None:
        self.channels |= {channel["topic"]: channel for channel in channels}
        self._topics |= {channel["id"]: channel["topic"] for channel in channels}
        self._ask([channel["id"] for channel in channels], connection)

    def _ask(self, numbers: list[int], connection: WebSocketClientConnection) -> None:
        wanted = [{"id": number, "channelId": number} for number in numbers]
        connection.write_message(json.dumps({"op": "subscribe", "subscriptions": wanted}))


@contextmanager
def player(port: int) -> Iterator[Player]:
    """Connected while inside."""
    heard, loop = Player(), asyncio.new_event_loop()
    connection: list[WebSocketClientConnection] = []

    async def listen() -> None:
        connection.append(
            await websocket_connect(f"ws://127.0.0.1:{port}", subprotocols=[PROTOCOL])
        )
        while (said := await connection[0].read_message()) is not None:
            heard.take(said, connection[0])
        connection[0].close()  # also where the server has gone first

    thread = threading.Thread(target=loop.run_until_complete, args=(listen(),))
    thread.start()
    try:
        wait(lambda: heard.info)
        yield heard
    finally:
        loop.call_soon_threadsafe(connection[0].close)
        thread.join()
        loop.close()


HANGING = f"""
import asyncio, json, os, signal, sys
from tornado.websocket import websocket_connect

async def hang():
    c = await websocket_connect("ws://127.0.0.1:" + sys.argv[1], subprotocols=["{PROTOCOL}"])
    wanted = []
    while len(wanted) < 10:
        said = json.loads(await c.read_message())
        wanted += [{{"id": x["id"], "channelId": x["id"]}} for x in said.get("channels", [])]
    await c.write_message(json.dumps({{"op": "subscribe", "subscriptions": wanted}}))
    await c.read_message()
    os.kill(os.getpid(), signal.SIGSTOP)

asyncio.run(hang())
"""
