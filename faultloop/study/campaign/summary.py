"""What came of a campaign."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pyarrow.parquet as pq
from pydantic import ConfigDict, with_config

Progress = Callable[[int, int], None]
"""Called with the number of cases done, and of all."""


@with_config(ConfigDict(use_attribute_docstrings=True))
@dataclass(frozen=True)
class Summary:
    """What came of a campaign."""

    out: Path
    """The file of its cases."""
    cases: int
    """All of them."""
    right: int
    """Cases judged right."""
    wrong: int
    """Cases judged wrong."""
    unjudged: int
    """Cases that no judge applied to, or that could not be run."""
    errors: int
    """Cases that could not be run."""
    new: int
    """Cases that were run now; the others were there."""
    first_error: str | None = None
    """The first case that could not be run, and why."""


def summary_of(out: Path, new: int) -> Summary:
    """Of a campaign's whole file, of which `new` cases were run now."""
    counts: Counter[str] = Counter()
    failures, first = 0, None
    with pq.ParquetFile(out) as file:
        for batch in file.iter_batches(columns=["case", "verdict", "error"]):
            counts.update(batch["verdict"].to_pylist())
            failures += len(batch) - batch["error"].null_count
            if failures and first is None:
                row = batch.filter(batch["error"].is_valid()).slice(0, 1).to_pylist()[0]
                first = f"case {row['case']}: {row['error']}"
    right, wrong, unjudged = (counts[name] for name in ("right", "wrong", "unjudged"))
    return Summary(out, counts.total(), right, wrong, unjudged, failures, new, first)
