"""The command line: parse, call, print. The work is done in `gateway.offline` and `gateway.live`.

Human output by default; `--json` prints JSON alone on standard output, progress goes to standard
error. Exit status 0 done, 1 the work failed, 2 bad input, 70 a fault of the program, 130
interrupted. Every failure is one line; the environment variable SHADOW_DEBUG=1 puts the traceback
in front of it. The traceback of a fault of the program is also written to a file.
"""

import os

# Work is shared out to cores in larger pieces: threads of BLAS, on matrices as small as these, wait
# for one another. Read when numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import atexit
import signal
import sys
import tempfile
import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import version as installed
from io import TextIOWrapper
from shlex import join
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperCommand

from gateway.commands import (
    PUBLISH,
    ask_about_vessels,
    effects,
    fleet,
    live,
    model,
    recordings,
    short_help,
    tell_unused_mapping,
)
from gateway.errors import NUMERICAL_ERRORS, ShadowError, numerical_message, printable
from gateway.long_running import other_ends

app = typer.Typer(
    name="shadow",
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # it would take [m] for markup
    help="The digital shadow of an unmanned boat: is the model of your boat right, and what is "
    "missing from it when it is not?\n\n"
    "Start with shadow demo. With a log of your own: shadow info LOG, "
    "shadow init LOG --out boat.toml, shadow replay LOG --vessel boat.toml, "
    "shadow compare LOG --vessel boat.toml, shadow diagnose LOG --vessel boat.toml.\n\n"
    "An error is one line and an exit status; SHADOW_DEBUG=1 in the environment adds its "
    "traceback.",
)


class Command(TyperCommand):
    """A command that says first what is odd about its options."""

    def invoke(self, ctx: Any) -> Any:
        """Run it."""
        tell_unused_mapping(ctx.params)
        ask_about_vessels(ctx.params)
        return super().invoke(ctx)


# What does the work is imported when a command runs: `shadow --help` answers at once.
COMMANDS: dict[str, Callable[..., None]] = {  # in the order of `shadow --help`
    "info": recordings.info,
    "init": recordings.init,
    "replay": recordings.replay,
    "live": live.live,
    "simulate": live.simulate,
    "hil": live.hil,
    "hil-demo": live.hil_demo,
    "identify": model.identify,
    "compare": model.compare,
    "diagnose": model.diagnose,
    "add": model.add,
    "report": recordings.report,
    "fleet": fleet.fleet,
    "wear": fleet.wear,
    "studio": recordings.studio,
    "plan": model.plan,
    "effects": effects.show_effects,
    "trust": effects.trust,
    "plants": live.show_plants,
    "config": recordings.show_config,
    "export": recordings.export,
    "repair": recordings.repair,
    "monitor": live.monitor,
    "demo": recordings.demo,
}
for name, command in COMMANDS.items():
    app.command(name, cls=Command, short_help=short_help(command))(command)
app.add_typer(model.app, name="vessel", short_help=model.app.info.help)


def _version(wanted: bool) -> None:
    if wanted:
        print(f"shadow-gateway {installed('shadow-gateway')}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Options of the program itself."""


# What typer raises for a command line that it cannot use; it has no public name.
_UsageError: type[Exception] = typer.BadParameter.__mro__[1]
PROGRAM_FAULT = 70  # exit status EX_SOFTWARE of sysexits.h
INTERRUPTED = 130  # 128 + SIGINT, as shells have it; typer returns it without a word


def main() -> None:
    """Entry point of `shadow`: one line and an exit status for everything that goes wrong."""
    for number in other_ends():
        signal.signal(number, signal.default_int_handler)  # leave nothing half-written
    for stream in (sys.stdout, sys.stderr):  # a terminal need not know our letters, nor a name's
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        status = app(_with_defaults(sys.argv[1:]) or ["--help"], standalone_mode=False)
        if status == INTERRUPTED:
            raise KeyboardInterrupt
        sys.stdout.flush()
    except ShadowError as error:
        _fail(str(error), error.exit_status)
    except _UsageError as error:
        _fail(_usage(error), 2)
    except (KeyboardInterrupt, typer.Abort):
        _fail("interrupted", INTERRUPTED)
    except BrokenPipeError:  # the reader of our output has closed the pipe
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = 0
    except NUMERICAL_ERRORS as error:
        _fail(numerical_message(_command_line(), error), 1)
    except OSError as error:
        _fail(f"{_command_line()}: {error}", 1)
    except Exception as error:
        from sim.effects.effect import LawError  # its numba takes as long as all else of a `--help`

        if isinstance(error, LawError):
            _fail(str(error), 2)
        if isinstance(error, ValueError) and type(error).__module__.startswith("sim."):
            _fail(f"{_command_line()}: {error}", 1)
        _fail(_program_fault(error), PROGRAM_FAULT)
    sys.exit(status if isinstance(status, int) else 0)


def _with_defaults(arguments: list[str]) -> list[str]:
    """`--adapt` alone means `--adapt watch`, `--publish` `--publish zenoh`; `--no-publish` off."""
    out = list[str]()
    for argument, after in zip(arguments, [*arguments, ""][1:], strict=True):
        out += ["--publish", "off"] if argument == "--no-publish" else [argument]
        if argument == "--adapt" and after not in ("off", "watch", "apply"):
            out.append("watch")
        if argument == "--publish" and after not in PUBLISH:
            out.append("zenoh")
    return out


def run() -> NoReturn:
    """The program `shadow`: as `main`, and then an end that no thread of a library can spoil.

    Threads of zenoh may still be on their way out when everything is closed. One that asks for the
    interpreter while that is being taken down aborts the process or hangs it: so what is left to do
    at the end is done, and the process left without taking anything down. Where no zenoh is, or a
    thread still works, the interpreter ends as ever.
    """
    try:
        main()
    except SystemExit as end:
        others = set(threading.enumerate()) - {threading.current_thread()}
        if "zenoh" in sys.modules and all(thread.daemon for thread in others):
            atexit._run_exitfuncs()
            with suppress(OSError, ValueError):  # a reader that has gone
                sys.stdout.flush()
                sys.stderr.flush()
            os._exit(end.code if isinstance(end.code, int) else 0)
        raise
    raise AssertionError("main always exits")


def _usage(error: Any) -> str:
    """What is wrong on the command line, and where to read more."""
    command = error.ctx.command_path if error.ctx is not None else "shadow"
    return f"{error.format_message().rstrip('.')}: see `{command} --help`"


def _command_line() -> str:
    """The command as it was typed: it names recordings and vessels."""
    return join(["shadow", *sys.argv[1:]])


def _program_fault(error: Exception) -> str:
    """The line for an error that no input should cause; its traceback is written to a file."""
    report = f"shadow-gateway {installed('shadow-gateway')}, Python {sys.version}\n"
    report += f"{_command_line()}\n\n{''.join(traceback.format_exception(error))}"
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="shadow-fault-", suffix=".txt", delete=False, encoding="utf-8",
            errors="backslashreplace",
        ) as file:  # fmt: skip
            file.write(report)
        place = file.name
    except OSError:
        print(report, file=sys.stderr)
        place = "the traceback above"
    return (
        f"this is a fault of the program: please report it: {type(error).__name__}: {error} "
        f"(traceback: {place})"
    )


def _fail(text: str, status: int) -> NoReturn:
    """One line on standard error, even where it quotes names with line breaks; then exit."""
    if os.environ.get("SHADOW_DEBUG", "0") not in ("", "0"):
        traceback.print_exc()
    with suppress(OSError):  # a terminal that is gone
        print(f"error: {printable(' '.join(text.split()))}", file=sys.stderr)
    sys.exit(status)
