"""From a datagram's receipt to the loop that waits for it, beside peers in the same run.

    python -m benchmarks.links

1. Delay: datagrams at 250 Hz from another process; from the moment of sending until the loop's
   thread holds the item. The peer is a bare thread: recvfrom, time, queue, nothing decoded.
2. Work: CPU time per datagram, waiting included, of a link and of a loop around pymavlink's own
   `mavutil` connection, which waits in select and decodes with the same decoder.
"""

import multiprocessing
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import SimpleQueue
from typing import Any

import numpy as np
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.links import Datagram, Inbox
from gateway.links.link import Link

RATE_HZ, SECONDS = 250, 6.0
WORK_HZ = 2000  # ten times what a boat sends, and slow enough that nothing is lost
PORTS = {"link": 24610, "bare": 24611, "work": 24612, "mavutil": 24613}


def send(port: int, rate_hz: float, seconds: float) -> None:
    """SYSTEM_TIME that carries the moment of sending [µs], at an even pace."""
    mavlink, count = dialect.MAVLink(None, 1, 1), int(rate_hz * seconds)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        begin = time.perf_counter()
        for k in range(count):
            time.sleep(max(0.0, begin + k / rate_hz - time.perf_counter()))
            raw = dialect.MAVLink_system_time_message(time.time_ns() // 1000, k).pack(mavlink)
            line.sendto(raw, ("127.0.0.1", port))


@contextmanager
def sender(port: int, rate_hz: float) -> Iterator[None]:
    """`send` in a process of its own."""
    process = multiprocessing.get_context("spawn").Process(
        target=send, args=(port, rate_hz, SECONDS)
    )
    process.start()
    yield
    process.join()


def bare(port: int, items: "SimpleQueue[tuple[bytes, int]]") -> None:
    """The least that a receiver can do."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.bind(("127.0.0.1", port))
        for _ in range(int(RATE_HZ * SECONDS)):
            items.put((line.recvfrom(65536)[0], time.time_ns()))


def waited(get: Callable[[], Any], found: list[tuple[int, int, int]]) -> None:
    """A loop's thread: (sent, received, here) of each item [ns]."""
    while len(found) < int(RATE_HZ * SECONDS):
        item = get()
        here = time.time_ns()
        if isinstance(item, Datagram):
            item = (item.frames[0].raw, item.receive_time_ns)
        elif not isinstance(item[0], bytes):
            continue
        sent_us = int.from_bytes(item[0][10:18], "little")
        found.append((sent_us * 1000, item[1], here))


def delay_of(name: str, get: Callable[[], Any]) -> None:
    """Send at `RATE_HZ` to the port of that name and print how late the loop has each item."""
    found: list[tuple[int, int, int]] = []
    loop = threading.Thread(target=waited, args=(get, found), daemon=True)
    loop.start()
    with sender(PORTS[name], RATE_HZ):
        loop.join(SECONDS + 10)
    t = np.array(found) * 1e-3
    parts = (t[:, 1] - t[:, 0], t[:, 2] - t[:, 1], t[:, 2] - t[:, 0])
    told = "   ".join(f"p50 {np.median(p):5.0f} p99 {np.percentile(p, 99):6.0f}" for p in parts)
    print(f"  {name:20s} {told}   ({len(found)} of {int(RATE_HZ * SECONDS)})")


def delays() -> None:
    """Part 1."""
    print(f"delay at {RATE_HZ} Hz [µs]      sent → receipt      receipt → loop      sent → loop")
    inbox = Inbox()
    with Link(f"udpin:127.0.0.1:{PORTS['link']}", inbox):
        delay_of("link", inbox.get)
    items: SimpleQueue[tuple[bytes, int]] = SimpleQueue()
    threading.Thread(target=bare, args=(PORTS["bare"], items), daemon=True).start()
    delay_of("bare", items.get)


def work() -> None:
    """Part 2."""
    inbox = Inbox(capacity=10**6)
    with Link(f"udpin:127.0.0.1:{PORTS['work']}", inbox) as link:
        begin = time.process_time()
        with sender(PORTS["work"], WORK_HZ):
            pass
        ours = (time.process_time() - begin) / link.counts().datagrams * 1e6
    connection = mavutil.mavlink_connection(
        f"udpin:127.0.0.1:{PORTS['mavutil']}", dialect="ardupilotmega"
    )
    begin, count = time.process_time(), 0
    with sender(PORTS["mavutil"], WORK_HZ):
        while connection.recv_match(blocking=True, timeout=2.0) is not None:
            count += 1
    theirs = (time.process_time() - begin) / count * 1e6
    connection.close()
    print(
        f"CPU per datagram: link {ours:.1f} µs, mavutil {theirs:.1f} µs: ratio {theirs / ours:.2f}"
    )


if __name__ == "__main__":
    delays()
    work()
