"""A row per case: its columns, from a case's outcome to Arrow."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import pyarrow as pa

from faultloop.loop.case import CaseOutcome
from faultloop.loop.outcome import TripReport
from faultloop.loop.scenario import Scenario
from faultloop.study.campaign.judge import judge_case
from faultloop.study.campaign.plan import Case, Plan

RELAY_COLUMNS: dict[str, pa.DataType] = {
    "tripped": pa.bool_(),
    "function": pa.string(),
    "zone": pa.int32(),
    "loop": pa.string(),
    "poles": pa.string(),
    "decided_ns": pa.int64(),
    "received_ns": pa.int64(),
    "opened_ns": pa.int64(),
    "location_pu": pa.float64(),
    "trips": pa.int32(),
}


def schema_of(plan: Plan, relays: Sequence[str]) -> pa.Schema:
    """Columns in their order: case, varied keys, the fault's start, each relay's trip, the verdict."""
    fields = [pa.field("case", pa.int64(), nullable=False)]
    fields += [pa.field(key, type_) for key, type_ in _key_types(plan).items()]
    fields.append(pa.field("fault_ns", pa.int64()))
    fields += [
        pa.field(f"{relay}.{name}", type_) for relay in relays for name, type_ in RELAY_COLUMNS.items()
    ]
    fields += [pa.field(name, pa.string()) for name in ("verdict", "reason", "error")]
    return pa.schema(fields)


def _key_types(plan: Plan) -> dict[str, pa.DataType]:
    found = {}
    for vary in plan.tables.vary:
        sample = vary.listed() if vary.values is not None else (1.0,)
        for key in vary.all_keys:
            scaled = key in vary.factor and not float(vary.factor[key]).is_integer()
            found[key] = pa.float64() if scaled else _type_of(sample)
    return found


def _type_of(values: Sequence[Any]) -> pa.DataType:
    kinds = {type(value) for value in values}
    if kinds == {bool}:
        return pa.bool_()
    if kinds == {int}:
        return pa.int64()
    if kinds <= {int, float}:
        return pa.float64()
    return pa.string()


def row_of(plan: Plan, case: Case, outcome: CaseOutcome) -> dict[str, Any]:
    """A case that ran."""
    fault_ns = outcome.fault_start_ns
    row = started(case.number, case.values)
    row |= outcome_cells(case.scenario, outcome.trips, fault_ns, outcome.fault_locations)
    row["verdict"], row["reason"] = judge_case(plan.tables.judge, case.scenario, outcome.trips, fault_ns)
    return row


def outcome_cells(
    scenario: Scenario, trips: Sequence[TripReport], fault_ns: int | None, locations: Mapping[str, float]
) -> dict[str, Any]:
    """What a run came to, by column."""
    cells: dict[str, Any] = {"fault_ns": fault_ns}
    for place in scenario.relay:
        own = [trip for trip in trips if trip.relay == place.name]
        location = locations[place.name]
        first = own[0] if own else None
        of_relay = {
            "tripped": first is not None,
            "function": first and first.function,
            "zone": first and first.zone,
            "loop": first and first.loop,
            "poles": first and first.pole_names,
            "decided_ns": first and first.t_ns,
            "received_ns": first and first.received_ns,
            "opened_ns": first and first.opened_ns,
            "location_pu": location if math.isfinite(location) else None,
            "trips": len(own),
        }
        cells |= {f"{place.name}.{name}": value for name, value in of_relay.items()}
    return cells


def failed(number: int, values: Mapping[str, Any], error: str) -> dict[str, Any]:
    """A case that could not be run."""
    return started(number, values) | {"verdict": "unjudged", "error": " ".join(error.split())}


def started(number: int, values: Mapping[str, Any]) -> dict[str, Any]:
    """A row with its case and values."""
    return {"case": number, **values}


def arrow(schema: pa.Schema, rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """Rows as a table; null where a row has nothing."""
    columns = [pa.array(_cells([row.get(f.name) for row in rows], f.type), f.type) for f in schema]
    return pa.Table.from_arrays(columns, schema=schema)


def _cells(values: list[Any], type_: pa.DataType) -> list[Any]:
    """As the column's type takes them: what is neither text nor a number as JSON."""
    if pa.types.is_string(type_):
        return [value if value is None or isinstance(value, str) else json.dumps(value) for value in values]
    if pa.types.is_boolean(type_):
        return values
    number = float if pa.types.is_floating(type_) else int
    return [None if value is None else number(value) for value in values]
