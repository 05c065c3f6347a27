"""The autopilot in the loop: steps per second of the boat, and servo packet → sensors.

    python -m benchmarks.hil [--frames 20000] [--runs 3]

Steps are those of `sim.hil.boat.Boat`, in one process, beside the compiled loop of the vessel alone
(`Model.simulate`, which has neither sensors nor six degrees). Latency is counted at the socket of a
stand-in for the firmware: `shadow hil` runs as a program of its own, recording on; in the same run
the stand-in asks a relay that sends each packet back and does nothing else, the least that any
Python program at the other end can do. Targets: ten times real time at 400 Hz is an answer within
250 µs on average; p99 within 1 ms of the relay's. Runs are repeated and their median is shown: the
machine may be busy.
"""

import argparse
import os
import socket
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from pythonfmu.builder import FmuBuilder

from gateway.plants import load_plant
from gateway.vessel_file import load_vessel
from sim.effects.catalogue import EFFECTS
from sim.hil.boat import Boat
from sim.hil.day import Day, Wind
from sim.model import Model
from sim.plants.waves import Sea
from sim.vessel import AddedEffect

RATE_HZ = 400
SHADOW = "from gateway.cli import run; run()"
RELAY = """
import socket, sys
line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
line.bind(("127.0.0.1", int(sys.argv[1])))
print("waiting", file=sys.stderr, flush=True)
while True:
    data, peer = line.recvfrom(2048)
    line.sendto(data * 9, peer)
"""
SETTLE = 200  # frames left out
FMU = """
from math import cos, sin
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Boat(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        for name in ("x", "y", "psi", "u", "v", "r", "tau_x", "tau_y", "tau_n"):
            setattr(self, name, 0.0)
            causality = Fmi2Causality.input if "tau" in name else Fmi2Causality.output
            self.register_variable(Real(name, causality=causality))

    def do_step(self, time, h):
        u, v, r, c, s = self.u, self.v, self.r, cos(self.psi), sin(self.psi)
        self.u += h * ((self.tau_x - 12 * u - 15 * abs(u) * u) / 60 + v * r)
        self.v += h * ((self.tau_y - 40 * v - 60 * abs(v) * v) / 90 - u * r)
        self.r += h * (self.tau_n - 9 * r - 8 * abs(r) * r) / 15
        self.x, self.y = self.x + h * (c * u - s * v), self.y + h * (s * u + c * v)
        self.psi += h * r
        return True
"""
FMU_TABLE = """
file = "Boat.fmu"
inputs = { X = "tau_x", Y = "tau_y", N = "tau_n" }
outputs = { north = "x", east = "y", yaw = "psi", u = "u", v = "v", r = "r" }
"""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--frames", type=int, default=20_000)
    parser.add_argument("--runs", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        measure(options.frames, options.runs, plants(Path(folder)))


def plants(folder: Path) -> dict[str, str]:
    """A hull in six degrees, another under the same thrusters, and an FMU built here."""
    (folder / "boat.py").write_text(FMU, encoding="utf-8")
    FmuBuilder.build_FMU(folder / "boat.py", folder)
    (folder / "boat.toml").write_text(FMU_TABLE, encoding="utf-8")
    fmu = f"fmu:{folder / 'boat.toml'}"
    return {"mujoco": "mujoco", "vessel:wam-v": "vessel:wam-v", "fmu (in Python)": fmu}


def measure(frames: int, repeats: int, kinds: dict[str, str]) -> None:
    """Steps, then latency; kinds of plant by the name that is shown."""
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    print("\nsteps of 2.5 ms, in one process (CPU time)")
    for name, day in days().items():
        print(f"  {name:<34}{steps_per_second(Boat.of(load_vessel('otter'), day)):>10.0f} /s")
    print(f"  {'the vessel alone, compiled loop':<34}{vessel_steps_per_second():>10.0f} /s")
    for name, kind in kinds.items():
        boat = Boat.of(load_vessel("otter"), days()["waves"], plant=load_plant(kind))
        print(f"  {f'--plant {name}, waves':<34}{steps_per_second(boat, 4_000):>10.0f} /s")
    print(f"\nservo packet → sensors, lock-step at {RATE_HZ} Hz [µs]      p50    p99   × real time")
    programs: dict[str, list[str] | None] = {"relay": None, "shadow hil": []}
    programs |= {f"shadow hil --plant {name}": ["--plant", kind] for name, kind in kinds.items()}
    for name, words in programs.items():
        show(name, [round_trips(words, frames) for _ in range(repeats)])


def days() -> dict[str, Day]:
    """Days that cost more and more."""
    current = {e.name: e for e in EFFECTS}["varying_current"]
    values = {"speed": 0.3, "period": 60.0, "direction": 1.0, "phase": 0.0}
    sea = Sea(0.3, 3.0, 1.0)
    return {
        "calm water": Day(),
        "waves": Day(sea=sea),
        "waves, wind and a tide": Day((AddedEffect(current, values),), sea=sea, wind=Wind(4, 1)),
    }


def steps_per_second(boat: Boat, count: int = 10_000) -> float:
    """Steps of a boat that sails a curve."""
    state, pulses = boat.start(), {1: 1700.0, 3: 1650.0}
    begun = time.process_time()
    for _ in range(count):
        state, _, _ = boat.step(state, pulses, 1.0 / RATE_HZ)
    return count / (time.process_time() - begun)


def vessel_steps_per_second(count: int = 200_000) -> float:
    """The same curve in the compiled loop alone."""
    model = Model.of(load_vessel("otter"))
    commands = np.tile([0.4, 0.3], (count, 1))
    model.simulate(commands[:10], 1.0 / RATE_HZ)
    begun = time.process_time()
    model.simulate(commands, 1.0 / RATE_HZ)
    return count / (time.process_time() - begun)


@contextmanager
def answering(more: Sequence[str] | None, port: int) -> Iterator[None]:
    """A process that answers on a port: `shadow hil` with more words, or None: the relay."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-c", RELAY, str(port)]
        if more is not None:
            words = ["hil", f"json:127.0.0.1:{port}", "-v", "otter", "--out", folder, *more]
            command = [sys.executable, "-c", SHADOW, *words]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
            assert process.stderr is not None
            process.stderr.readline()
            try:
                yield
            finally:
                process.terminate()
                process.communicate()


def round_trips(more: Sequence[str] | None, frames: int) -> list[float]:
    """Seconds from a packet to its answer, frame by frame."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.bind(("127.0.0.1", 0))
        port = line.getsockname()[1] % 20000 + 30000
        line.connect(("127.0.0.1", port))
        line.settimeout(5.0)
        out = []
        with answering(more, port):
            for count in range(frames):
                pulses = (1700, 0, 1650, *(0,) * 13)
                begun = time.perf_counter()
                line.send(struct.pack("<HHI16H", 18458, RATE_HZ, count, *pulses))
                line.recv(4096)
                out.append(time.perf_counter() - begun)
    return out[SETTLE:]


def show(name: str, runs: Sequence[Sequence[float]]) -> None:
    """Medians over the runs."""
    p50, p99 = (1e6 * np.median([np.percentile(run, p) for run in runs]) for p in (50, 99))
    pace = np.median([1.0 / RATE_HZ / np.mean(run) for run in runs])
    print(f"  {name:<48}{p50:>7.0f}{p99:>7.0f}{pace:>10.1f}")


if __name__ == "__main__":
    main()
