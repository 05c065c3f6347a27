"""Ctrl-C at any moment: how many of N interrupted programs end in order.

    python -m benchmarks.interrupts --runs 200

Each run starts a program that publishes on zenoh, with a subscriber that listens to everything, and
sends SIGINT at a random moment after it is up. In order means: the exit status is that of an
interrupt (130, or 0 where Ctrl-C is the way to end the program), within `PATIENCE_S`, and nothing
half-written is left. A hang is killed and counted, as is a death by a signal (SIGSEGV is −11).
"""

import argparse
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import zenoh

from gateway.bus import session_config

ROOT = Path(__file__).resolve().parent.parent
PATIENCE_S = 120.0
STARTED_S = 120.0
SHADOW = (sys.executable, "-X", "faulthandler", "-c", "from gateway.cli import run; run()")
LOG = ROOT / "recordings" / "voyage_1.tlog"
VESSEL = ROOT / "configs" / "vessels" / "demo_boat.toml"


def free_port() -> int:
    """A port of this machine that nothing listens at."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def configuration(folder: Path, port: int) -> Path:
    """A gateway.toml that publishes at that port."""
    path = folder / "gateway.toml"
    path.write_text(f'[zenoh]\nendpoint = "tcp/127.0.0.1:{port}"\n')
    return path


def programs(folder: Path, port: int) -> dict[str, tuple[list[str], set[int]]]:
    """Name -> command line, and the exit statuses of an end in order."""
    config, out = configuration(folder, port), folder / "out"
    play = f"udpout:127.0.0.1:{free_port()}"
    common = ["--config", str(config), "--vessel", str(VESSEL)]
    return {
        "replay": (
            ["replay", str(LOG), *common, "--speed", "1", "--publish", "--out", str(out)], {130}
        ),
        "live": (["live", f"udpin:127.0.0.1:{free_port()}", *common, "--out", str(out)], {0}),
        "simulate": (["simulate", "--vessel", str(VESSEL), "--live", play], {0}),
    }  # fmt: skip


def interrupted(name: str, rng: random.Random, listen: bool) -> str:
    """One run -> "in order", "hang", or what the exit status was."""
    with tempfile.TemporaryDirectory() as text:
        folder, port = Path(text), free_port()
        words, good = programs(folder, port)[name]
        process = subprocess.Popen(
            [*SHADOW, *words], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )  # fmt: skip
        session = None
        try:
            _wait_until_up(name, process, folder, port)
            if listen:
                session = _listener(port) if name != "simulate" else None
            time.sleep(rng.uniform(0.0, 0.5))
            process.send_signal(signal.SIGINT)
            _, err = process.communicate(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            os.kill(process.pid, signal.SIGABRT)  # the fault handler says where it hangs
            _, err = process.communicate()
            print(err, file=sys.stderr)
            return "hang"
        finally:
            if session is not None:
                session.close()
            if process.poll() is None:
                process.kill()
                process.wait()
        if process.returncode not in good:
            print(err, file=sys.stderr)
            return f"status {process.returncode}: {err.strip().splitlines()[-1:]}"
        left = [p.name for p in folder.rglob("*.part")]
        return f"left {left}" if left else "in order"


def _listener(port: int) -> zenoh.Session | None:
    """A subscriber to everything; None where the program is not there yet."""
    try:
        session = zenoh.open(session_config("client", {"connect": [f"tcp/127.0.0.1:{port}"]}))
    except zenoh.ZError:
        return None
    session.declare_subscriber("shadow/**", lambda sample: None)
    return session


def _wait_until_up(name: str, process: subprocess.Popen[str], folder: Path, port: int) -> None:
    """Until the program publishes (or, a simulated boat, says that it plays)."""
    end = time.monotonic() + STARTED_S
    if name == "simulate":
        assert process.stderr is not None
        process.stderr.readline()
        return
    while time.monotonic() < end and process.poll() is None:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=0.2).close()
            return
        except OSError:
            time.sleep(0.02)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print how many of each program ended how."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=200, help="in all, over the programs")
    parser.add_argument("--program", choices=["replay", "live", "simulate"], action="append")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(arguments)
    names = given.program or ["replay", "live", "simulate"]
    rng, counts = random.Random(given.seed), Counter[str]()
    for run in range(given.runs):
        name = names[run % len(names)]
        how = interrupted(name, rng, listen=run % 2 == 0)
        counts[f"{name}: {how}"] += 1
        if run % 20 == 19:
            print(f"{run + 1} runs: {dict(counts)}", file=sys.stderr, flush=True)
        if how != "in order":
            print(f"run {run}: {name}: {how}", file=sys.stderr, flush=True)
    for line, count in sorted(counts.items()):
        print(f"{count:5d}  {line}")


if __name__ == "__main__":
    main()
