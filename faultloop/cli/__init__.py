"""The command line: one thin module per command, each importing what it needs when it runs."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import typer

from faultloop.cli import (
    campaign,
    campaign_case,
    campaign_report,
    channels,
    check,
    diff,
    export,
    export_settings,
    import_,
    layout,
    locate,
    monitor,
    new,
    node,
    recover,
    replay,
    review,
    run,
    schema,
    suite,
    why,
)
from faultloop.cli.completion import complete_at_the_first_tab
from faultloop.cli.terminal import prepare_streams, warn
from faultloop.errors import InputError

app = typer.Typer(
    name="faultloop",
    help="IEC-style protection relay simulator: EMT plant, distance relay, trips over CAN, logs in MCAP.",
    epilog="Exit status: 0 done, 2 the input is wrong, 3 an expectation did not hold or logs differ, "
    "130 interrupted.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

COMMANDS = (
    new, check, run, node, monitor, replay, channels, review, why, export, diff, recover, suite, schema,
    campaign, campaign_report, campaign_case, import_, export_settings, locate, layout,
)  # fmt: skip
for command in COMMANDS:
    app.command(name=command.__name__.rpartition(".")[2].rstrip("_").replace("_", "-"))(command.command)


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"faultloop {version('faultloop')}")
        raise typer.Exit


@app.callback()
def _options(
    version: bool = typer.Option(False, "--version", callback=_version, is_eager=True, help="Its version."),
) -> None:
    pass


def call(arguments: Sequence[str] | None = None) -> int:
    """Run one command; the exit status.  Every wrong input is one line on standard error."""
    prepare_streams()
    complete_at_the_first_tab()
    try:
        with _terminable():
            given = None if arguments is None else list(arguments)
            status = app(
                args=given, prog_name="faultloop", standalone_mode=False
            )  # not `python -m faultloop`
            sys.stdout.flush()
        return status if isinstance(status, int) else 0
    except InputError as error:
        warn(f"faultloop: {error}")
        return 2
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:  # `faultloop review ... | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:  # what no command foresaw: output to a full disk, a share that went away
        warn(f"faultloop: {error.filename or 'output'}: {error.strerror or error}")
        return 2
    except Exception as error:
        told = getattr(error, "format_message", None)  # the parser's own word on a wrong command line
        if told is None:
            raise
        if text := " ".join(told().split()):  # empty where the help has just been printed
            warn(f"faultloop: {text} (see faultloop --help)")
        return 2


@contextmanager
def _terminable() -> Iterator[None]:
    """A termination signal, or a terminal's end, ends a command as Ctrl-C does: nothing half-made stays."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [
        number for name in ("SIGTERM", "SIGHUP") if (number := getattr(signal, name, None)) is not None
    ]
    before = {n: signal.signal(n, signal.default_int_handler) for n in numbers if _heeded(n)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _heeded(number: int) -> bool:
    """Not by nohup's child, and where nobody else has a handler."""
    return signal.getsignal(number) is signal.SIG_DFL


def main() -> None:
    """The console script."""
    sys.exit(call())
