"""Cases that were run: columns of what was varied, where the fault is, and what each relay did."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Times(NamedTuple):
    """Operate times of cases in which the relay had to operate [ms]; inf where it did not."""

    values: Array

    @property
    def missed(self) -> int:
        """Cases without operation."""
        return int((~np.isfinite(self.values)).sum())

    def at(self, part: float) -> float:
        """The time within which this part of the cases operated."""
        if not len(self.values):
            return float("nan")
        return float(np.quantile(self.values, part, method="inverted_cdf"))

    @property
    def figures(self) -> tuple[float, float, float, float]:
        """Minimum, median, 95 %, maximum."""
        return self.at(0.0), self.at(0.5), self.at(0.95), self.at(1.0)

    def within(self, ms: float) -> float:
        """The part that operated within it, in percent."""
        return 100.0 * float(np.mean(self.values <= ms)) if len(self.values) else float("nan")


class Rows:
    """Columns by name, all of one length.

    Besides what was varied and tagged: ``depth``, the fault's place per unit of the line (negative: behind),
    and of each relay R its campaign columns ``R.tripped``, ``R.loop``, ``R.received_ns``, ...
    """

    def __init__(self, columns: Mapping[str, Any], count: int) -> None:
        self._columns, self._count = dict(columns), count

    def __len__(self) -> int:
        return self._count

    def __contains__(self, name: str) -> bool:
        return name in self._columns

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self._columns[name]

    def tagged(self, **columns: Any) -> Rows:
        """With further columns; one value stands for all."""
        more = {
            name: np.asarray(value) if np.ndim(value) else np.full(self._count, value)
            for name, value in columns.items()
        }
        return Rows(self._columns | more, self._count)

    def pick(self, mask: Mask) -> Rows:
        """Those for which it is true."""
        return Rows({name: column[mask] for name, column in self._columns.items()}, int(mask.sum()))

    def only(self, **equal: Any) -> Rows:
        """Those whose columns have these values."""
        mask = np.ones(self._count, bool)
        for name, value in equal.items():
            mask &= self._columns[name] == value
        return self.pick(mask)

    def between(self, name: str, low: float, high: float) -> Rows:
        """Those whose column lies from ``low`` to ``high``, both included."""
        column = self._columns[name]
        return self.pick((column >= low - 1e-9) & (column <= high + 1e-9))

    def values(self, name: str) -> list[Any]:
        """What a column holds, each once, sorted."""
        return np.unique(self._columns[name]).tolist()

    def tripped(self, relay: str) -> Mask:
        return self._columns[f"{relay}.tripped"].astype(bool)

    def times(self, relay: str, since: str = "fault_ns", until: str = "received_ns") -> Times:
        """From the fault's start, or another column of instants, to the trip at the breaker [ms]."""
        end = self._columns[f"{relay}.{until}"].astype(np.float64)
        ms = (end - self._columns[since]) / 1e6
        return Times(np.where(np.isfinite(ms), ms, np.inf))

    @classmethod
    def joined(cls, parts: Iterable[Rows]) -> Rows:
        """All rows; columns that not every part has are left out."""
        parts = list(parts)
        names = set.intersection(*(set(part._columns) for part in parts))
        columns = {name: np.concatenate([part._columns[name] for part in parts]) for name in names}
        return cls(columns, sum(map(len, parts)))
