"""A new run of what a log says of itself: its scenario, its settings, its overrides."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

from faultloop.errors import InputError
from faultloop.io.mcap_reader import Log
from faultloop.loop.runner import run

SCENARIO = "scenario.toml"


def run_again(log: Log, out: Path | str) -> None:
    """Run a log's own scenario and settings once more, into the log ``out``.

    Settings that name code of the user's are refused: a log may come from anybody.

    Raises InputError where the log does not have what it takes: that of a replay has no record in it.
    """
    text = log.attachments.get(SCENARIO)
    if text is None:
        if (record := log.metadata.get("replay", {}).get("record")) is not None:
            what = f"is of a replay of {record}, which is not in it: replay that again, and diff the two logs"
            raise InputError(what, file=log.path)
        raise InputError(f"has no attachment {SCENARIO}: it cannot be run again", file=log.path)
    noted = log.metadata.get("scenario", {})
    try:
        settings: dict[str, Any] = {
            name: json.loads(content) for name, content in log.metadata.get("settings", {}).items()
        }
    except ValueError as error:
        raise InputError(f"metadata settings: is no JSON ({error})", file=log.path) from error
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / SCENARIO
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        try:
            run(
                path,
                settings=settings,
                overrides=noted.get("overrides", "").splitlines(),
                without=noted.get("without", "").splitlines(),
                log=out,
                user_code=False,
            )
        except InputError as error:
            what = f"its scenario cannot be run again: {error.what}"
            raise InputError(what, file=log.path, key=error.key) from error
