"""A telemetry log as the BlueOS recorder would have written it, by its public source.

mavlink-server (`src/lib/drivers/zenoh/json.rs`) publishes each message three ways: on
`mavlink/out`, on `mavlink/<system>/<component>/<MESSAGE>`, and its fields below that. The recorder
(`src/service.rs`, `src/channel_descriptor.rs`) keeps those that are JSON objects, with a schema
drawn from the first of each, once the vehicle is armed; both clocks are those of the recorder.
"""

import json
import math
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.ingest.mavlink.log import MavlinkLog

ARMED = 128


def write_blueos(path: Path, log: MavlinkLog, flags: str = "names", cut: bool = False) -> Path:
    """The messages of a log as JSON; `flags` as newer ("names") or older ("bits") versions do."""
    channels: dict[str, int] = {}
    decoder = dialect.MAVLink(None)
    decoder.robust_parsing = True
    armed = False
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD, chunk_size=50_000)
        writer.start()
        for k in range(len(log.frames)):
            message = decoder.parse_char(log.frames.raw(k))
            armed |= message.get_type() == "HEARTBEAT" and bool(message.base_mode & ARMED)
            if not armed:
                continue
            time_ns = int(log.frames.receive_time_ns[k])
            for topic, content in _published(message, flags):
                data = json.dumps(content).encode()  # NaN stands as it is, as in JSON5
                if topic not in channels:
                    schema = json.dumps(_schema(content)).encode()
                    number = writer.register_schema(topic.replace("/", "."), "jsonschema", schema)
                    channels[topic] = writer.register_channel(topic, "json", number)
                writer.add_message(channels[topic], time_ns, data, time_ns)
        if not cut:
            writer.finish()
        else:
            writer.flush()
    return path


def _published(message: Any, flags: str) -> list[tuple[str, Any]]:
    """Topic and JSON object of everything that one message becomes."""
    fields = {
        "mavtype" if name == "type" else name: _value(message, name, flags)
        for name in message.fieldnames
    }
    header = {
        "system_id": message.get_srcSystem(),
        "component_id": message.get_srcComponent(),
        "sequence": message.get_seq(),
        "message_id": message.get_msgId(),
    }
    whole = {"header": header, "message": {"type": message.get_type(), **fields}}
    topic = f"mavlink/{header['system_id']}/{header['component_id']}/{message.get_type()}"
    below = [(f"{topic}/{name}", v) for name, v in fields.items() if isinstance(v, dict)]
    return [("mavlink/out", whole), (topic, whole), *below]


def _value(message: Any, name: str, flags: str) -> Any:
    kind = type(message)
    value, enum = getattr(message, name), kind.fieldenums_by_name.get(name)
    type_name = kind.fieldtypes[kind.fieldnames.index(name)]
    if type_name == "char":
        length = kind.array_lengths[kind.ordered_fieldnames.index(name)]
        return value if flags == "names" else list(value.ljust(length, "\0"))
    if enum is None or not isinstance(value, int):
        return value
    names = {number: entry.name for number, entry in dialect.enums[enum].items()}
    if "MODE_FLAG" in enum or "FLAGS" in enum or "SENSOR" in enum:
        if flags == "bits":
            return {"bits": value}
        bits = [1 << k for k in range(32) if value >> k & 1]
        return " | ".join(names.get(bit, hex(bit)) for bit in bits)
    return {"type": names[value]} if value in names else value


def _schema(value: Any) -> dict[str, Any]:
    if isinstance(value, dict):
        return {"type": "object", "properties": {k: _schema(v) for k, v in value.items()}}
    if isinstance(value, list):
        return {"type": "array", "items": _schema(value[0]) if value else {}}
    if isinstance(value, str):
        return {"type": "string"}
    return {"type": "number" if isinstance(value, float) and not math.isinf(value) else "integer"}
