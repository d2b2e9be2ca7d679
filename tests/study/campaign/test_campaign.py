"""A campaign: its rows against `run`, the file that they make, stopped and gone on with."""

from __future__ import annotations

import json
import math
import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import faultloop
from faultloop.cli import call
from faultloop.config.toml_text import toml_text
from faultloop.loop import case as kept_cases
from faultloop.study.campaign.parts import PartFiles, Parts
from faultloop.study.campaign.record import fingerprint, record_of
from faultloop.study.campaign.run import Job
from faultloop.study.campaign.table import schema_of

Tables = dict[str, Any]
PER_RELAY = ["tripped", "function", "zone", "loop", "poles", "decided_ns", "received_ns", "opened_ns"]
PER_RELAY += ["location_pu", "trips"]


def made(folder: Path, tables: Tables) -> faultloop.Campaign:
    return faultloop.Campaign.from_dict(tables, path=folder / "campaign.toml")


def written(folder: Path, tables: Tables) -> Path:
    path = folder / "campaign.toml"
    path.write_text(toml_text(tables), encoding="utf-8")
    return path


def test_rows_are_what_run_says(folder: Path, tables: Tables) -> None:
    """Each case by `run` with overrides, equal to the nanosecond and the bit."""
    out = folder / "out" / "x.parquet"
    summary = made(folder, tables).run(out)
    table = pq.read_table(out)
    columns = ["case", "fault.F1.at_pu", "fault.F1.type", "fault_ns"]
    columns += [f"{relay}.{name}" for relay in ("RA", "RB") for name in PER_RELAY]
    assert table.column_names == [*columns, "verdict", "reason", "error"]
    rows = table.to_pylist()
    assert [row["case"] for row in rows] == list(range(6))
    for row in rows:
        overrides = [f"{key}={row[key]}" for key in ("fault.F1.at_pu", "fault.F1.type")]
        result = faultloop.run(folder / "base.toml", overrides=overrides, keep=False)
        assert row["fault_ns"] == result.fault_start_ns
        for relay in ("RA", "RB"):
            own = [trip for trip in result.trips if trip.relay == relay]
            assert row[f"{relay}.trips"] == len(own)
            assert row[f"{relay}.tripped"] == bool(own)
            first = own[0] if own else None
            for column, name in {
                "function": "function", "zone": "zone", "loop": "loop", "poles": "pole_names",
                "decided_ns": "t_ns", "received_ns": "received_ns", "opened_ns": "opened_ns",
            }.items():  # fmt: skip
                assert row[f"{relay}.{column}"] == getattr(first, name, None)
            location = result.fault_locations[relay]
            assert row[f"{relay}.location_pu"] == (location if math.isfinite(location) else None)
        assert row["error"] is None
    verdicts = [row["verdict"] for row in rows]
    # Zone 1 of RA reaches 0.85: a fault at 0.97 is for zone 2, which comes after the run's end.
    assert verdicts == ["right"] * 4 + ["wrong"] * 2
    assert rows[4]["reason"].startswith("RA: trip expected for a fault inside: ")
    assert (summary.cases, summary.right, summary.wrong, summary.new) == (6, 4, 2, 6)
    assert not (folder / "out" / "x.parquet.parts").exists()


def test_the_file_carries_everything(folder: Path, tables: Tables) -> None:
    """The case again, when scenario, settings and campaign are gone."""
    tables["vary"].append({"key": "relay.RA.pdis.1.reach_pu", "values": [0.5, 0.85]})
    out = folder / "x.parquet"
    made(folder, tables).run(out)
    record = json.loads(pq.read_schema(out).metadata[b"faultloop"])
    assert record["campaign"]["campaign"]["name"] == "small"
    assert record["settings"]["settings/ab-mho.toml"]["text"].startswith("# Distance relay")
    assert record["versions"]["faultloop"]
    (folder / "base.toml").unlink()
    (folder / "settings" / "ab-mho.toml").unlink()
    rows = pq.read_table(out).to_pylist()
    case = next(row["case"] for row in rows if row["fault.F1.at_pu"] == 0.6 and not row["RA.tripped"])
    log = folder / "case.mcap"
    assert call(["campaign-case", str(out), str(case), "--log", str(log)]) == 0
    attached = faultloop.open_log(log).attachments
    assert any("reach_pu = 0.5" in str(text) for text in attached.values())


def test_workers_and_stops_change_nothing(folder: Path, tables: Tables) -> None:
    """One worker, two, and one that was stopped with parts that are missing or broken: the same bytes."""
    alone, pair, pieces = folder / "a.parquet", folder / "b.parquet", folder / "c.parquet"
    campaign = made(folder, tables)
    campaign.run(alone)
    campaign.run(pair, workers=2)
    assert alone.read_bytes() == pair.read_bytes()

    class Stop(Exception):
        pass

    def stop(done: int, cases: int) -> None:
        if done == 3:
            raise Stop

    with pytest.raises(Stop):
        campaign.run(pieces, progress=stop)
    parts = sorted(Path(f"{pieces}.parts").glob("part-*.parquet"))
    assert 2 <= len(parts) <= 3
    assert not pieces.exists()
    parts[0].write_bytes(parts[0].read_bytes()[:100])
    seen: list[int] = []
    summary = campaign.run(pieces, progress=lambda done, cases: seen.append(done))
    assert seen[0] == len(parts) - 1
    assert summary.new == 6 - (len(parts) - 1)
    assert pieces.read_bytes() == alone.read_bytes()
    assert campaign.run(pieces).new == 0  # nothing left to do


def test_another_campaign_is_not_mixed_in(folder: Path, tables: Tables) -> None:
    out = folder / "x.parquet"
    made(folder, tables).run(out)
    before = out.read_bytes()
    tables["campaign"]["seed"] = 2
    with pytest.raises(faultloop.InputError, match="another campaign"):
        made(folder, tables).run(out)
    assert out.read_bytes() == before
    out.unlink()
    parts = Parts(out, 6, "somebody else's")
    with pytest.raises(faultloop.InputError, match="another campaign is writing"):
        made(folder, tables).run(out)
    parts.close()
    with pytest.raises(faultloop.InputError, match="holds parts of another campaign"):
        made(folder, tables).run(out)
    for content in (b"", b"no Parquet"):
        out.write_bytes(content)
        with pytest.raises(faultloop.InputError, match="not a Parquet file"):
            made(folder, tables).run(out)
    pq.write_table(pa.table({"x": [1]}), out)
    with pytest.raises(faultloop.InputError, match="not of a campaign"):
        made(folder, tables).run(out)


def test_a_failed_case_is_a_row(folder: Path, tables: Tables) -> None:
    """Impossible together, though each end by itself is possible; and a user's element that fails."""
    tables["vary"] = [
        {"key": "fault.F1.resistance_ohm", "values": [0.0, 5.0]},
        {"key": "fault.F1.after_s", "values": [0.05, 0.15]},
        {"key": "scenario.duration_s", "values": [0.2, 0.12]},
    ]
    tables["judge"] = [{"relay": "RA", "trip": True}]
    out = folder / "x.parquet"
    summary = made(folder, tables).run(out)
    rows = pq.read_table(out).to_pylist()
    failures = [row for row in rows if row["error"]]
    assert summary.errors == len(failures) == 2
    for row in failures:
        assert (row["fault.F1.after_s"], row["scenario.duration_s"]) == (0.15, 0.12)
        assert "is not before the end of the run" in row["error"]
        assert row["verdict"] == "unjudged"
        assert row["RA.tripped"] is None
        assert row["fault_ns"] is None


def test_the_first_case_may_be_impossible(folder: Path, tables: Tables) -> None:
    """It is a row as any other; and no value of it is impossible by itself."""
    tables["vary"] = [
        {"key": "fault.F1.after_s", "values": [0.15, 0.05]},
        {"key": "scenario.duration_s", "values": [0.12, 0.2]},
    ]
    tables["judge"] = [{"relay": "RA", "trip": True, "zone": 1}]
    out = folder / "x.parquet"
    summary = made(folder, tables).run(out, keep=["samples"])
    assert (summary.cases, summary.errors) == (4, 1)
    assert [row["error"] is None for row in pq.read_table(out).to_pylist()] == [False, True, True, True]


def test_random_cases_can_be_made_alone(folder: Path, tables: Tables) -> None:
    tables["campaign"] |= {"sampling": "random", "cases": 4, "seed": 9}
    tables["vary"] = [
        {"key": "fault.F1.at_pu", "uniform": [0.1, 0.9]},
        {"key": "fault.F1.resistance_ohm", "log_uniform": [0.1, 10], "factor": {"fault.F1.ground_ohm": 2}},
    ]
    tables["only"] = [{"when": "fault.F1.at_pu < 0.5"}]
    campaign = made(folder, tables)
    out = folder / "x.parquet"
    campaign.run(out)
    rows = pq.read_table(out).to_pylist()
    for row in reversed(rows):
        values = campaign.case(row["case"]).values
        assert values == {key: row[key] for key in values}
        assert 0.1 <= values["fault.F1.at_pu"] < 0.5
        assert values["fault.F1.ground_ohm"] == 2 * values["fault.F1.resistance_ohm"]
    more = made(folder, tables | {"campaign": tables["campaign"] | {"cases": 50}})
    assert more.case(3).values == campaign.case(3).values  # the number of cases changes none of them


def test_command(folder: Path, tables: Tables, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = written(folder, tables), folder / "x.parquet"
    assert call(["check", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["kind"] == "campaign"
    assert told["cases"] == 6
    assert not out.exists()
    assert call(["campaign", str(path), "--out", str(out), "--workers", "1", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["cases"], told["wrong"], told["new"]) == (6, 2, 6)
    assert call(["campaign", str(path), "--out", str(out)]) == 0
    assert "6 cases, 0 of them run now: 4 right, 2 wrong" in capsys.readouterr().out
    assert call(["campaign-case", str(out), "5", "--log", str(folder / "c.mcap"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["differences"] == []
    assert told["row"]["case"] == 5
    assert call(["campaign-case", str(out), "6", "--log", str(folder / "d.mcap")]) == 2
    assert "0 to 5" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize(
    "number", [signal.SIGKILL, signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)]
)
def test_stopped_by_a_signal(folder: Path, tables: Tables, number: signal.Signals) -> None:
    tables["vary"].append({"key": "fault.F1.resistance_ohm", "range": [0, 5, 20]})
    path, out, whole = written(folder, tables), folder / "x.parquet", folder / "whole.parquet"
    command = [sys.executable, "-m", "faultloop", "campaign", str(path), "--workers", "1", "--out"]
    process = subprocess.Popen([*command, str(out)], stderr=subprocess.PIPE, text=True)
    parts = Path(f"{out}.parts")
    for _ in range(12_000):
        if len(list(parts.glob("part-*.parquet"))) > 1 or process.poll() is not None:
            break
        time.sleep(0.01)
    os.kill(process.pid, number)
    err = process.communicate(timeout=60)[1]
    if number != signal.SIGKILL:
        assert process.returncode == 130
        assert "goes on from" in err
    assert not out.exists()
    assert 0 < made(folder, tables).run(out).new < 120
    made(folder, tables).run(whole)
    assert out.read_bytes() == whole.read_bytes()


def test_a_worker_that_dies(folder: Path, tables: Tables, monkeypatch: pytest.MonkeyPatch) -> None:
    """One line, nothing lost."""
    code = "import os, signal\ndef step(state, x, out):\n    os.kill(os.getpid(), signal.SIGKILL)\n"
    (folder / "settings" / "dies.py").write_text(code, encoding="utf-8")
    with (folder / "settings" / "ab-mho.toml").open("a", encoding="utf-8") as file:
        file.write('\n[[element]]\nname = "DIES"\nfunction = "dies.py:step"\nstate = [0.0]\n')
    out = folder / "x.parquet"
    with pytest.raises(faultloop.InputError, match="a worker died"):
        made(folder, tables).run(out, workers=2)
    with pytest.raises(faultloop.InputError, match="user code was refused"):
        faultloop.Campaign.from_dict(tables, path=folder / "c.toml", user_code=False)


def test_a_full_disk(folder: Path, tables: Tables, monkeypatch: pytest.MonkeyPatch) -> None:
    """What was finished is kept, and said to be."""
    out = folder / "x.parquet"
    real, written_parts = pq.write_table, []

    def full(table: pa.Table, path: Path, **options: Any) -> None:
        if len(written_parts) == 2:
            Path(path).write_bytes(b"half")
            raise OSError(28, "No space left on device")
        written_parts.append(path)
        real(table, path, **options)

    monkeypatch.setattr(pq, "write_table", full)
    with pytest.raises(faultloop.InputError, match=r"No space left on device.*are kept"):
        made(folder, tables).run(out)
    assert sorted(p.name for p in Path(f"{out}.parts").glob("part*")) == [
        "part-000000.parquet",
        "part-000001.parquet",
    ]
    monkeypatch.undo()
    assert made(folder, tables).run(out).new == 4


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """One of 256 kB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(folder)]
    if sys.platform != "linux" or os.getuid() or subprocess.run(mount, check=False).returncode:
        pytest.skip("only root can mount")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


@pytest.mark.parametrize("workers", ["1", pytest.param("2", marks=pytest.mark.slow)])
@pytest.mark.parametrize("left", [0, 5_000, 30_000, 60_000])
def test_a_disk_that_is_really_full(
    folder: Path,
    tables: Tables,
    small_disk: Path,
    left: int,
    workers: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """One line whenever it is full: at the first byte, at a part, at the whole file; then gone on with."""
    path, out, whole = written(folder, tables), small_disk / "x.parquet", folder / "whole.parquet"
    ballast = small_disk / "ballast"
    ballast.write_bytes(bytes(256 * 1024 - left))
    arguments = ["campaign", str(path), "--out", str(out), "--workers", workers, "--keep", "samples"]
    assert call(arguments) == 2
    _, err = capsys.readouterr()
    assert err.count("\n") == 1
    assert "No space left on device" in err
    assert not out.exists()
    kept = len(list(Path(f"{out}.parts").glob("part-*.parquet")))
    ballast.unlink()
    subprocess.run(["mount", "-o", "remount,size=8m", str(small_disk)], check=True)
    assert call([*arguments, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["new"] == 6 - kept
    made(folder, tables).run(whole)
    assert out.read_bytes() == whole.read_bytes()
    assert not list(small_disk.rglob("*.tmp"))


def test_a_folder_that_cannot_be_written(
    folder: Path, tables: Tables, small_disk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Read-only for root, too: one line, and nothing there."""
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    path = written(folder, tables)
    assert call(["campaign", str(path), "--out", str(small_disk / "x.parquet"), "--workers", "1"]) == 2
    _, err = capsys.readouterr()
    assert err.count("\n") == 1
    assert "Read-only file system" in err


def test_what_a_kill_has_left(folder: Path, tables: Tables) -> None:
    """Half-made files go; parts beside a whole file, too; a damaged part is told."""
    out = folder / "x.parquet"
    campaign = made(folder, tables)
    parts = Parts(out, 6, fingerprint(record_of(campaign.plan)))
    stray = [parts.folder / "part-000003.parquet.0123abcd.tmp", folder / "x.parquet.0123abcd.tmp"]
    for path in stray:
        path.write_bytes(b"half")
    parts.close()
    campaign.run(out)
    assert not any(path.exists() for path in stray)
    parts = Parts(out, 6, fingerprint(record_of(campaign.plan)))
    parts.close()
    assert campaign.run(out).new == 0
    assert not parts.folder.exists()
    out.unlink()

    def damage(done: int, cases: int) -> None:
        if done == 3:
            part = parts.folder / "part-000001.parquet"
            data = part.read_bytes()
            part.write_bytes(b"PAR1" + bytes(400) + data[404:])

    with pytest.raises(faultloop.InputError, match=r"part-000001.*is damaged; delete it"):
        campaign.run(out, progress=damage)
    assert not out.exists()
    (parts.folder / "part-000001.parquet").unlink()
    assert campaign.run(out).new == 1


def test_relays_are_not_kept_for_ever(folder: Path, tables: Tables, monkeypatch: pytest.MonkeyPatch) -> None:
    """With settings of its own each case has relays of its own; those with the same ones are together."""
    tables["vary"] = [
        {"key": "fault.F1.type", "values": ["AG", "BC"]},
        {"key": "relay.RA.pdis.1.reach_pu", "values": [0.5, 0.6, 0.7]},
    ]
    plan = made(folder, tables).plan
    schema = schema_of(plan, ["RA", "RB"])
    job = pickle.loads(pickle.dumps(Job(plan, schema, PartFiles(folder, None, ""), 6)))
    monkeypatch.setattr(kept_cases, "KEPT_RELAYS", 3)
    used: list[Any] = []
    for number, values in job._batch(0):
        row, _ = job._case(number, values)
        assert "error" not in row
        used.append(job._cases)
    assert [used.index(cases) for cases in used] == [0, 0, 0, 3, 3, 5]  # RA of 0.5, RB, RA of 0.6: three
    assert [case for case, _ in job._batch(0)] == [0, 3, 1, 4, 2, 5]


HEAD = {"name": "x", "scenario": "base.toml", "sampling": "grid"}
WRONG = [
    ({"vary": [{"key": "fault.F9.at_pu", "values": [0.5]}]}, "no fault 'F9'"),
    ({"vary": [{"key": "fault.F1.at_pux", "values": [0.5]}]}, "did you mean 'at_pu'"),
    ({"vary": [{"key": "relay.RX.pdis.1.reach_pu", "values": [0.5]}]}, "there is no relay 'RX'"),
    ({"vary": [{"key": "relay.RA.pdis.9.reach_pu", "values": [0.5]}]}, "no pdis '9'"),
    ({"vary": [{"key": "relay.RA.pdis.1.reach", "values": [0.5]}]}, "did you mean 'reach_"),
    ({"vary": [{"key": "relay.RA.pids.reach_pu", "values": [0.5]}]}, "did you mean 'pdis'"),
    ({"vary": [{"key": "fault", "values": [0.5]}]}, "table.key"),
    ({"vary": []}, "vary"),
    ({"vary": [{"key": "fault.F1.at_pu", "values": []}]}, "at least 1"),
    ({"vary": [{"key": "fault.F1.at_pu", "values": [0.5, 1.5]}]}, "fault.F1.at_pu = 1.5 is impossible"),
    ({"vary": [{"key": "fault.F1.at_pu", "range": [-0.1, 0.5, 3]}]}, "fault.F1.at_pu = -0.1 is impossible"),
    (
        {"vary": [{"key": "fault.F1.type", "values": ["AG"]}, {"key": "fault.F1.at_p", "values": [0.5]}]},
        "vary[1]: fault[F1].at_p: fault.F1.at_p = 0.5 is impossible: unknown key; did you mean 'at_pu'?",
    ),
    ({"vary": [{"key": "fault.F1.at_pu", "range": [0.5, 0.6, 0]}]}, "count"),
    ({"vary": [{"key": "fault.F1.at_pu", "uniform": [0.1, 0.5]}]}, "a grid takes values or range"),
    ({"vary": [{"key": "fault.F1.at_pu", "values": [0.5], "range": [0, 1, 2]}]}, "give one of"),
    ({"vary": [{"key": "fault.F1.at_pu"}]}, "give one of"),
    ({"vary": [{"key": "fault.F1.at_pu", "keys": ["fault.F1.x"], "values": [1]}]}, "either key or keys"),
    ({"vary": [{"values": [1]}]}, "either key or keys"),
    ({"vary": [{"key": "fault.F1.type", "values": ["AG"], "factor": {"fault.F1.at_pu": 2}}]}, "factor"),
    ({"vary": [{"key": "fault.F1.at_pu", "values": [0.5]}] * 2}, "varied twice"),
    ({"campaign": HEAD | {"cases": 3}}, "cases cannot stand"),
    ({"campaign": HEAD | {"sampling": "random"}}, "needs cases"),
    ({"campaign": HEAD | {"sampling": "halton", "cases": 3}}, "sampling"),
    ({"campaign": HEAD | {"scenario": "none.toml"}}, "no such file"),
    ({"campaign": HEAD | {"scenario": "."}}, "is a folder"),
    ({"only": [{"when": "fault.F1.at_pu > 2"}]}, "there are no cases"),
    ({"only": [{"when": "fault.F1.at > 2"}]}, "not a varied key"),
    ({"judge": [{"relay": "RX", "trip": True}]}, "there is no relay 'RX'"),
    ({"judge": [{"relay": "RA", "trip": True, "where": "behind"}]}, "can never apply"),
    ({"judge": [{"relay": "RA", "trip": False, "where": "none"}]}, "can never apply"),
    ({"judge": [{"relay": "RA", "trip": True, "where": "inside", "function": "PDIS9"}]}, "PDIS9"),
    ({"judge": [{"relay": "RA", "trip": False, "loop": "AG"}]}, "cannot stand with trip = false"),
    ({"judge": [{"relay": "RA", "trip": True, "zone": 9}]}, "no zone 9; known: 1, 2, 3, 4"),
    ({"judge": [{"relay": "RA", "trip": True, "within_ms": 20, "after_ms": 50}]}, "can never hold"),
    ({"judged": []}, "did you mean 'judge'"),
    ({"vary": [{"key": "relay.RA.estimator.method", "values": ["furier"]}]}, "did you mean 'fourier'"),
    ({"vary": [{"key": "relay.RA.settings", "values": ["settings/no.toml"]}]}, "no.toml: no such file"),
    ({"vary": [{"key": f"fault.F1.{key}", "range": [0.1, 0.9, 99999]} for key in ("at_pu", "ground_ohm")]},
     "at most 100000000"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "words"), WRONG)
def test_wrong_campaigns(
    folder: Path, tables: Tables, change: Tables, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line, status 2, and nothing is begun."""
    path = written(folder, tables | change)
    before = set(folder.rglob("*"))
    assert call(["campaign", str(path), "--out", str(folder / "x.parquet"), "--workers", "1"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert words in err
    assert "--set" not in err
    assert set(folder.rglob("*")) == before


@pytest.mark.parametrize("value", ["x.csv", "folder.parquet", "file/x.parquet"])
def test_a_file_that_cannot_be(folder: Path, tables: Tables, value: str) -> None:
    (folder / "folder.parquet").mkdir()
    (folder / "file").write_text("mine", encoding="utf-8")
    with pytest.raises(faultloop.InputError):
        made(folder, tables).run(folder / value)
