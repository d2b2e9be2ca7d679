"""docs/campaigns.md, executed: its Python on a small campaign's file and waves; and the shipped example."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

import faultloop
from faultloop.config.toml_text import toml_text
from tests.load import load

Tables = dict[str, Any]
ROOT = Path(__file__).resolve().parents[3]


def blocks() -> list[str]:
    text = (ROOT / "docs" / "campaigns.md").read_text(encoding="utf-8")
    return re.findall(r"```python\n(.*?)```", text, re.DOTALL)


def test_every_snippet(folder: Path, tables: Tables, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each that reads rows or waves is three lines, and says what the file says."""
    (folder / "campaigns").mkdir()
    tables["campaign"]["scenario"] = "../base.toml"
    (folder / "campaigns" / "position-and-sir.toml").write_text(toml_text(tables), encoding="utf-8")
    monkeypatch.chdir(folder)
    begun, pandas, polars, duckdb, waves, batches = blocks()
    said: dict[str, Any] = {}
    whole = np.empty(0)
    exec(begun.replace("workers=2", 'keep=["samples"]'), said)
    assert (said["summary"].right, said["summary"].wrong) == (4, 2)
    rows = pq.read_table("f.parquet").to_pylist()
    for code in (pandas, polars, duckdb, waves):
        assert len(ast.parse(code).body) == 3
        exec(code, said := {})
        if code is pandas:
            times = [(row["RA.received_ns"] - row["fault_ns"]) / 1e6 for row in rows if row["RA.tripped"]]
            assert min(times) <= said["ms"]["AG"] <= max(times)
        elif code is polars:
            assert sorted(said["wrong"].rows()) == [("AG", 1), ("BC", 1)]
        elif code is duckdb:
            counts = [
                (kind, verdict, n) for kind in ("AG", "BC") for verdict, n in (("right", 2), ("wrong", 1))
            ]
            assert sorted(said["rows"]) == counts
        else:
            assert said["waves"].shape == (6, 960, 6)
            whole = said["waves"]
    exec(batches, said)
    assert np.array_equal(said["samples"], whole[-len(said["samples"]) :])  # the last batch
    assert said["types"][-1] == rows[-1]["fault.F1.type"]


@pytest.mark.slow
def test_the_classifier(folder: Path) -> None:
    """The shipped example on a small data set: it learns, and tells what the relay's selection is worth."""
    data = faultloop.config.tables.read_toml(ROOT / "campaigns" / "fault-type.toml")[0]
    data["campaign"] |= {"cases": 120, "scenario": "base.toml"}
    out = folder / "fault-type.parquet"
    faultloop.Campaign.from_dict(data, path=folder / "c.toml").run(out, keep=["samples"])
    example = load("examples/fault_type.py")
    figures = example.main(str(out))
    assert figures["asked"] == 24
    assert figures["phases"] > 0.5  # of ten types; guessing gives a fifth at best
    assert figures["relay"] > 0.8
