"""A grid of cases over one network, and its run: a campaign each, its rows with the place of every fault."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from faultloop.config.campaign import CampaignTables
from faultloop.config.tables import validate
from faultloop.config.toml_text import toml_text
from faultloop.errors import InputError
from faultloop.study.campaign.plan import Files, Plan
from faultloop.study.campaign.run import run_campaign
from faultloop.study.pool import pool_of
from faultloop.study.suites.distance.network import Network
from faultloop.study.suites.distance.rows import Rows

KEYS = {
    "at": "fault.F1.at_pu",
    "type": "fault.F1.type",
    "angle": "fault.F1.angle_deg",
    "resistance": "fault.F1.resistance_ohm",
}
"""Short names of what is varied; another name is a campaign's key itself."""
AT_THE_BUS = 1e-6
"""So far behind the current transformer a fault at bus A counts to be, per unit of the line."""
TYPES = ("AG", "BG", "CG", "AB", "BC", "CA", "ABG", "BCG", "CAG", "ABC", "ABCG")


@dataclass(frozen=True)
class Sweep:
    """One network, its relays' settings, and what is varied on it.

    Attributes
    ----------
    relays : settings by the relay's name.
    fault : its table; the line or bus says where.  None: there is no fault.
    vary : values by key or its short name, the last changing first.
    tags : what every row gets as further columns, the same in all of them.
    """

    network: Network
    relays: Mapping[str, Mapping[str, Any]]
    vary: Mapping[str, Sequence[Any]]
    fault: Mapping[str, Any] | None = field(default_factory=lambda: {"line": "AB", "at_pu": 0.5})
    tags: Mapping[str, Any] = field(default_factory=dict)

    @property
    def cases(self) -> int:
        """How many."""
        count = 1
        for values in self.vary.values():
            count *= len(values)
        return count

    def plan(self, name: str) -> Plan:
        """The campaign.  Raises InputError."""
        scenario = self.network.scenario({k: dict(v) for k, v in self.relays.items()}, self.fault)
        settings = {
            f"{relay}.toml": (Path(f"{relay}.toml"), toml_text(own), dict(own))
            for relay, own in self.relays.items()
        }
        vary = [{"key": KEYS.get(key, key), "values": list(values)} for key, values in self.vary.items()]
        head = {"name": name, "scenario": f"{name}.toml", "sampling": "grid"}
        tables = validate(CampaignTables, {"campaign": head, "vary": vary}, None)
        return Plan(tables, Files(Path(f"{name}.toml"), toml_text(scenario), scenario, settings))

    def rows(self, table: pa.Table) -> Rows:
        """Of the campaign's table.  Raises InputError where a case could not be run."""
        errors = [text for text in table["error"].to_pylist() if text is not None]
        if errors:
            raise InputError(f"a case could not be run: {errors[0]}", key="suite distance")
        columns = {name: table[KEYS.get(name, name)].to_numpy() for name in self.vary}
        columns |= {
            name: table[name].to_numpy(zero_copy_only=False) for name in table.column_names if "." in name
        }
        columns["fault_ns"] = table["fault_ns"].cast("float64").to_numpy()
        found = Rows(columns, len(table))
        own = self.network
        fixed = {"sir": own.sir, "length_km": own.length_km, "frequency_hz": own.frequency_hz} | dict(
            self.tags
        )
        return found.tagged(**fixed).tagged(depth=self.depth(found))

    def depth(self, rows: Rows) -> Any:
        """Where the fault is, from A along A - B, per unit of its length: negative behind, NaN for none."""
        if self.fault is None:
            return float("nan")
        bus = self.fault.get("bus")
        if bus is not None:
            return {"A": -AT_THE_BUS, "B": 1.0}[bus]
        at = rows["at"] if "at" in rows else self.fault["at_pu"]
        own = self.network
        return {
            "AB": lambda: at,
            "BC": lambda: 1.0 + at * own.beyond_km / own.length_km,
            "XA": lambda: (at - 1.0) * own.behind_km / own.length_km - AT_THE_BUS,
        }[self.fault["line"]]()


def run_sweep(sweep: Sweep, name: str, folder: Path, each: Callable[[int, int], None] | None = None) -> Path:
    """To a Parquet file in ``folder``; what is there is not run again."""
    out = folder / f"{name}.parquet"
    run_campaign(sweep.plan(name), out, 1, each)
    return out


def run_sweeps(
    sweeps: Mapping[str, Sweep], folder: Path, workers: int, progress: Callable[[float], Any]
) -> dict[str, pa.Table]:
    """All of them, a network at a time in each worker; ``progress`` gets the part done.  InputError."""
    total = sum(sweep.cases for sweep in sweeps.values()) or 1
    done = 0
    found: dict[str, Path] = {}
    if workers == 1:
        for name, sweep in sweeps.items():
            found[name] = run_sweep(
                sweep, name, folder, lambda n, _, before=done: progress((before + n) / total)
            )
            done += sweep.cases
    else:
        died = InputError("a worker died (killed, or out of memory); of the suite nothing is kept")
        with pool_of(workers, lambda: died) as pool:
            waiting = {
                pool.submit(run_sweep, sweep, name, folder): name
                for name, sweep in sorted(sweeps.items(), key=lambda item: -item[1].cases)
            }
            for future in as_completed(waiting):
                name = waiting[future]
                found[name] = future.result()
                done += sweeps[name].cases
                progress(done / total)
    return {name: pq.read_table(path) for name, path in found.items()}
