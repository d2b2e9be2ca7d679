"""A campaign's file, opened: the columns that a report needs, as arrays, and what they say of each relay."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from faultloop.errors import InputError
from faultloop.study.campaign.parts import read_record
from faultloop.study.campaign.record import plan_of

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
OF_RELAY = ("tripped", "function", "loop", "received_ns")
"""Columns of each relay that a report reads; the others stay in the file."""


class Results:
    """All rows of a campaign.  Texts are kept once each, so that a million rows are some hundred megabytes.

    Attributes
    ----------
    keys : the varied keys.
    relays : names, in the scenario's order.
    settings : of each relay, in the first case.
    judged, wrong : which cases are.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.record = read_record(path)
        with tempfile.TemporaryDirectory(prefix="faultloop-report-") as folder:
            plan = plan_of(self.record, Path(folder), path)
            case = plan.first
        self.keys, self.tables = plan.keys, plan.tables
        self.scenario, self.settings = case.scenario, case.settings
        self.relays = [place.name for place in case.scenario.relay]
        needed = ["case", *self.keys, "fault_ns", "verdict", "reason", "error"]
        needed += [f"{relay}.{name}" for relay in self.relays for name in OF_RELAY]
        self.table = _read(path, needed)
        self.judged, self.wrong = ~self.verdict("unjudged"), self.verdict("wrong")

    def __len__(self) -> int:
        return len(self.table)

    @property
    def name(self) -> str:
        return str(self.record["campaign"]["campaign"]["name"])

    def numbers(self, name: str) -> Array:
        """As float64; NaN for null."""
        return self.table[name].cast("float64").to_numpy().astype(np.float64)

    def texts(self, name: str) -> tuple[NDArray[np.int64], list[str]]:
        """Which text is in each row, -1 for none, and the texts."""
        own = self.table[name].combine_chunks()
        if not pa.types.is_dictionary(own.type):
            own = own.dictionary_encode()
        codes = own.indices.fill_null(-1).to_numpy().astype(np.int64)
        return codes, [str(text) for text in own.dictionary.to_pylist()]

    def are(self, name: str, text: str) -> Mask:
        """The rows with this text."""
        codes, texts = self.texts(name)
        return codes == (texts.index(text) if text in texts else -2)

    def words(self, name: str) -> NDArray[np.str_]:
        """Each row's text, empty for none."""
        codes, texts = self.texts(name)
        return np.array([*texts, ""])[codes]

    def verdict(self, name: str) -> Mask:
        """The rows that are ``right``, ``wrong`` or ``unjudged``."""
        return self.are("verdict", name)

    def tripped(self, relay: str) -> Mask:
        """The rows in which this relay did."""
        return self.table[f"{relay}.tripped"].fill_null(False).to_numpy()

    def reasons(self, pattern: str, name: str = "reason") -> Mask:
        """The rows with a reason (or an ``error``) in which this regular expression finds something."""
        codes, texts = self.texts(name)
        found = re.compile(pattern)
        return np.array([found.search(text) is not None for text in texts] + [False])[codes]

    def first_key(self, *endings: str) -> str | None:
        """The first varied key with numbers that ends like this."""
        own = (key for key in self.keys if key.endswith(endings) and self.is_number(key))
        return next(own, None)

    def is_number(self, name: str) -> bool:
        """Whether a column has numbers."""
        type_ = self.table[name].type
        return pa.types.is_floating(type_) or pa.types.is_integer(type_)

    def varied_keys(self) -> list[str]:
        """Those with more than one value, one for each draw."""
        return [vary.all_keys[0] for vary in self.tables.vary if self._varies(vary.all_keys[0])]

    def _varies(self, key: str) -> bool:
        values = self.numbers(key) if self.is_number(key) else self.texts(key)[0]
        return bool(len(values)) and bool(np.any(values != values[0]))

    def operate_ms(self, relay: str) -> Array:
        """From the fault's start to the breaker's receiving the trip; NaN without."""
        return (self.numbers(f"{relay}.received_ns") - self.numbers("fault_ns")) / 1e6

    def wrong_of(self, relay: str) -> Mask:
        """The cases that are wrong by what this relay did."""
        codes, texts = self.texts("reason")
        own = np.array([text.startswith(f"{relay}: ") for text in texts] + [False], dtype=bool)
        return own[codes] & self.wrong

    def limits_ms(self, relay: str) -> list[float]:
        """Within which times the judges want a trip of it."""
        own = (judge.within_ms for judge in self.tables.judge if judge.relay == relay)
        return sorted({float(limit) for limit in own if limit is not None})

    def shot_ohm(self, relay: str) -> NDArray[np.complex128] | None:
        """Where the fault's loop would be without infeed [ohm, primary]; NaN in a case whose fault is not on
        the relay's line, None where none is."""
        place = next(place for place in self.scenario.relay if place.name == relay)
        own = self.on_line(relay)
        if not own.any():
            return None
        fault, settings = self.scenario.fault[0], self.settings[relay]
        line = next(line for line in self.scenario.line if line.name == place.line)
        x = self._fault_numbers(fault, "at_pu")
        if fault.at_pu is None:
            x = self._fault_numbers(fault, "at_km") / line.length_km
        x = x if place.end == "from" else 1 - x
        phase, ground = (self._fault_numbers(fault, key) for key in ("resistance_ohm", "ground_ohm"))
        k0 = settings.residual_compensation_factor
        # A ground loop divides by Ia + k0 3I0 = (1 + k0) Ia; between two phases half the sum of both remains.
        single = self._is_single(fault)
        shot = x * settings.z1_ohm + np.where(single, (phase + ground) / (1 + k0), phase)
        return np.where(own, shot, np.nan).astype(np.complex128)

    def on_line(self, relay: str) -> Mask:
        """The cases whose first fault is on the relay's line."""
        place = next(place for place in self.scenario.relay if place.name == relay)
        if not self.scenario.fault:
            return np.zeros(len(self), bool)
        fault = self.scenario.fault[0]
        key = self._fault_key(fault, "line")
        return np.full(len(self), fault.line == place.line) if key is None else self.are(key, str(place.line))

    def _is_single(self, fault: Any) -> Mask:
        key = self._fault_key(fault, "type")
        codes, texts = (np.zeros(len(self), int), [fault.type]) if key is None else self.texts(key)
        return np.array([len(text) == 2 and text.endswith("G") for text in texts] + [False])[codes]

    def _fault_numbers(self, fault: Any, name: str) -> Array:
        key = self._fault_key(fault, name)
        return np.full(len(self), getattr(fault, name), np.float64) if key is None else self.numbers(key)

    def _fault_key(self, fault: Any, name: str) -> str | None:
        own = (f"fault.{fault.name}.{name}", f"fault.0.{name}")
        return next((key for key in own if key in self.keys), None)


def _read(path: Path, columns: Sequence[str]) -> pa.Table:
    schema = pq.read_schema(path)
    missing = [name for name in columns if name not in schema.names]
    if missing:
        raise InputError(f"has no column '{missing[0]}'", file=path)
    texts = [name for name in columns if pa.types.is_string(schema.field(name).type)]
    try:
        with pq.ParquetFile(path, read_dictionary=texts) as file:  # read_table would import pandas
            return file.read(columns=list(columns)).unify_dictionaries()
    except (OSError, pa.ArrowException) as error:
        raise InputError(f"is damaged ({' '.join(str(error).split())[:80]})", file=path) from None
