"""One case of a campaign again, alone, with everything logged: from the campaign's file and nothing else."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow.compute as pc
import pyarrow.parquet as pq

from faultloop.api import run
from faultloop.config.toml_text import toml_text
from faultloop.errors import InputError
from faultloop.loop.result import Result
from faultloop.study.campaign.parts import read_record
from faultloop.study.campaign.plan import Plan
from faultloop.study.campaign.record import key_digest, plan_of
from faultloop.study.campaign.table import outcome_cells, schema_of


@dataclass
class Again:
    """A case that was run again.

    Attributes
    ----------
    row : what the campaign's file says of it.
    differences : ``column: there, here`` of each cell that came out otherwise; none with the same version.
    """

    case: int
    values: dict[str, Any]
    row: dict[str, Any]
    result: Result
    differences: list[str]


def run_again(
    file: Path,
    case: int,
    *,
    log: Path | None,
    rerun: str | None = None,
    keys: Path | None = None,
    user_code: bool = True,
    progress: Callable[[float], None] | None = None,
) -> Again:
    """Run case ``case`` of a campaign's file.

    Parameters
    ----------
    keys : the key file, of a case with an authenticated bus: it is the one thing that the file does not hold.

    Raises
    ------
    InputError : the file is no campaign's, there is no such case, it failed in the campaign, too, or `keys`
        is missing or not what the campaign had.
    """
    record = read_record(file)
    row = _row(file, case)
    with tempfile.TemporaryDirectory(prefix="faultloop-case-") as folder:
        plan = plan_of(record, Path(folder), file, user_code)
        values = plan.values(case)
        scenario = _lay_out(plan, values, Path(folder), lambda name: _keys(record, name, keys))
        result = run(scenario, log=log, rerun=rerun, user_code=user_code, keep=False, progress=progress)
    schema = schema_of(plan, [place.name for place in result.scenario.relay])
    here = outcome_cells(result.scenario, result.trips, result.fault_start_ns, result.fault_locations)
    told = [name for name in schema.names if name in here]
    differences = [f"{name}: {row[name]!r}, now {here[name]!r}" for name in told if row[name] != here[name]]
    return Again(case, values, row, result, differences)


def _row(file: Path, case: int) -> dict[str, Any]:
    table = pq.read_table(file, filters=pc.field("case") == case)
    if not len(table):
        cases = pq.read_metadata(file).num_rows
        raise InputError(f"has no case {case}; they are 0 to {cases - 1}", file=file)
    return table.to_pylist()[0]


def _keys(record: dict[str, Any], name: str, given: Path | None) -> str:
    if given is None:
        raise InputError(
            f"the case's bus is authenticated with '{name}'; keys are secrets and not in a campaign's file:"
            " give that file",
            key="--keys",
        )
    if key_digest(given) != record.get("keys", {}).get(name):
        raise InputError(f"is not '{name}' as the campaign had it", file=given, key="--keys")
    return str(given.absolute())


def _lay_out(plan: Plan, values: dict[str, Any], folder: Path, keys: Callable[[str], str]) -> Path:
    """The case as files of its own, so that its log carries what it really was."""
    data, settings = plan.tables_of(values)
    for relay in data["relay"]:
        path, text, content = settings[relay["name"]]
        own = path.with_name(f"{relay['name']}.toml")
        changed = content is not plan.files.settings_of(relay["settings"])[2]
        own.write_text(toml_text(content) if changed else text, encoding="utf-8")
        relay["settings"] = own.relative_to(folder).as_posix()
    if (name := data.get("can", {}).get("keys")) is not None:
        data["can"]["keys"] = keys(name)
    scenario = folder / "case.toml"
    scenario.write_text(toml_text(data), encoding="utf-8")
    return scenario
