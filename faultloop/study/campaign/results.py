"""A campaign's file, opened: its columns as arrays, and what they say of each relay."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from faultloop.errors import InputError
from faultloop.study.campaign.parts import read_record
from faultloop.study.campaign.record import plan_of
from faultloop.study.campaign.table import RELAY_COLUMNS

Array = NDArray[np.float64]


class Results:
    """All rows of a campaign.

    Attributes
    ----------
    keys : the varied keys.
    relays : names, in the scenario's order.
    settings : of each relay, in the first case.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.record = read_record(path)
        with tempfile.TemporaryDirectory(prefix="faultloop-report-") as folder:
            plan = plan_of(self.record, Path(folder), path)
            case = plan.case(0)
        self.keys = plan.keys
        self._draws = [vary.all_keys for vary in plan.tables.vary]
        self.scenario, self.settings = case.scenario, case.settings
        self.relays = [place.name for place in case.scenario.relay]
        self.table = pq.read_table(path)
        needed = [f"{relay}.{name}" for relay in self.relays for name in RELAY_COLUMNS]
        missing = [name for name in (*self.keys, *needed, "verdict") if name not in self.table.column_names]
        if missing:
            raise InputError(f"has no column '{missing[0]}'", file=path)
        self.verdict = self.column("verdict").astype(str)
        self._at: dict[str, float] = {}

    def __len__(self) -> int:
        return len(self.table)

    @property
    def name(self) -> str:
        return str(self.record["campaign"]["campaign"]["name"])

    def column(self, name: str) -> NDArray[Any]:
        """As NumPy has it: objects where there are texts or nulls in whole numbers."""
        return self.table[name].to_numpy()

    def numbers(self, name: str) -> Array:
        """As float64; NaN for null."""
        return self.table[name].cast("float64").to_numpy().astype(np.float64)

    def first_key(self, *endings: str) -> str | None:
        """The first varied key with numbers that ends like this."""
        own = (key for key in self.keys if key.endswith(endings) and _is_number(self.table[key].type))
        return next(own, None)

    def varied_keys(self) -> list[str]:
        """Those with more than one value, one for each draw."""
        first = [keys[0] for keys in self._draws]
        return [key for key in first if len(self.table[key].unique()) > 1]

    def operate_ms(self, relay: str) -> Array:
        """From the fault's start to the breaker's receiving the trip; NaN without."""
        return (self.numbers(f"{relay}.received_ns") - self.numbers("fault_ns")) / 1e6

    def wrong_of(self, relay: str) -> NDArray[np.bool_]:
        """The cases that are wrong by what this relay did."""
        own = [(reason or "").startswith(f"{relay}: ") for reason in self.table["reason"].to_pylist()]
        return np.array(own, dtype=bool) & (self.verdict == "wrong")

    def limits_ms(self, relay: str) -> list[float]:
        """Within which times the judges want a trip of it."""
        judges = [judge for judge in self.record["campaign"].get("judge", ()) if judge["relay"] == relay]
        return sorted({float(judge["within_ms"]) for judge in judges if judge.get("within_ms") is not None})

    def shot_ohm(self, relay: str) -> NDArray[np.complex128] | None:
        """Where the fault's loop would be without infeed [ohm, primary]; None where its place is not on the
        relay's line."""
        place = next(place for place in self.scenario.relay if place.name == relay)
        faults = self.scenario.fault
        if not faults or faults[0].line != place.line:
            return None
        fault, settings = faults[0], self.settings[relay]
        line = next(line for line in self.scenario.line if line.name == place.line)
        x = self._fault_value(fault, "at_pu")
        if fault.at_pu is None:
            x = self._fault_value(fault, "at_km") / line.length_km
        x = x if place.end == "from" else 1 - x
        phase, ground = (self._fault_value(fault, key) for key in ("resistance_ohm", "ground_ohm"))
        types = self._fault_value(fault, "type")
        single = np.array([len(str(kind)) == 2 and str(kind).endswith("G") for kind in types])
        k0 = settings.residual_compensation_factor
        # A ground loop divides by Ia + k0 3I0 = (1 + k0) Ia; between two phases half the sum of both remains.
        return x * settings.z1_ohm + np.where(single, (phase + ground) / (1 + k0), phase)

    def _fault_value(self, fault: Any, name: str) -> Any:
        for key in (f"fault.{fault.name}.{name}", f"fault.0.{name}"):
            if key in self.keys:
                return self.column(key) if name == "type" else self.numbers(key)
        return np.full(len(self), getattr(fault, name))


def _is_number(type_: Any) -> bool:
    import pyarrow.types as kinds

    return kinds.is_floating(type_) or kinds.is_integer(type_)
