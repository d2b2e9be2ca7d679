"""`faultloop channels`: what is there, how it would be mapped, bay by bay."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from faultloop.cli import call

Capture = pytest.CaptureFixture[str]


def channels(path: Path, capsys: Capture) -> dict[str, Any]:
    assert call(["channels", str(path), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_record_of_one_line(records: Path, capsys: Capture) -> None:
    found = channels(records / "sel311l-c-g" / "1991-ascii-sel.cfg", capsys)
    assert [c["index"] for c in found["analog"]] == list(range(24))
    taken = {c["slot"]: c["index"] for c in found["analog"] if c["slot"]}
    assert taken == {"ia": 0, "ib": 1, "ic": 2, "va": 5, "vb": 6, "vc": 7}
    assert found["analog"][10]["why"] == "its unit is Hz"
    assert found["bays"] == [
        {
            "name": "",
            "channels": taken,
            "voltages": "of the same name",
            "map": "va=5,vb=6,vc=7,ia=0,ib=1,ic=2",
        }
    ]
    trip = next(d for d in found["digital"] if d["name"] == "51G")
    assert trip["first_change_s"] == pytest.approx(0.0531, abs=1e-3)


def test_bay_by_bay(records: Path, capsys: Capture) -> None:
    """As the records' README has them."""
    lines = channels(records / "b-g-500kv-reclose" / "cfg_file.CFG", capsys)
    assert [bay["map"] for bay in lines["bays"][:2]] == [
        "va=0,vb=1,vc=2,ia=8,ib=9,ic=10",
        "va=4,vb=5,vc=6,ia=12,ib=13,ic=14",
    ]
    assert lines["bays"][3]["map"] == "va=?,vb=?,vc=?,ia=36,ib=37,ic=38"
    assert lines["analog"][28]["why"] == "a sequence or residual quantity, by its name"  # phase field B
    assert "one of 6" in lines["analog"][0]["why"]
    swing = channels(records / "osc-swing-110kv" / "2.cfg", capsys)
    bay = next(bay for bay in swing["bays"] if bay["name"].endswith("ВЛ62"))
    assert bay["map"] == "va=4,vb=5,vc=6,ia=31,ib=32,ic=33"


def test_what_it_prints(shared: Path, records: Path, capsys: Capture) -> None:
    assert call(["channels", str(shared / "cases" / "comtrade-line-voltages" / "r.cfg")]) == 0
    out = capsys.readouterr().out
    assert "between two phases, by its name" in out and "va=-,vb=-,vc=-,ia=3,ib=4,ic=5" in out
    assert call(["channels", str(records / "formats" / "sample_float32.cff")]) == 0
    assert "test/bool1" in capsys.readouterr().out


def test_a_log_and_what_is_none(tmp_path: Path, root: Path, shared: Path, capsys: Capture) -> None:
    record = shared / "cases" / "comtrade-stop-zero" / "r.cfg"
    settings = str(root / "scenarios" / "settings" / "ab-mho.toml")
    assert call(["replay", str(record), "--settings", settings, "--log", str(tmp_path / "l.mcap")]) == 0
    capsys.readouterr()
    assert channels(tmp_path / "l.mcap", capsys)["relays"] == [{"name": "replay", "map": "relay=replay"}]
    assert call(["channels", str(tmp_path / "no.cfg")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_overrides_on_the_command_line(tmp_path: Path, root: Path, shared: Path, capsys: Capture) -> None:
    settings = str(root / "scenarios" / "settings" / "ab-mho.toml")
    record = str(shared / "cases" / "comtrade-stop-zero" / "r.cfg")
    base = ["replay", record, "--settings", settings, "--log", str(tmp_path / "l.mcap"), "--json"]
    assert call([*base, "--from", "0.1", "--to", "0.3"]) == 0
    assert json.loads(capsys.readouterr().out)["duration_s"] == pytest.approx(0.2, abs=1e-3)
    assert call([*base, "--unit", "v=kV", "--scale", "va=2", "--scale", "vb=2,vc=2", "--ct-ratio", "1"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert not data["tripped"] and not data["warnings"]
    for wrong, words in (
        (["--unit", "x=kV"], "--unit: 'x' is none of"),
        (["--unit", "va=hp"], "it must be in V or kV"),
        (["--scale", "va=x"], "--scale: va: 'x' is no number"),
        (["--vt-ratio", "-1"], "--vt-ratio: -1"),
        (["--from", "3"], "--from, --to: "),
        (["--map", "52a=no"], "52a: no digital channel 'no'"),
    ):
        assert call([*base, *wrong]) == 2
        err = capsys.readouterr().err
        assert words in err and err.count("\n") == 1
