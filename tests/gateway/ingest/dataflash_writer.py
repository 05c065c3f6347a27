"""A voyage as the DataFlash log of another year: formats as ArduPilot's LogStructure.h had them.

`FORMATS` gives for each year the messages that the gateway reads, with their format characters and
columns: 2014 with milliseconds, a GPS without clock and `Ch1`; 2015 with microseconds and `Ch1`;
2025 (4.7-dev) with units of its own and instances.
"""

import struct
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.model import Model
from sim.vessel import Vessel
from tests.sim.vessels import WAMV

KINDS = {  # format character -> of struct, factor to whole numbers
    "b": ("b", 1), "B": ("B", 1), "h": ("h", 1), "H": ("H", 1), "i": ("i", 1), "I": ("I", 1),
    "q": ("q", 1), "Q": ("Q", 1), "f": ("f", None), "d": ("d", None), "n": ("4s", None),
    "N": ("16s", None), "Z": ("64s", None), "c": ("h", 100), "C": ("H", 100), "e": ("i", 100),
    "E": ("I", 100), "L": ("i", 1e7), "M": ("B", 1),
}  # fmt: skip
CH12 = ",".join(f"Ch{n}" for n in range(1, 13))
C14 = ",".join(f"C{n}" for n in range(1, 15))
FORMATS: Mapping[int, Mapping[str, tuple[str, str]]] = {
    2014: {
        "PARM": ("Nf", "Name,Value"),
        "GPS": (
            "BIHBcLLeeEefI",
            "Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs,VZ,T",
        ),
        "IMU": ("IffffffII", "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,ErrG,ErrA"),
        "MSG": ("Z", "Message"),
        "RCIN": ("I" + 14 * "h", "TimeMS," + C14),
        "RCOU": ("I" + 12 * "h", "TimeMS," + CH12),
        "ATT": ("IccccCC", "TimeMS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"),
        "EKF1": ("IccCffffffccc", "TimeMS,Roll,Pitch,Yaw,VN,VE,VD,PN,PE,PD,GX,GY,GZ"),
        "CURR": ("IhIhhhf", "TimeMS,Thr,ThrInt,Volt,Curr,Vcc,CurrTot"),
    },
    2015: {
        "PARM": ("QNf", "TimeUS,Name,Value"),
        "GPS": (
            "QBIHBcLLeeEefB",
            "TimeUS,Status,GMS,GWk,NSats,HDop,Lat,Lng,RAlt,Alt,Spd,GCrs,VZ,U",
        ),
        "IMU": ("QffffffIIfBB",
                "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,ErrG,ErrA,Temp,GyHlt,AcHlt"),
        "MSG": ("QZ", "TimeUS,Message"),
        "EV": ("QB", "TimeUS,Id"),
        "RCIN": ("Q" + 14 * "h", "TimeUS," + C14),
        "RCOU": ("Q" + 12 * "h", "TimeUS," + CH12),
        "ATT": ("QccccCCCC", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw"),
        "EKF1": ("QccCffffffccc", "TimeUS,Roll,Pitch,Yaw,VN,VE,VD,PN,PE,PD,GX,GY,GZ"),
        "CURR": ("QhhhHfh", "TimeUS,Throttle,Volt,Curr,Vcc,CurrTot,Volt2"),
    },
    2025: {
        "PARM": ("QNff", "TimeUS,Name,Value,Default"),
        "GPS": (
            "QBBIHBcLLeffffB",
            "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U",
        ),
        "IMU": ("QBffffffIIfBBHH",
                "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"),
        "MSG": ("QZ", "TimeUS,Message"),
        "ARM": ("QBIBB", "TimeUS,ArmState,ArmChecks,Forced,Method"),
        "RCIN": ("Q" + 14 * "H", "TimeUS," + C14),
        "RCOU": ("Q" + 14 * "H", "TimeUS," + C14),
        "ATT": ("QffffffB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,AEKF"),
        "XKF1": (
            "QBccCfffffffccce",
            "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH",
        ),
        "BAT": ("QBfffffcf", "TimeUS,Inst,Volt,VoltR,Curr,CurrTot,EnrgTot,Temp,Res"),
    },
}  # fmt: skip
XKF4 = ("QBcccccfffHBIHb", "TimeUS,C,SV,SP,SH,SM,SVT,errRP,OFN,OFE,FS,TS,SS,GPS,PI")
BANNERS = {2014: "APM:Rover v2.46beta2", 2015: "APM:Rover v2.51-rc1 (93cd7f2a)",
           2025: "ArduRover V4.7.0-dev (b1c2d3e4)"}  # fmt: skip
LAT, LON, WEEK, WEEK_MS = 63.447, 10.4, 1850, 200_000_000
SERVO = {2014: "RC", 2015: "RC", 2025: "SERVO"}


def voyage_log(
    year: int,
    seconds: float = 40.0,
    *,
    without: Collection[str] = (),
    vessel: Vessel = WAMV,
    fix: bool = True,
    second_fix: bool = False,
    lanes: "Lanes | None" = None,
) -> bytes:
    """The log of a voyage in the formats of that year; some messages may be left out of it."""
    known = {name: form for name, form in FORMATS[year].items() if name not in without}
    known |= {"XKF4": XKF4} if lanes else {}
    numbers = {name: 129 + k for k, name in enumerate(known)}
    out = [_fmt(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")]
    out += [_fmt(numbers[name], name, *form) for name, form in known.items()]

    def write(name: str, t: float, **fields: Any) -> None:
        if name in known:
            fields |= {"TimeUS": round(t * 1e6), "TimeMS": round(t * 1e3), "T": round(t * 1e3),
                       "GMS": round(WEEK_MS + t * 1e3)}  # fmt: skip
            if name == "GPS":
                fields["TimeMS"] = fields["GMS"]
            out.append(_message(numbers[name], *known[name], fields))

    write("MSG", 100.0, Message=BANNERS[year])
    for k, value in enumerate((1100.0, 1500.0, 1900.0)):
        for channel in (1, 2):
            write("PARM", 100.0, Name=f"{SERVO[year]}{channel}_{('MIN', 'TRIM', 'MAX')[k]}",
                  Value=value)  # fmt: skip
    write("ARM", 100.0, ArmState=1)
    write("EV", 100.0, Id=10)
    for t, row, pulses in _moving(seconds, vessel):
        _moment(write, 100.0 + t, row, pulses, fix, round(t * 20) % 4 == 0, lanes is None)
        if second_fix:
            write("GPS", 100.0 + t, I=1, Status=3)
        if lanes:
            _two_lanes(write, t, row, lanes)
    return b"".join(out)


@dataclass(frozen=True)
class Lanes:
    """Two lanes of EKF3: the first goes wrong for a while [s], and says so.

    left  whether the boat goes on with the second one then
    """

    ill: tuple[float, float]
    left: bool = True


def _two_lanes(write: Any, t: float, row: Any, lanes: Lanes) -> None:
    """Motion by both lanes, and what they say of themselves."""
    ill = lanes.ill[0] <= t < lanes.ill[1]
    north, east, yaw, u, v, _ = (float(value) for value in row)
    vn, ve = u * np.cos(yaw) - v * np.sin(yaw), u * np.sin(yaw) + v * np.cos(yaw)
    heading = float(np.degrees(yaw) % 360.0)
    for lane, off in ((0, 0.8 if ill else 0.0), (1, 0.0)):
        wrong = north + off * (t - lanes.ill[0])
        write("XKF1", 100.0 + t, C=lane, Yaw=heading, VN=vn + off, VE=ve, PN=wrong, PE=east)
        state = {"SS": 1, "SV": 3.0} if ill and not lane else {"SS": 831, "SV": 0.1}
        write("XKF4", 100.0 + t, C=lane, PI=int(ill and lanes.left), **state)


def _moving(seconds: float, vessel: Vessel) -> Any:
    """Time [s], state (6,) and pulses of a boat that pushes ahead and turns both ways."""
    times = np.arange(0.0, seconds, 0.05)
    turn, ahead = 0.3 * np.sin(0.6 * times), 0.4 + 0.3 * np.sin(0.21 * times + 1.0)
    commands = np.clip(np.stack([ahead + turn, ahead - turn], axis=1), -1.0, 1.0)
    states, _ = Model.of(vessel).simulate(commands, 0.05)
    _, pulses = vessel.pulses(commands)
    return zip(times.tolist(), states[0, :-1, :6], pulses, strict=True)


def _moment(
    write: Any, t: float, row: Any, pulses: Any, fix: bool, slow: bool, one_lane: bool
) -> None:
    """What the boat logs at one moment of its voyage."""
    north, east, yaw, u, v, r = (float(value) for value in row)
    heading = float(np.degrees(yaw) % 360.0)
    vn, ve = u * np.cos(yaw) - v * np.sin(yaw), u * np.sin(yaw) + v * np.cos(yaw)
    write("ATT", t, Yaw=heading)
    write("IMU", t, GyrZ=r)
    for name in ("EKF1", "XKF1") if one_lane else ():
        write(name, t, Yaw=heading, VN=vn, VE=ve, PN=north, PE=east)
    channels = {f"{c}{n + 1}": round(float(p)) for n, p in enumerate(pulses) for c in ("C", "Ch")}
    write("RCOU", t, **channels)
    write("RCIN", t, **channels)
    if slow:
        write("CURR", t, Volt=1240)
        write("BAT", t, Volt=12.4)
        course = float(np.degrees(np.arctan2(ve, vn)) % 360.0)
        place = {"Lat": LAT + north / 111_320.0,
                 "Lng": LON + east / (111_320.0 * np.cos(np.radians(LAT)))}  # fmt: skip
        write("GPS", t, Status=3 if fix else 1, Week=WEEK, GWk=WEEK, NSats=12, **place,
              Spd=float(np.hypot(vn, ve)), GCrs=course)  # fmt: skip


def _fmt(number: int, name: str, characters: str, columns: str) -> bytes:
    length = 3 + sum(struct.calcsize("<" + KINDS[c][0]) for c in characters)
    texts = struct.pack("4s16s64s", name.encode(), characters.encode(), columns.encode())
    return struct.pack("<BBBBB", 0xA3, 0x95, 128, number, length) + texts


def _message(number: int, characters: str, columns: str, fields: Mapping[str, Any]) -> bytes:
    values = []
    for character, column in zip(characters, columns.split(","), strict=True):
        value, scale = fields.get(column, 0), KINDS[character][1]
        if isinstance(value, str):
            value = value.encode()
        elif scale is None and "s" in KINDS[character][0]:
            value = b""
        elif scale is not None:
            value = round(value * scale)
        values.append(value)
    form = "<" + "".join(KINDS[c][0] for c in characters)
    return bytes([0xA3, 0x95, number]) + struct.pack(form, *values)
