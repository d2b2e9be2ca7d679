"""A campaign on an authenticated bus: its keys are in no file that it writes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

import faultloop
from faultloop.cli import call
from faultloop.config.toml_text import toml_text

KEY = "000102030405060708090a0b0c0d0e0f"


def test_keys_are_asked_for(folder: Path, tables: dict[str, Any], capsys: pytest.CaptureFixture[str]) -> None:
    base = folder / "base.toml"
    can = '\n[can]\nfd = true\nkeys = "bus-keys.toml"\n'
    base.write_text(base.read_text(encoding="utf-8") + can, encoding="utf-8")
    keys, out = folder / "bus-keys.toml", folder / "x.parquet"
    tables["vary"] = [{"key": "fault.F1.at_pu", "values": [0.4]}]
    tables["judge"] = [{"relay": "RA", "trip": True}]
    (folder / "c.toml").write_text(toml_text(tables), encoding="utf-8")
    assert call(["campaign", str(folder / "c.toml"), "--out", str(out)]) == 2
    assert "bus-keys.toml: cannot be read: No such file" in capsys.readouterr().err
    assert not Path(f"{out}.parts").exists()
    keys.write_text(f'default = "{KEY}"\n', encoding="utf-8")
    assert call(["check", str(folder / "c.toml")]) == 2
    assert "others than its owner may use it" in capsys.readouterr().err
    keys.chmod(0o600)
    campaign = faultloop.Campaign.from_dict(tables, path=folder / "c.toml")
    assert campaign.run(out).right == 1
    assert KEY.encode() not in out.read_bytes()
    assert KEY not in pq.read_schema(out).metadata[b"faultloop"].decode()
    moved = keys.rename(folder / "elsewhere.toml")
    again = ["campaign-case", str(out), "0", "--log", str(folder / "case.mcap")]
    assert call(again) == 2
    assert "--keys: the case's bus is authenticated with 'bus-keys.toml'" in capsys.readouterr().err
    assert call([*again, "--keys", str(moved)]) == 0
    assert KEY not in str(faultloop.open_log(folder / "case.mcap").attachments)
    assert call(["campaign-report", str(out)]) == 0  # needs none
    moved.write_text(f'default = "{KEY[::-1]}"\n', encoding="utf-8")
    capsys.readouterr()
    assert call([*again, "--keys", str(moved)]) == 2
    assert "is not 'bus-keys.toml' as the campaign had it" in capsys.readouterr().err
    keys.write_text(f'default = "{KEY[::-1]}"\n', encoding="utf-8")
    keys.chmod(0o600)
    with pytest.raises(faultloop.InputError, match="another campaign, or of one that was changed"):
        campaign.run(out)
