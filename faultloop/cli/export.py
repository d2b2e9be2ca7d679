"""``faultloop export``"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    log: Annotated[Path, typer.Argument(metavar="LOG.mcap", help="The log of a run or a replay.")],
    comtrade: Annotated[
        Path | None, typer.Option(metavar="F.cfg|F.cff", help="COMTRADE (IEC 60255-24).")
    ] = None,
    parquet: Annotated[Path | None, typer.Option(metavar="DIR", help="A Parquet file per topic.")] = None,
    csv: Annotated[Path | None, typer.Option(metavar="DIR", help="A CSV file per topic.")] = None,
    can: Annotated[Path | None, typer.Option(metavar="F.blf|.asc|.log", help="The CAN frames.")] = None,
    pcap: Annotated[
        Path | None, typer.Option(metavar="F.pcap", help="As GOOSE and Sampled Values (IEC 61850).")
    ] = None,
    scl: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Who publishes them: a CID file per IED, and an SCD file."),
    ] = None,
    relay: Annotated[
        str | None, typer.Option(metavar="NAME", help="COMTRADE of this relay only; all where not given.")
    ] = None,
    revision: Annotated[str, typer.Option(metavar="1999|2013", help="COMTRADE revision.")] = "2013",
    format: Annotated[
        str, typer.Option(metavar="ASCII|BINARY|BINARY32|FLOAT32", help="COMTRADE data format.")
    ] = "FLOAT32",
    json: Annotated[bool, typer.Option("--json", help="One JSON object on standard output.")] = False,
) -> int:
    """Write a log, or a part of it, in another format."""
    from faultloop.cli.output import print_json, reading, warn_of
    from faultloop.cli.terminal import say
    from faultloop.errors import InputError
    from faultloop.io.mcap_reader import open_log

    if all(target is None for target in (comtrade, parquet, csv, can, pcap, scl)):
        raise InputError(
            "say what to write: --comtrade F.cfg, --parquet DIR, --csv DIR, --can F.blf, --pcap F.pcap "
            "or --scl DIR"
        )
    opened = open_log(log)
    written: list[Path] = []
    with reading(opened):
        if comtrade is not None:
            from faultloop.review.export import log_to_comtrade

            written += log_to_comtrade(opened, comtrade, relay=relay, revision=revision, format=format)
        if parquet is not None or csv is not None:
            from faultloop.io.tables import write_csv, write_parquet

            written += write_parquet(opened, parquet) if parquet is not None else []
            written += write_csv(opened, csv) if csv is not None else []
        if can is not None:
            from faultloop.review.export import log_to_can

            written += log_to_can(opened, can)
        if pcap is not None or scl is not None:
            from faultloop.review.process_bus import log_to_pcap, log_to_scl

            written += log_to_pcap(opened, pcap) if pcap is not None else []
            written += log_to_scl(opened, scl) if scl is not None else []
    warnings = warn_of(opened)
    if json:
        print_json({"written": [str(path) for path in written], "warnings": warnings})
    else:
        for path in written:
            say(f"wrote {path}")
    return 0
