"""The one table of topics: bus, recorder, page and docs derive from it.

A message is one flat JSON object. It is withheld until it can be complete: no null, no NaN, ever.

`python -m gateway.topics` prints the table as docs/topics.md holds it; with a folder as argument it
writes the JSON Schema of each topic there, as docs/schemas holds them.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import orjson


class FieldType(Enum):
    """Type of a field, as JSON Schema names it."""

    NUMBER = "number"
    INTEGER = "integer"
    STRING = "string"


class Overflow(Enum):
    """What happens to a message that a slow subscriber cannot take."""

    DROP = "drop"


@dataclass(frozen=True)
class Field:
    """One member of a message; `choices` lists the only values a string may have."""

    name: str
    unit: str
    description: str
    type: FieldType = FieldType.NUMBER
    choices: tuple[str, ...] = ()

    def json_schema(self) -> dict[str, object]:
        """The field as a JSON Schema."""
        unit = f" [{self.unit}]" if self.unit else ""
        text = f"{self.description}{unit}"
        schema: dict[str, object] = {"type": self.type.value, "description": text}
        if self.choices:
            schema["enum"] = list(self.choices)
        return schema


TIMES = (
    Field("vehicle_time_ns", "ns", "Unix time on the boat's clock", FieldType.INTEGER),
    Field(
        "receive_time_ns",
        "ns",
        "Unix time at which the datagram that caused this was received",
        FieldType.INTEGER,
    ),
)


@dataclass(frozen=True)
class Topic:
    """One kind of message: numbers first, integers next, strings last; the two times lead."""

    name: str
    schema: str
    description: str
    rate: str
    fields: tuple[Field, ...]
    derived: bool = False  # frames and vessel give its rows again: recordings hold some of them
    overflow: Overflow = Overflow.DROP

    def __post_init__(self) -> None:
        order = [list(FieldType).index(field.type) for field in self.fields]
        if order != sorted(order):
            raise ValueError(f"topic {self.name}: fields must be numbers, integers, then strings")

    @property
    def all_fields(self) -> tuple[Field, ...]:
        """The fields of a message in their order, the two times included."""
        return TIMES + self.fields

    @property
    def encoding(self) -> str:
        """The zenoh encoding of every put."""
        return f"application/json;{self.schema}"

    def names(self, type_: FieldType) -> tuple[str, ...]:
        """Names of the fields of one type, the two times left out."""
        return tuple(field.name for field in self.fields if field.type is type_)

    def json_schema(self) -> dict[str, object]:
        """The message as a JSON Schema: all members required, none beside them."""
        return {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": self.schema,
            "description": self.description,
            "type": "object",
            "properties": {field.name: field.json_schema() for field in self.all_fields},
            "required": [field.name for field in self.all_fields],
            "additionalProperties": False,
        }


MOTION = (
    ("surge_mps", "m/s", "velocity over ground towards the bow"),
    ("sway_mps", "m/s", "velocity over ground towards starboard"),
    ("yaw_rate_radps", "rad/s", "turn rate, clockwise from above"),
    ("surge_mps2", "m/s²", "time derivative of surge_mps"),
    ("sway_mps2", "m/s²", "time derivative of sway_mps"),
    ("yaw_radps2", "rad/s²", "time derivative of yaw_rate_radps"),
    ("north_m", "m", "position north of the local origin"),
    ("east_m", "m", "position east of the local origin"),
    ("yaw_rad", "rad", "heading, clockwise from true north"),
)
FORCE = (
    ("surge_n", "N", "force towards the bow"),
    ("sway_n", "N", "force towards starboard"),
    ("yaw_nm", "N m", "moment, clockwise from above"),
)
SOURCES = ("measured", "model")
SEVERITIES = ("debug", "info", "warning", "error")
HORIZONS_S = (1, 5, 10)
# kinds of events that say whether the model is right, as `sim.monitoring` names them
MODEL_RIGHT = "model_right"
JUDGING = frozenset(("model_wrong", "model_explained", MODEL_RIGHT))

# What `rate_…_hz` of `health` counts: every message that can tell that part of the motion.
RATED = {
    "attitude": ("ATTITUDE", "ATTITUDE_QUATERNION", "ATT"),
    "local_position": ("LOCAL_POSITION_NED", "ODOMETRY", "XKF1"),
    "global_position": ("GLOBAL_POSITION_INT",),
    "gps": ("GPS_RAW_INT", "GPS"),
    "vfr_hud": ("VFR_HUD",),
    "imu": ("RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3", "HIGHRES_IMU", "IMU"),
    "actuators": ("SERVO_OUTPUT_RAW", "ACTUATOR_OUTPUT_STATUS", "RCOU"),
    "battery": ("SYS_STATUS", "BATTERY_STATUS", "BAT"),
    "wind": ("WIND",),
    "heartbeat": ("HEARTBEAT",),
}


def _motion() -> tuple[Field, ...]:
    values = [Field(*row) for row in MOTION]
    stds = [Field(f"{name}_std", unit, f"standard deviation of {name}") for name, unit, _ in MOTION]
    text = "measured while telemetry is fresh, model while the vessel's model stands in"
    return (*values, *stds, Field("source", "", text, FieldType.STRING, SOURCES))


def _position() -> tuple[Field, ...]:
    return tuple(
        Field(f"{body}_{name}", unit, f"{text} of the {body}")
        for body in ("boat", "shadow")
        for name, unit, text in (
            ("latitude_deg", "°", "WGS 84 latitude"),
            ("longitude_deg", "°", "WGS 84 longitude"),
            ("yaw_rad", "rad", "heading, clockwise from true north,"),
        )
    )


def _control() -> tuple[Field, ...]:
    control = (Field(n, unit, f"{text} that the follower asks for") for n, unit, text in FORCE)
    command = (
        Field(f"command_{name}", unit, f"{text} of the boat's commanded actuators")
        for name, unit, text in FORCE
    )
    return (*control, *command)


def _residual() -> tuple[Field, ...]:
    force = [
        Field(f"missing_{name}", unit, f"missing {text}: what the vessel's model lacks")
        for name, unit, text in FORCE
    ]
    stds = [Field(f"{f.name}_std", f.unit, f"standard deviation of {f.name}") for f in force]
    errors = [
        Field(f"error_{name}_{horizon}s", unit, f"{name}, measured − predicted {horizon} s ago")
        for horizon in HORIZONS_S
        for name, unit, _ in MOTION[:3]
    ]
    return (*force, *stds, *errors)


def _pairs(*rows: tuple[str, str, str]) -> tuple[Field, ...]:
    """Values north and east, then their standard deviations."""
    values = [
        Field(f"{what}_{axis}_{unit}", _UNITS[unit], f"{text}, {axis}")
        for what, unit, text in rows
        for axis in ("north", "east")
    ]
    stds = [Field(f"{v.name}_std", v.unit, f"standard deviation of {v.name}") for v in values]
    return (*values, *stds)


_UNITS = {"mps": "m/s", "n": "N"}
EXPLANATIONS = ("none", "current", "wind", "current or wind", "thrust", "compass", "drag",
                "several", "none of these")  # fmt: skip


def _surroundings() -> tuple[Field, ...]:
    outside = _pairs(
        ("current", "mps", "velocity of the water, if the water is what is missing"),
        ("force", "n", "force of the air on the boat as it lies, if that is what is missing"),
    )
    misfit = "squared prediction errors over what noise explains, running mean; about 1 or less"
    text = "what explains that the model is wrong, as far as headings and speeds so far tell"
    explains = Field("explains", "", text, FieldType.STRING, EXPLANATIONS)
    return (*outside, Field("misfit", "", f"{misfit}: the model is right"), explains)


WIND = _pairs(("wind", "mps", "velocity of the air, if the air is what is missing"))
PARAMETERS = (
    Field("value", "", "the number as a multiple of the vessel file's; 1: as written there"),
    Field("value_std", "", "standard deviation of value"),
    Field("low", "", "lower end of the 95 % interval of value"),
    Field("high", "", "upper end of the 95 % interval of value"),
    Field("applied", "", "the multiple that the shadow uses; 1 unless --adapt apply"),
    Field("excited_s", "s", "time for which the boat's motion has told this number"),
    Field("name", "", "`thrust NAME`, `drag` or `turning damping`", FieldType.STRING),
    Field("excited", "", "whether the last minute tells it: else it is held", FieldType.STRING,
          ("yes", "no")),
    Field("valid", "", "whether it is known well enough to be used", FieldType.STRING,
          ("yes", "no")),
)  # fmt: skip


def _health() -> tuple[Field, ...]:
    rates = [
        Field(f"rate_{name}_hz", "1/s", f"messages received: {', '.join(messages)}")
        for name, messages in RATED.items()
    ]
    numbers = (
        Field("link_age_s", "s", "time since the last frame of this boat"),
        Field("rate_hz", "1/s", "messages of this boat received, all kinds"),
        *rates,
        Field("loss", "", "share of frames lost on the link, 0 to 1, from sequence numbers"),
        Field("clock_offset_s", "s", "receipt minus boat time, lower envelope"),
        Field("nis", "", "innovations squared over their expected value; 1 = noise is honest"),
        Field("loop_lateness_s", "s", "worst delay from receipt to published estimate"),
        Field("unfit_s", "s", "time since the boat's data could last judge the model; 0: they can"),
    )
    counts = (
        ("late", "measurements since start that came too late to be used"),
        ("gated", "measurements since start refused as outliers"),
        ("divergences", "times since start that the shadow left what a boat can do and began anew"),
        ("diverging", "1 where it did so within the last minute, else 0"),
        ("recorder_backlog", "messages now waiting to be recorded"),
        ("recorder_drops", "messages since start that were not recorded"),
    )
    text = "what makes the data unfit and since when; empty: they are fit"
    unfit = Field("unfit", "", text, FieldType.STRING)
    return (*numbers, *(Field(n, "", text, FieldType.INTEGER) for n, text in counts), unfit)


EVENT = (
    Field("kind", "", "what happened, one word for programs", FieldType.STRING),
    Field("severity", "", "how bad it is", FieldType.STRING, SEVERITIES),
    Field("says", "", "what happened, a sentence for people", FieldType.STRING),
)

EACH = "each estimate"
_ALL = (
    Topic("measured", "shadow.Motion", "How the real boat moves", EACH, _motion(), derived=True),
    Topic("reference", "shadow.Motion", "What the shadow follows", EACH, _motion(), derived=True),
    Topic("shadow", "shadow.Motion", "How the shadow moves", EACH, _motion(), derived=True),
    Topic("position", "shadow.Position", "Where boat and shadow are on Earth",
          f"{EACH}, once an origin is known", _position(), derived=True),
    Topic("control", "shadow.Control", "The forces on shadow and boat", EACH, _control(),
          derived=True),
    Topic("residual", "shadow.Residual",
          "What the vessel's model lacks, and how far its latest predictions were off",
          f"{EACH}, once a prediction over the longest horizon has come due", _residual(),
          derived=True),
    Topic("surroundings", "shadow.Surroundings",
          "Current and wind-like force, estimated from what the vessel's model lacks",
          "1 Hz, once half a minute was seen", _surroundings()),
    Topic("wind", "shadow.Wind", "The wind-like force as a wind; from vessels with wind areas only",
          "1 Hz, once half a minute was seen", WIND),
    Topic("parameters", "shadow.Parameter",
          "A number of the vessel, followed while sailing; one message for each; with --adapt only",
          "1 Hz, while the data are fit to judge by", PARAMETERS),
    Topic("health", "shadow.Health", "How well link, filter and gateway are", "1 Hz", _health()),
    Topic("event", "shadow.Event", "What happened, in words", "as it happens", EVENT),
)  # fmt: skip
TOPICS: Mapping[str, Topic] = {topic.name: topic for topic in _ALL}

# Recorded by `shadow hil` as NAME/<vessel>, the truth published too; no inference reads them.
TRUTH = (
    *MOTION,
    ("down_m", "m", "position of the body origin below calm water"),
    ("roll_rad", "rad", "roll, starboard down"),
    ("pitch_rad", "rad", "pitch, bow up"),
    ("heave_mps", "m/s", "velocity down"),
    ("roll_rate_radps", "rad/s", "time derivative of roll_rad"),
    ("pitch_rate_radps", "rad/s", "time derivative of pitch_rad"),
    ("current_north_mps", "m/s", "velocity of the water, north"),
    ("current_east_mps", "m/s", "velocity of the water, east"),
    ("wind_north_mps", "m/s", "velocity of the air, north; 0 without wind"),
    ("wind_east_mps", "m/s", "velocity of the air, east"),
    ("elevation_m", "m", "height of the water at the boat"),
    *((name, unit, f"{text} of the commanded actuators") for name, unit, text in FORCE),
    *((f"wave_{name}", unit, f"{text} of the waves") for name, unit, text in FORCE),
    ("voltage_v", "V", "voltage of the battery"),
)
OUTPUTS = 32
_LOOP = (
    Topic(
        "truth",
        "shadow.Truth",
        "How the boat in the loop really moves, and what acts on it",
        "50 Hz",
        tuple(Field(*row) for row in TRUTH),
    ),
    Topic(
        "outputs",
        "shadow.Outputs",
        "Pulses that the autopilot in the loop gave; 0: none",
        "50 Hz",
        tuple(Field(f"output_{n}_us", "µs", f"pulse of output {n}") for n in range(1, OUTPUTS + 1)),
    ),
)
LOOP_TOPICS: Mapping[str, Topic] = {topic.name: topic for topic in _LOOP}
WATCHED: Mapping[str, Topic] = {**TOPICS, "truth": LOOP_TOPICS["truth"]}  # under shadow/<vessel>/


def topic_of(channel: str) -> Topic:
    """The topic of a channel of a recording: `shadow`, or `truth/<vessel>`."""
    name = channel.partition("/")[0]
    return TOPICS[name] if name in TOPICS else LOOP_TOPICS[name]


def _markdown(topic: Topic) -> list[str]:
    lines = [
        f"## `{topic.name}`",
        "",
        f"{topic.description}. Schema `{topic.schema}`, encoding `{topic.encoding}`.",
        f"Rate: {topic.rate}. {'Recorded thinned' if topic.derived else 'Recorded'}; "
        f"a subscriber that is too slow: {topic.overflow.value}.",
        "",
        "| field | type | unit | meaning |",
        "|---|---|---|---|",
    ]
    for field in topic.all_fields:
        values = " / ".join(f"`{choice}`" for choice in field.choices) or field.type.value
        lines.append(f"| `{field.name}` | {values} | {field.unit} | {field.description} |")
    return [*lines, ""]


def markdown() -> str:
    """The table for people: docs/topics.md."""
    head = [
        "# Topics",
        "",
        "Made by `python -m gateway.topics > docs/topics.md`; do not edit.",
        "",
        "On zenoh each topic is the key `shadow/<vessel>/<topic>`, in a recording the channel "
        "`<topic>`.",
        "Every payload is one JSON object with all of its fields: a message is withheld until it "
        "is complete.",
        "",
    ]
    loop = [
        "# Topics of the loop",
        "",
        "In recordings of `shadow hil` alone, as the channels `truth/<vessel>` and "
        "`outputs/<vessel>`. `truth` is also published, `shadow/<vessel>/truth` at 10 Hz.",
        "No estimator, identification or diagnosis reads them: a test holds that.",
        "",
    ]
    live, closed = ([line for topic in table.values() for line in _markdown(topic)]
                    for table in (TOPICS, LOOP_TOPICS))  # fmt: skip
    return "\n".join([*head, *live, *loop, *closed])


def schema_files() -> Mapping[str, bytes]:
    """File name -> JSON Schema text."""
    options = orjson.OPT_INDENT_2 | orjson.OPT_APPEND_NEWLINE
    return {
        f"{name}.json": orjson.dumps(topic.json_schema(), option=options)
        for name, topic in {**TOPICS, **LOOP_TOPICS}.items()
    }


def write_schemas(folder: Path) -> None:
    """Write all files, and remove those of topics that are no more."""
    files = schema_files()
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.json"):
        if old.name not in files:
            old.unlink()
    for name, text in files.items():
        (folder / name).write_bytes(text)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        write_schemas(Path(sys.argv[1]))
    else:
        print(markdown(), end="")
