"""Real faults: what the real relays said."""

from __future__ import annotations

import warnings
from pathlib import Path

import comtrade
import numpy as np
import pytest

from faultloop.relay import Relay, RelaySettings, load_settings
from tests.measured import Measured
from tests.relay.network import play


def analog(folder: Path, name: str, encoding: str = "utf-8") -> np.ndarray:
    record = comtrade.Comtrade()
    cfg = next(p for p in folder.iterdir() if p.name.lower() == f"{name}.cfg")
    dat = next(p for p in folder.iterdir() if p.name.lower() == f"{name}.dat")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        record.load(str(cfg), str(dat), encoding=encoding)
    return np.array(record.analog, np.float64)


def settings_file(root: Path, name: str) -> RelaySettings:
    return load_settings(root / "scenarios" / "settings" / f"{name}.toml")


def test_sel311l_c_g(records: Path, root: Path, measured: Measured) -> None:
    """The relay's own answer: C-G, location 0.84; in its file Z2G picks up and Z1G does not."""
    x = analog(records / "sel311l-c-g", "1991-ascii-sel")
    samples = np.sqrt(2) * np.column_stack([*(1e3 * x[5:8]), *x[0:3]])
    relay = Relay(settings_file(root, "sel311l-c-g"))
    events = play(relay, samples)
    starts = {e.text.split()[0]: e for e in events if " Str" in e.text and "reset" not in e.text}
    zone_2_ground = f"PDIS{[(z.zone, z.loops) for z in relay.settings.pdis].index((2, 'ground')) + 1}"
    assert set(starts) == {zone_2_ground, "PTOC1", "PTOC2"}
    for stage, known_s in (("PTOC1", 0.0531), ("PTOC2", 0.0615)):  # 51G and 67P1
        assert starts[stage].sample_count / 960 == pytest.approx(known_s, abs=0.002)
    assert starts[zone_2_ground].text.endswith("CG forward")
    assert starts[zone_2_ground].sample_count / 960 == pytest.approx(0.074, abs=0.008)
    measured("error of the location 0.84", abs(relay.fault_location - 0.84), "of the line")
    assert relay.fault_location == pytest.approx(0.84, abs=0.02)


@pytest.mark.parametrize("method", ["fourier", "adaptive-kalman"])
def test_b_g_500kv_reclose(records: Path, root: Path, method: str) -> None:
    """Circuit II trips phase B once, not in the dead time nor at the reclosing; circuit I does not."""
    x = analog(records / "b-g-500kv-reclose", "cfg_file", "gbk")[:, :6300]  # the first 5000 Hz stretch
    given = settings_file(root, "b-g-500kv-reclose")
    settings = given.model_copy(update={"estimator": given.estimator.model_copy(update={"method": method})})
    ratio = np.array([5000.0] * 3 + [1250.0] * 3)
    relay = Relay(settings)
    events = play(relay, np.column_stack([*x[4:7], *x[12:15]]) * ratio)
    trips = [e for e in events if e.trip]
    assert [(t.trip.loop, t.trip.poles, t.trip.zone) for t in trips] == [("BG", 2, 1)]
    assert 0.100 < trips[0].sample_count / 5000 < 0.140
    healthy = play(Relay(settings), np.column_stack([*x[0:3], *x[8:11]]) * ratio)
    assert not any(e.trip for e in healthy)


def test_transformer_inrush(records: Path, root: Path) -> None:
    """Currents only: nothing without voltages, and nothing with a healthy bus beside them at any angle."""
    x = analog(records / "transformer-inrush", "transformer_inrush", "cp1251")
    currents = 100.0 * x[0:3].T
    settings = settings_file(root, "transformer-inrush")
    events = play(Relay(settings), np.column_stack([np.zeros_like(currents), currents]))
    causes = [e.text.removeprefix("LPHD1 not ready, zones blocked: ") for e in events]
    assert causes == ["no voltage", "current flows, and there is no voltage"]
    t = np.arange(len(currents)) / 2400
    for angle in range(0, 360, 45):
        phase = 2 * np.pi * 50 * t[:, None] + np.radians(angle - np.array([0, 120, 240]))
        volts = 110e3 * np.sqrt(2 / 3) * np.cos(phase)
        assert not play(Relay(settings), np.column_stack([volts, currents]))


def test_breaker_failure_30kv(records: Path) -> None:
    """An earth fault that the record begins with; its relay trips its breaker at 0.980 and, 160 ms later, the
    breakers around: pole A goes on carrying current, although 52b says open at 1.028, until 1.183."""
    hz = 1200
    samples = np.ascontiguousarray(analog(records / "breaker-failure-30kv", "nor-t2_osc1")[:6].T)
    given = {
        "relay": {"frequency_hz": 50, "sampling_hz": hz, "nominal_kv": 30},
        "estimator": {"method": "fourier"},
        "line": {"z1_ohm": [1.0, 3.0], "z0_ohm": [2.0, 8.0]},
        "ptoc": [{"quantity": "residual", "pickup_a": 300.0, "delay_ms": 960.0}],
        "rbrf": {"current_a": 300.0, "retrip_ms": 100.0, "backup_ms": 160.0},
    }
    relay = Relay(RelaySettings.from_dict(given))
    bit, done = relay.bits.index("RBRF1"), 0
    events, flows = [], np.empty(len(samples), np.bool_)
    while done < len(samples):
        if done > 1.0283 * hz:  # as the auxiliary contact has it
            relay.inputs = relay.inputs._replace(breaker_closed=0)
        m = relay.advance(samples[done:])
        flows[done : done + m] = (relay.pickup >> np.uint64(bit)) & np.uint64(1)
        events += relay.events
        done += m
    (tripped,) = [e.sample_count for e in events if e.trip]
    assert tripped / hz == pytest.approx(0.980, abs=0.02)
    (failed,) = [e for e in events if "OpEx: current" in e.text]
    assert failed.text == "RBRF1 OpEx: current of pole A still flows: breaker failure"
    assert (failed.sample_count - tripped) / hz == pytest.approx(0.160, abs=2 / hz)
    last_zero, off = 1.1833, (np.flatnonzero(flows)[-1] + 1) / hz
    assert 0 < off - last_zero <= 0.015
