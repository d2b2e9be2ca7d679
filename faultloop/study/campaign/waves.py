"""``--keep samples,phasors,loops``: each case's waves beside its row, as a labelled data set.

``F.waves/part-NNNNNN.parquet`` has the columns of F.parquet, `LABELS` of the first fault and, of each relay,
``RA.samples`` (n x 6), ``RA.phasors`` (n x 14), ``RA.loops`` (n x 12), flattened row by row.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from faultloop.errors import InputError, nearest
from faultloop.io.messages import values
from faultloop.loop.recording import MemorySink
from faultloop.loop.scenario import Scenario
from faultloop.nodes.clock import SampleClock
from faultloop.study.campaign.draw import described
from faultloop.study.campaign.plan import Case, Plan
from faultloop.study.campaign.where import first_fault

TOLD = {
    "fault_type": "AG .. ABCG",
    "fault_line": "the line, null for a fault at a bus",
    "fault_bus": "the bus, null for a fault on a line",
    "fault_at_pu": "where on the line, of its length from its `from` end",
    "fault_resistance_ohm": "of each phase",
    "fault_ground_ohm": "from the fault's star point to ground",
}
LABELS: dict[str, pa.DataType] = {
    name: pa.float64() if name.endswith(("_pu", "_ohm")) else pa.string() for name in TOLD
}
"""Of a case's first fault, whether varied or not."""
WIDTHS = {"samples": 6, "phasors": 14, "loops": 12}
MOST_BYTES = 64 * 2**20
"""Of the waves of one part, about."""


class Kept(NamedTuple):
    """What is kept of a case, by column."""

    labels: dict[str, Any]
    waves: dict[str, np.ndarray]


class Waves:
    """What is kept of each case.

    Parameters
    ----------
    kinds : of ``samples``, ``phasors``, ``loops``.
    float64 : eight bytes a number in place of four.
    """

    def __init__(self, plan: Plan, kinds: Sequence[str], float64: bool = False) -> None:
        for kind in kinds:
            if kind not in WIDTHS:
                raise InputError(f"'{kind}' cannot be kept; {nearest(kind, WIDTHS)}", key="--keep")
        first = plan.first
        self.kinds = tuple(kind for kind in WIDTHS if kind in kinds)
        self.dtype = np.dtype(np.float64 if float64 else np.float32)
        self.relays = tuple(place.name for place in first.scenario.relay)
        self.rows = _rows(first)
        self.alike = not any(
            key in ("scenario.duration_s", "system.sampling_hz") for key in plan.draws.changing()
        )

    @property
    def case_bytes(self) -> int:
        """Of one case, about."""
        numbers = self.rows * sum(WIDTHS[kind] for kind in self.kinds) * len(self.relays)
        return numbers * self.dtype.itemsize

    def schema(self, rows: pa.Schema) -> pa.Schema:
        """Of a part: the rows' columns, the labels, then the waves."""
        for name, type_ in LABELS.items():
            rows = rows.append(pa.field(name, type_))
        number = pa.from_numpy_dtype(self.dtype)
        for relay in self.relays:
            for kind in self.kinds:
                width = self.rows * WIDTHS[kind] if self.alike else -1
                rows = rows.append(pa.field(f"{relay}.{kind}", pa.list_(number, width)))
        return rows

    def of(self, scenario: Scenario, memory: MemorySink) -> Kept:
        """A case's labels and waves, by column; the waves flattened."""
        waves = {
            f"{relay}.{kind}": values(memory.array(relay, kind)).astype(self.dtype).ravel()
            for relay in self.relays
            for kind in self.kinds
        }
        return Kept(labels_of(scenario), waves)

    def table(self, rows: pa.Table, kept: Sequence[Kept | None]) -> pa.Table:
        """A part's; a failed case has none."""
        schema = self.schema(rows.schema)
        columns = [*rows.columns]
        for field in list(schema)[len(columns) :]:
            if field.name in LABELS:
                own = [None if case is None else case.labels.get(field.name) for case in kept]
                columns.append(pa.array(own, field.type))
            else:
                own = [None if case is None else case.waves[field.name] for case in kept]
                columns.append(_column(field.type, own))
        return pa.table(columns, schema=schema)

    def card(self, plan: Plan, versions: Mapping[str, str], out: Path) -> str:
        """What a data set's user asks first."""
        head = plan.tables.campaign
        rows = self.rows if self.alike else "n"
        names = [(f"{relay}.{kind}", WIDTHS[kind]) for relay in self.relays for kind in self.kinds]
        return CARD.format(
            name=head.name,
            cases=plan.cases,
            sampling=head.sampling,
            seed=head.seed,
            varied="\n".join(
                f"- `{'`, `'.join(vary.all_keys)}`: {described(vary)}" for vary in plan.tables.vary
            ),
            labels="\n".join(f"- `{name}`: {told}" for name, told in TOLD.items()),
            columns="\n".join(f"- `{name}`: {rows} x {width} {self.dtype}" for name, width in names),
            out=out.name,
            waves=folder_of(out).name,
            first=names[0][0],
            width=names[0][1],
            versions=", ".join(f"{name} {version}" for name, version in versions.items()),
        )


CARD = """# {name}

{cases} simulated cases, {sampling} sampling, seed {seed}. Made with {versions}.

Varied:

{varied}

Each row of `{waves}/part-*.parquet` has the columns of `{out}` (what was varied, `fault_ns`: when the fault
began, what each relay did, the verdict), then of the first fault, varied or not,

{labels}

(null without a fault), and, row by row:

{columns}

Samples are va vb vc ia ib ic (V and A, primary, instantaneous), phasors va_re va_im .. ic_re ic_im
frequency_hz rocof_hz_per_s (RMS), loops ag_r ag_x .. ca_r ca_x (ohm, primary; NaN where not defined).

    table = pyarrow.parquet.read_table("{waves}", columns=["{first}"])
    waves = table["{first}"].combine_chunks().flatten().to_numpy().reshape(len(table), -1, {width})

Simulated by faultloop, not measured. The simulator's licence (Apache-2.0) says nothing of what it makes.
"""


def labels_of(scenario: Scenario) -> dict[str, Any]:
    """Of a case, by column."""
    fault = first_fault(scenario)
    if fault is None:
        return {}
    line = next((line for line in scenario.line if line.name == fault.line), None)
    return {
        "fault_type": fault.type,
        "fault_line": fault.line,
        "fault_bus": fault.bus,
        "fault_at_pu": None if line is None else fault.position(line),
        "fault_resistance_ohm": fault.resistance_ohm,
        "fault_ground_ohm": fault.ground_ohm,
    }


def folder_of(out: Path) -> Path:
    """Where the waves of a campaign's file are."""
    return out.with_suffix(".waves")


def _rows(case: Case) -> int:
    system = case.scenario.system
    return SampleClock(system.sampling_hz).first_from(round(case.scenario.scenario.duration_s * 1e9))


def _column(type_: pa.DataType, kept: Sequence[np.ndarray | None]) -> pa.Array:
    fixed = pa.types.is_fixed_size_list(type_)
    size = type_.list_size if fixed else 0
    missing = np.array([case is None for case in kept])
    if fixed:
        empty = np.zeros(size, type_.value_type.to_pandas_dtype())
        flat = np.concatenate([empty if case is None else case for case in kept])
        return pa.FixedSizeListArray.from_arrays(
            pa.array(flat), type=type_, mask=pa.array(missing) if missing.any() else None
        )
    return pa.array(kept, type_)
