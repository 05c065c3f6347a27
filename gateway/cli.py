"""The command line: parse, call, print. The work is done in `gateway.pipelines`.

Human output by default; `--json` prints JSON alone on standard output, progress goes to standard
error. Exit status 0 done, 1 the work failed, 2 bad input, which gets one line.
"""

import os
import signal
import sys
from collections.abc import Callable
from importlib.metadata import version as installed
from typing import Annotated, Any, NoReturn

import typer

from gateway.commands import live, missing, model, recordings, shown
from gateway.errors import ShadowError
from sim.effects.effect import LawError

app = typer.Typer(
    name="shadow",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # it would take [m] for markup
    help="The digital shadow of an unmanned boat: is the model of your boat right, and what is "
    "missing from it when it is not?\n\n"
    "Start with shadow demo. With a log of your own: shadow info LOG, "
    "shadow init LOG --out boat.toml, shadow replay LOG --vessel boat.toml, "
    "shadow compare LOG --vessel boat.toml, shadow diagnose LOG --vessel boat.toml.",
)

# What does the work is imported when a command runs: `shadow --help` answers at once.
COMMANDS: dict[str, Callable[..., None]] = {  # in the order of `shadow --help`
    "info": recordings.info,
    "init": recordings.init,
    "replay": recordings.replay,
    "live": live.live,
    "simulate": live.simulate,
    "identify": model.identify,
    "compare": model.compare,
    "diagnose": missing.diagnose,
    "add": missing.add,
    "report": shown.report,
    "studio": shown.studio,
    "plan": model.plan,
    "effects": missing.show_effects,
    "config": shown.show_config,
    "repair": recordings.repair,
    "monitor": live.monitor,
    "demo": shown.demo,
}
for name, command in COMMANDS.items():
    app.command(name)(command)


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


def main() -> None:
    """Entry point of `shadow`: one line and an exit status for everything that goes wrong."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # leave nothing half-written
    try:
        status = app(sys.argv[1:] or ["--help"], standalone_mode=False)
        sys.stdout.flush()
    except ShadowError as error:
        _fail(str(error), error.exit_status)
    except LawError as error:
        _fail(str(error), 2)
    except _UsageError as error:
        _fail(_usage(error), 2)
    except (KeyboardInterrupt, typer.Abort):
        _fail("interrupted", 130)
    except BrokenPipeError:  # whoever read our output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = 0
    sys.exit(status if isinstance(status, int) else 0)


def _usage(error: Any) -> str:
    """What is wrong on the command line, and where to read more."""
    command = error.ctx.command_path if error.ctx is not None else "shadow"
    return f"{error.format_message().rstrip('.')}: see `{command} --help`"


def _fail(says: str, status: int) -> NoReturn:
    """One line, whatever names with line breaks it quotes."""
    print(f"error: {' '.join(says.split())}", file=sys.stderr)
    sys.exit(status)
