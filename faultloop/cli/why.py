"""``faultloop why``"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer


def command(
    log: Annotated[Path, typer.Argument(metavar="LOG.mcap", help="The log of a run or a replay.")],
    relay: Annotated[str | None, typer.Option(metavar="NAME", help="Of this relay only.")] = None,
    function: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of this function only: PDIS2.")
    ] = None,
    at: Annotated[
        float | None,
        typer.Option(metavar="MS", help="What each relay knew at this instant, from the fault's inception."),
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", help="One JSON array (with --at too) on standard output.")
    ] = False,
) -> int:
    """Why it tripped, and why it did not: each function, its depth, its timer, and what stopped it."""
    from faultloop.cli.output import announce_compilation, print_json, reading, warn_of
    from faultloop.io.mcap_reader import open_log
    from faultloop.review.summary import summarize
    from faultloop.review.why import at_instant, why

    announce_compilation()
    opened = open_log(log)
    with reading(opened):
        summary = summarize(opened)
        if at is not None:
            names = list(summary.relays) if relay is None else [relay]
            found: list[Any] = [at_instant(opened, summary, name, at, function) for name in names]
        else:
            found = [vars(reason) for reason in why(opened, summary, relay, function)]
    warn_of(opened)
    if json:
        print_json(found)
    elif at is not None:
        _print_instant(found, summary.inception.zero_ns)
    else:
        _print(found, summary.inception.zero_ns)
    return 0


def _print(found: list[dict[str, Any]], zero: int) -> None:
    from faultloop.cli.terminal import say

    last = None
    for reason in found:
        if reason["relay"] != last:
            last = reason["relay"]
            say(f"{last}")
        say(f"  {reason['text']}  [{reason['cause']}]")


def _print_instant(found: list[dict[str, Any]], zero: int) -> None:
    from faultloop.cli.terminal import say

    for one in found:
        say(f"{one['relay']} at {(one['t_ns'] - zero) / 1e6:.2f} ms: {one['text']}")
        for zone in one["zones"]:
            depths = ", ".join(f"{loop} {m:.2f}" for loop, m in zone["m"].items()) or "no depth"
            say(f"  {zone['function']}: {depths}; {zone['text']}")
