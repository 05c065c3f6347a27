"""Connection strings: every form that exists, and one line for what does not."""

import pytest

from gateway.errors import BadInput
from gateway.links.endpoint import BAUD, Endpoint, Kind, parse_endpoint


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("udpin:0.0.0.0:14550", (Kind.UDP_IN, "0.0.0.0", 14550, 0)),
        ("udp:127.0.0.1:14550", (Kind.UDP_IN, "127.0.0.1", 14550, 0)),
        ("udpout:boat.local:14551", (Kind.UDP_OUT, "boat.local", 14551, 0)),
        ("udpin:[::1]:14550", (Kind.UDP_IN, "::1", 14550, 0)),
        ("tcp:10.0.0.2:5760", (Kind.TCP_CLIENT, "10.0.0.2", 5760, 0)),
        ("tcpin:127.0.0.1:5770", (Kind.TCP_SERVER, "127.0.0.1", 5770, 0)),
        ("/dev/ttyUSB0", (Kind.SERIAL, "/dev/ttyUSB0", 0, BAUD)),
        ("/dev/ttyUSB0,57600", (Kind.SERIAL, "/dev/ttyUSB0", 0, 57600)),
        ("serial:/dev/ttyACM0:921600", (Kind.SERIAL, "/dev/ttyACM0", 0, 921600)),
        ("serial:/dev/ttyACM0,9600", (Kind.SERIAL, "/dev/ttyACM0", 0, 9600)),
        ("serial:/dev/ttyACM0", (Kind.SERIAL, "/dev/ttyACM0", 0, BAUD)),
    ],
)
def test_every_form(text, expected):
    kind, host, port, baud = expected
    assert parse_endpoint(text) == Endpoint(text, kind, host, port, baud)


@pytest.mark.parametrize(
    "text",
    ["", "14550", "udpin", "udpin:", "udpin:14550", "udpin:host:", "udpin:host:0", "udpin:host:x",
     "udpin:host:65536", "udpin:host:-1", "udpin:host:１４", "mcast:14550", "serial:",
     "serial:COM3", "COM3", "/dev/ttyUSB0,fast", "tcp::5760", "UDPIN:host:1"],
)  # fmt: skip
def test_a_wrong_one_says_which_forms_exist(text):
    with pytest.raises(BadInput) as caught:
        parse_endpoint(text)
    line = str(caught.value)
    assert f'"{text}"' in line
    assert "udpin:HOST:PORT" in line
    assert "/dev/NAME" in line
    assert "\n" not in line
