"""Tasks for the worker under test: it imports them in its own process."""

import os
import time

from gateway.errors import BadInput


def double(send, value):
    send("doubling")
    send(("half done", value))
    return 2 * value


def refuse(send):
    raise BadInput("no such\nboat")


def stumble(send):
    raise KeyError("inside")


def die(send):
    os._exit(3)


def sleep(send):
    send("asleep")
    time.sleep(60.0)


def process(send):
    return os.getpid()


def niceness(send):
    return os.nice(0)
