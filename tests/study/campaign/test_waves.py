"""A labelled data set: the waves that `run` gives, beside their labels; and the same on a cluster."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

import faultloop
from faultloop.cli import call
from faultloop.config.toml_text import toml_text
from faultloop.io.messages import values
from faultloop.study.campaign.waves import LABELS, labels_of

Tables = dict[str, Any]


def made(folder: Path, tables: Tables) -> faultloop.Campaign:
    return faultloop.Campaign.from_dict(tables, path=folder / "campaign.toml")


def test_waves_are_those_of_run(folder: Path, tables: Tables) -> None:
    """In three lines as one array; float64 to the bit, float32 its nearest."""
    tables["vary"][1]["values"] = ["AG"]
    campaign, out = made(folder, tables), folder / "x.parquet"
    campaign.run(out, keep=["loops", "samples"], float64=True)
    table = pq.read_table(folder / "x.waves")
    own = ["RA.samples", "RA.loops", "RB.samples", "RB.loops"]
    assert table.column_names == [*pq.read_schema(out).names, *LABELS, *own]
    assert table["fault_at_pu"].to_pylist() == [0.2, 0.6, 0.97]
    assert set(table["fault_type"].to_pylist()) == {"AG"}
    assert set(table["fault_resistance_ohm"].to_pylist()) == {1.0}  # not varied, and yet a label
    assert table["case"].to_pylist() == [0, 1, 2]
    kept = {
        name: table[name].combine_chunks().flatten().to_numpy().reshape(len(table), -1, width)
        for name, width in (("RA.samples", 6), ("RB.loops", 12))
    }
    for case in range(3):
        result = faultloop.run(campaign.case(case).scenario)
        assert np.array_equal(kept["RA.samples"][case], values(result.samples("RA")))
        assert np.array_equal(kept["RB.loops"][case], values(result.loops("RB")), equal_nan=True)
    small = folder / "y.parquet"
    campaign.run(small, keep=["samples"])
    table = pq.read_table(folder / "y.waves")
    single = table["RA.samples"].combine_chunks().flatten().to_numpy()
    assert single.dtype == np.float32
    assert np.array_equal(single.reshape(3, -1, 6), kept["RA.samples"].astype(np.float32))
    assert small.read_bytes() == out.read_bytes()  # what is kept changes no row
    card = (folder / "y.waves.md").read_text(encoding="utf-8")
    assert "fault.F1.at_pu" in card
    assert "960 x 6 float32" in card


def test_failed_and_unequal_cases(folder: Path, tables: Tables) -> None:
    """No waves where a case failed; lists of their own length where the duration is varied."""
    tables["vary"] = [
        {"key": "fault.F1.after_s", "values": [0.05, 0.15]},
        {"key": "scenario.duration_s", "values": [0.2, 0.12]},
    ]
    tables["judge"] = []
    made(folder, tables).run(folder / "x.parquet", keep=["samples"])
    waves = pq.read_table(folder / "x.waves")["RA.samples"].to_pylist()
    assert [None if wave is None else len(wave) // 6 for wave in waves] == [960, 576, 960, None]


def test_stopped_and_gone_on_with(folder: Path, tables: Tables) -> None:
    campaign, out, whole = made(folder, tables), folder / "x.parquet", folder / "whole.parquet"

    def stop(done: int, cases: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        campaign.run(out, keep=["samples"], progress=stop)
    with pytest.raises(faultloop.InputError, match="another campaign"):
        campaign.run(out, keep=["phasors"])
    campaign.run(out, keep=["samples"])
    campaign.run(whole, keep=["samples"])
    assert pq.read_table(folder / "x.waves").equals(pq.read_table(folder / "whole.waves"))
    with pytest.raises(faultloop.InputError, match="is there, but waves are not"):
        bare = folder / "bare.parquet"
        campaign.run(bare)
        campaign.run(bare, keep=["samples"])


def test_waves_of_another_campaign(folder: Path, tables: Tables) -> None:
    """They do not get among those of this one; what a kill has left half-made is away."""
    out, waves = folder / "x.parquet", folder / "x.waves"
    made(folder, tables).run(out, keep=["samples"])
    out.unlink()
    tables["vary"][0]["values"] = [0.3, 0.4]
    with pytest.raises(faultloop.InputError, match="holds waves of another campaign"):
        made(folder, tables).run(out, keep=["samples"])
    shutil.rmtree(waves)
    waves.mkdir()
    (waves / "part-000001.parquet.89abcdef.tmp").write_bytes(b"half")
    made(folder, tables).run(out, keep=["samples"])
    assert len(pq.read_table(waves)) == 4
    (waves / "part-000002.parquet").unlink()
    with pytest.raises(faultloop.InputError, match="waves are of 3 of 4 cases only"):
        made(folder, tables).run(out, keep=["samples"])
    out.unlink()
    made(folder, tables).run(out, keep=["samples"])
    assert len(pq.read_table(waves)) == 4


def test_labels_of_the_first_fault(folder: Path, tables: Tables) -> None:
    """By time, on a line or at a bus; none without one."""
    case = made(folder, tables).case(0)
    fault = case.scenario.fault[0]
    later = fault.model_copy(update={"start_s": 0.15, "after_s": None, "type": "BC"})
    first = {"line": None, "at_pu": None, "bus": "B", "type": "ABCG", "start_s": 0.01, "ground_ohm": 2.0}
    at_the_bus = fault.model_copy(update=first)
    scenario = case.scenario.model_copy(update={"fault": (later, at_the_bus)})
    assert labels_of(scenario) == {
        "fault_type": "ABCG", "fault_line": None, "fault_bus": "B", "fault_at_pu": None,
        "fault_resistance_ohm": 1.0, "fault_ground_ohm": 2.0,
    }  # fmt: skip
    assert labels_of(case.scenario.model_copy(update={"fault": ()})) == {}


def test_what_cannot_be_kept(folder: Path, tables: Tables, capsys: pytest.CaptureFixture[str]) -> None:
    path = folder / "campaign.toml"
    path.write_text(toml_text(tables), encoding="utf-8")
    assert call(["campaign", str(path), "--out", str(folder / "x.parquet"), "--keep", "sample"]) == 2
    assert "did you mean 'samples'" in capsys.readouterr().err


def test_on_a_cluster(folder: Path, tables: Tables) -> None:
    """The same bytes; and one line where there is no cluster."""
    distributed = pytest.importorskip("distributed")
    campaign, alone, there = made(folder, tables), folder / "a.parquet", folder / "b.parquet"
    campaign.run(alone, keep=["samples"])
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        summary = campaign.run(there, scheduler=cluster.scheduler_address, keep=["samples"])
    assert summary.new == 6
    assert there.read_bytes() == alone.read_bytes()
    assert pq.read_table(folder / "b.waves").equals(pq.read_table(folder / "a.waves"))
    (folder / "b.parquet").unlink()
    for address in ("tcp://127.0.0.1:1", "nonsense"):
        with pytest.raises(faultloop.InputError, match="no cluster at"):
            campaign.run(there, scheduler=address)
