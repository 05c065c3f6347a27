"""A session that only watches: a client of whoever listens there, or what a file describes."""

from pathlib import Path

import orjson
import zenoh

from gateway.bus import BusSettings, open_session
from gateway.errors import BadInput


def join(endpoint: str, config_file: Path | None) -> zenoh.Session | None:
    """Join the gateway or router at `endpoint`; None while nobody answers there."""
    if config_file is not None:
        return open_session(BusSettings(config_file=config_file))
    config = _client(endpoint)
    try:
        return zenoh.open(config)
    except zenoh.ZError:
        return None


def _client(endpoint: str) -> zenoh.Config:
    """It listens nowhere and looks for nobody else; zenoh itself joins again when a link broke."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    try:
        config.insert_json5("connect/endpoints", orjson.dumps([endpoint]).decode())
    except zenoh.ZError:
        raise BadInput(f"--connect {endpoint}: expected tcp/HOST:PORT or tls/HOST:PORT") from None
    return config
