"""Tasks for the worker under test: it imports them in its own process."""

import os
import time

from gateway.errors import BadInput


def double(tell, value):
    tell("doubling")
    tell(("half done", value))
    return 2 * value


def refuse(tell):
    raise BadInput("no such\nboat")


def stumble(tell):
    raise KeyError("inside")


def die(tell):
    os._exit(3)


def sleep(tell):
    tell("asleep")
    time.sleep(60.0)


def process(tell):
    return os.getpid()


def niceness(tell):
    return os.nice(0)
