"""``faultloop monitor``"""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from rich.console import Group

    from faultloop.io.can.link import Link
    from faultloop.nodes.monitor import BusMonitor

LAP_S = 0.25


def command(
    can: Annotated[str, typer.Option(metavar="INTERFACE:CHANNEL", help="The bus, as in socketcan:vcan0.")],
    dbc: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Another DBC; faultloop's own where not given.")
    ] = None,
    seconds: Annotated[
        float | None, typer.Option(metavar="S", help="End after S seconds; Ctrl-C where not given.")
    ] = None,
    bitrate: Annotated[int, typer.Option(metavar="BIT/S", help="Nominal, for the load.")] = 500_000,
    data_bitrate: Annotated[int, typer.Option(metavar="BIT/S", help="Of CAN FD's data.")] = 2_000_000,
    pace: Annotated[
        float, typer.Option(metavar="X", help="The run's, for its load and repetition times.")
    ] = 1.0,
    json: Annotated[bool, typer.Option("--json", help="One JSON object at the end.")] = False,
) -> int:
    """Show what is on a bus: each message decoded, its rate, what its protection says, the bus load."""
    from rich.live import Live

    from faultloop.cli.output import console, print_json, screen
    from faultloop.io.can.dbc import load_dbc
    from faultloop.nodes.monitor import BusMonitor

    monitor = BusMonitor(bitrate, data_bitrate, None if dbc is None else load_dbc(dbc), pace)
    with closing(_link(can)) as link, _until_stopped():
        begin_ns = time.monotonic_ns()
        monitor.begin(begin_ns)
        end_ns = None if seconds is None else begin_ns + round(seconds * 1e9)
        out = console()
        if out.is_terminal and not json:
            with Live(console=screen(), screen=True, auto_refresh=False) as live:
                _watch(monitor, link, end_ns, lambda: live.update(_table(monitor, link), refresh=True))
        else:
            _watch(monitor, link, end_ns, lambda: None)
        monitor.whole(time.monotonic_ns())
        if json:
            print_json(_as_dict(monitor, link))
        else:
            out.print(_table(monitor, link))
    return 0


def _link(can: str) -> Link:
    """The bus with CAN FD, or without where it has none."""
    from faultloop.errors import InputError
    from faultloop.io.can.socketcan import open_link

    if can.startswith("virtual:"):
        raise InputError(
            "the virtual bus is seen in its own process only: give the run --can socketcan:vcan0 to watch it",
            key="--can",
        )
    try:
        return open_link(can, fd=True)
    except InputError:
        return open_link(can, fd=False)  # has its own say where there is no such bus


@contextmanager
def _until_stopped() -> Iterator[None]:
    """Ctrl-C, or a termination signal: the ordinary end, with the table printed."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _watch(monitor: BusMonitor, link: Link, end_ns: int | None, show: Callable[[], None]) -> None:
    """Take frames until `end_ns` or Ctrl-C; every quarter of a second a lap is ended and shown."""
    lap_ns = time.monotonic_ns()
    try:
        while end_ns is None or time.monotonic_ns() < end_ns:
            for t_ns, frame in link.receive(LAP_S / 5):
                monitor.take(t_ns, frame)
            now_ns = time.monotonic_ns()
            if now_ns - lap_ns >= LAP_S * 1e9:
                monitor.lap(now_ns)
                lap_ns = now_ns
                show()
    except KeyboardInterrupt:
        pass


def _table(monitor: BusMonitor, link: Link) -> Group:
    from faultloop.cli.output import table
    from faultloop.nodes.monitor import state_of

    now_ns = time.monotonic_ns()
    rows = [
        (
            f"{row.identifier:08X}" if row.extended else f"{row.identifier:03X}",
            row.name or "?",
            row.sender,
            row.count,
            f"{row.rate_hz:.1f}",
            f"{(now_ns - row.last_ns) / 1e9:.1f}",
            state_of(row),
            monitor.content(row),
        )
        for row in monitor.sorted_rows()
    ]
    columns = ["id", "message", "from", ">frames", ">per s", ">age s", "checks", "content"]
    title = f"{monitor.frames} frames, bus load {100 * monitor.load:.1f} %"
    losses = [(link.dropped, "dropped by the kernel"), (link.errors, "error frames")]
    title += "".join(f", {count} {what}" for count, what in losses if count)
    return table(title, columns, rows)


def _as_dict(monitor: BusMonitor, link: Link) -> dict[str, Any]:
    from faultloop.nodes.monitor import lost, rejections, state_of

    return {
        "frames": monitor.frames,
        "load": monitor.load,
        "dropped": link.dropped,
        "error_frames": link.errors,
        "messages": [
            {
                "id": row.identifier,
                "extended": row.extended,
                "name": row.name or None,
                "sender": row.sender or None,
                "frames": row.count,
                "rate_hz": row.rate_hz,
                "lost": lost(row),
                "rejected": {cause.name.lower(): count for cause, count in rejections(row).items()},
                "checks": state_of(row) or None,
                "content": monitor.content(row),
            }
            for row in monitor.sorted_rows()
        ],
    }
