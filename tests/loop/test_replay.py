"""Recorded faults played into the relay."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import faultloop
from faultloop.cli import call
from faultloop.errors import InputError
from faultloop.loop.replay import replay
from tests.measured import Measured

SETTINGS = Path(__file__).resolve().parents[2] / "scenarios" / "settings"
AG = Path(__file__).resolve().parents[2] / "scenarios" / "ag-zone1.toml"
SEL = ",".join(  # peak = RMS in this record
    f"{slot}={place}*1.41421356"
    for slot, place in zip(("va", "vb", "vc", "ia", "ib", "ic"), (5, 6, 7, 0, 1, 2), strict=True)
)


def test_sel_311l_with_its_own_settings(records: Path, measured: Measured) -> None:
    """A real C-G fault; its relay's .hdr says location 0.84, and the record's bits Z2G but not Z1G."""
    result = replay(
        records / "sel311l-c-g" / "1991-ascii-sel.cfg", SETTINGS / "sel311l-c-g.toml", mapping=SEL
    )
    measured("error of the location 0.84", abs(result.fault_location - 0.84), "of the line")
    assert result.fault_location == pytest.approx(0.84, abs=0.02)
    assert "PHS1.CG" in result.first_pickup_ns
    assert "PDIS4" in result.first_pickup_ns  # zone 2 ground; the real one at 0.0740 s
    assert result.first_pickup_ns["PDIS4"] / 1e9 == pytest.approx(0.0740, abs=0.008)
    assert "PDIS2" not in result.first_pickup_ns  # zone 1 ground
    assert not {"PHS1.AG", "PHS1.BG"} & set(result.first_pickup_ns)


@pytest.mark.parametrize(("circuit", "first_v", "first_i"), [("II", 4, 12), ("I", 0, 8)])
def test_double_circuit_line(
    records: Path, circuit: str, first_v: int, first_i: int, measured: Measured
) -> None:
    """B-G on circuit II: its relay trips phase B; the relay of the healthy circuit I trips nothing."""
    mapping = ",".join(
        [f"v{p}={first_v + i}" for i, p in enumerate("abc")]
        + [f"i{p}={first_i + i}" for i, p in enumerate("abc")]
    )
    record = records / "b-g-500kv-reclose" / "cfg_file.CFG"
    result = replay(record, SETTINGS / "b-g-500kv-reclose.toml", mapping=mapping)
    if circuit == "I":
        assert not result.trips
    else:
        assert result.trips[0].poles == 2
        assert result.trips[0].loop == "BG"
        measured("trip after the fault at 0.100 s", result.trips[0].t_ns / 1e6 - 100, "ms")
        assert 0.100 < result.trips[0].t_ns / 1e9 < 0.140


def test_inrush_trips_nothing(records: Path) -> None:
    """Currents of both sides of the transformer; the record has no voltages."""
    record = records / "transformer-inrush" / "transformer_inrush.cfg"
    for first in (0, 3):
        mapping = ",".join(f"i{p}={first + i}" for i, p in enumerate("abc"))
        result = replay(record, SETTINGS / "transformer-inrush.toml", mapping=mapping)
        assert not result.trips
        assert not result.first_operate_ns
        assert np.nanmax(np.abs(result.samples()["ia"])) > 100  # it was there


def test_a_log_replays_to_the_same_decisions(tmp_path: Path) -> None:
    """The relay of a run, fed with its own samples, decides the same, though its past is another."""
    log = tmp_path / "run.mcap"
    settings = ["relay.RA.settings=settings/ab-mho.toml", "relay.RB.settings=settings/ab-mho.toml"]
    run = faultloop.run(AG, log=log, overrides=settings)
    again = tmp_path / "again.mcap"
    result = replay(log, SETTINGS / "ab-mho.toml", mapping="relay=RA", log=again)
    trip = next(t for t in run.trips if t.relay == "RA")
    assert result.trips[0].sample_count == trip.sample_count
    assert result.trips[0].loop == trip.loop
    ours, theirs = faultloop.open_log(again), faultloop.open_log(log)
    settled = slice(400, trip.sample_count)
    for column in ("va_re", "va_im", "ia_re", "ia_im"):
        a, b = ours.phasors("replay")[column][settled], theirs.phasors("RA")[column][settled]
        # A recursive estimator forgets its own start slowly: 3e-6 of a voltage after four cycles, which the
        # first samples of the fault make 5e-5 of a current.
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-4 * np.abs(b).max())
    assert (ours.elements("replay")["pickup"] == theirs.elements("RA")["pickup"])[settled].all()


def test_comtrade_of_a_run_replays_to_the_same_trip(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    run = faultloop.run(AG, log=log)
    assert call(["export", str(log), "--comtrade", str(tmp_path / "run.cff"), "--relay", "RA"]) == 0
    result = replay(tmp_path / "run.cff", SETTINGS / "ab-mho.toml")
    trip = next(t for t in run.trips if t.relay == "RA")
    assert result.trips[0].sample_count == trip.sample_count
    assert result.fault_location == pytest.approx(0.4, abs=0.01)


def test_replay_command(tmp_path: Path, records: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record = records / "sel311l-c-g" / "1991-ascii-sel.cfg"
    arguments = ["replay", str(record), "--settings", str(SETTINGS / "sel311l-c-g.toml"), "--map", SEL]
    log = tmp_path / "replay.mcap"
    assert call([*arguments, "--log", str(log), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["fault_location_pu"] == pytest.approx(0.84, abs=0.02)
    opened = faultloop.open_log(log)
    assert opened.relays == ("replay",)
    assert len(opened.samples("replay")) == round(data["duration_s"] * 960)
    assert np.isfinite(opened.samples("replay")["ic"]).all()


@pytest.mark.parametrize(
    ("mapping", "words"),
    [("relay=RX", "no relay 'RX'"), ("va=0", "relay=NAME"), (None, "which relay")],
)
def test_wrong_mapping_of_a_log(tmp_path: Path, mapping: str | None, words: str) -> None:
    log = tmp_path / "run.mcap"
    faultloop.run(AG, log=log, overrides=["scenario.duration_s=0.15"])
    with pytest.raises(InputError, match=words):
        replay(log, SETTINGS / "ab-kalman.toml", mapping=mapping)


def test_another_rate_is_refused(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    faultloop.run(AG, log=log, overrides=["scenario.duration_s=0.15"])
    settings = tmp_path / "r.toml"
    text = (SETTINGS / "ab-kalman.toml").read_text(encoding="utf-8")
    settings.write_text(text.replace("sampling_hz = 4800", "sampling_hz = 4000"), encoding="utf-8")
    with pytest.raises(InputError, match="was sampled at 4800"):
        replay(log, settings, mapping="relay=RA")


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("x.cfg", None, "no such file|cannot be read|not found"),
        ("x.cfg", "", "x.cfg"),
        ("x.cfg", "a,b,1999\n6,6A,0D\n", "x.cfg"),
        ("x.cff", "nonsense", "x.cff"),
    ],
)
def test_wrong_records(tmp_path: Path, name: str, content: str | None, words: str) -> None:
    if content is not None:
        (tmp_path / name).write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=words):
        replay(tmp_path / name, SETTINGS / "ab-kalman.toml")
