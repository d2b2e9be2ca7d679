"""The voltage in front of a capacitive transformer by the inverse of its circuit: against closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from faultloop.config.cvt_circuit import chosen_circuit
from faultloop.errors import InputError
from faultloop.relay import Relay, RelaySettings
from faultloop.relay.cvt import STATE, inverse, restore
from tests.measured import Measured

RATE, F0 = 4800, 50
OMEGA = 2 * math.pi * F0
CIRCUITS = ("P1", "P2", "A1", "A2")
BEFORE = 24 * 96
ZEROS = np.zeros(3)


def behind(circuit: str, frequency_hz: float, angle: float, left: float, samples: int) -> np.ndarray:
    """What a transformer gives of cos(w t + angle) until t = 0, and of ``left`` times it from then on.

    By partial fractions of its circuit, as the plant's does not: the closed form at every sample, (n,)."""
    over, under = chosen_circuit(circuit, None, F0).transfer(OMEGA)  # type: ignore[arg-type]
    poles = under.roots().astype(complex)
    residues = over(poles) / under.deriv()(poles)
    w = 2 * math.pi * frequency_hz
    t = (np.arange(samples) - BEFORE) / RATE
    u = np.exp(1j * angle)
    p, r = OMEGA * poles, OMEGA * residues
    h = (r / (1j * w - p)).sum()
    whole = u * h * np.exp(1j * w * t)
    after = left * whole
    for pk, rk in zip(p, r, strict=True):
        after = after + (1 - left) * u * rk / (1j * w - pk) * np.exp(pk * np.maximum(t, 0.0))
        # the part of the conjugate input, whose poles are the conjugate ones, is in the real part
    return np.real(np.where(t < 0, whole, after))


def restored(circuit: str, y: np.ndarray, noise: float = 0.0) -> np.ndarray:
    """(n,) of phase B, where the others have none."""
    c, s = inverse(chosen_circuit(circuit, None, F0).transfer(OMEGA), RATE, F0), np.zeros(STATE)  # type: ignore[arg-type]
    x = np.zeros((len(y), 6))
    x[:, 1] = y + noise * np.random.default_rng(1).standard_normal(len(y))
    x[:, 4] = y
    out = np.empty_like(x)
    for row, given in zip(x, out, strict=True):
        restore(c, s, row, given)
    np.testing.assert_array_equal(out[:, 4], y)  # a current is none of its business
    np.testing.assert_array_equal(out[:, [0, 2]], 0.0)
    return out[:, 1]


@pytest.mark.parametrize("circuit", CIRCUITS)
@pytest.mark.parametrize(("angle", "left"), [(-math.pi / 2, 0.0), (0.0, 0.0), (1.0, 0.03), (2.5, 0.5)])
@pytest.mark.parametrize("frequency_hz", [50.0, 48.0])
def test_a_voltage_that_falls_is_restored(
    circuit: str, angle: float, left: float, frequency_hz: float, measured: Measured
) -> None:
    """To 1 % of the crest from 2 ms on, for a tenth of a second: behind the circuit up to 35 % are left."""
    n = BEFORE + 480
    t = (np.arange(n) - BEFORE) / RATE
    true = np.cos(2 * math.pi * frequency_hz * t + angle) * np.where(t < 0, 1.0, left)
    found = restored(circuit, behind(circuit, frequency_hz, angle, left, n))
    later = slice(BEFORE + 10, None)
    measured("error", 100 * np.abs(found - true)[later].max(), "% of the crest")
    assert np.abs(found - true)[later].max() < 0.01
    assert np.abs(found - true)[BEFORE - 480 : BEFORE - 1].max() < 0.01


@pytest.mark.parametrize("circuit", CIRCUITS)
def test_noise_and_an_offset_do_not_drift_away(circuit: str) -> None:
    """Two integrators follow each other in the inverse: ten seconds with 0.1 % of noise and of an offset, of
    which it would make 28 to 140 times the crest."""
    n = 10 * RATE
    y = behind(circuit, 50.0, 0.3, 1.0, n) + 0.001
    y[BEFORE:] = np.tile(y[BEFORE - 96 : BEFORE], n // 96)[: n - BEFORE]
    found = restored(circuit, y, 0.001)
    cycles = found[: n // 96 * 96].reshape(-1, 96)[400:]
    assert np.abs(cycles.mean(axis=1)).max() < 0.02
    phasor = 2 * (cycles * np.exp(-2j * np.pi * np.arange(96) / 96)).mean(axis=1)
    assert np.ptp(np.abs(phasor)) < 0.02


def test_a_missing_sample_stays_missing() -> None:
    y = behind("A1", 50.0, 0.3, 1.0, BEFORE)
    y[1000] = np.nan
    found = restored("A1", y)
    assert np.isnan(found[1000])
    assert np.isfinite(found[1001:]).all()
    assert np.abs(found[1300:] - np.cos(OMEGA * (np.arange(1300, BEFORE) - BEFORE) / RATE + 0.3)).max() < 0.05


GOOD: dict[str, Any] = {
    "relay": {"frequency_hz": 50},
    "line": {"z1_ohm": [3.0, 30.0], "z0_ohm": [12.0, 90.0]},
    "pdis": [{"zone": 1, "reach_pu": 0.8}],
}


@pytest.mark.parametrize(
    ("vt", "key", "what"),
    [
        (
            {"kind": "cvt"},
            "vt",
            'kind = "cvt" needs circuit = "P1" | "P2" | "A1" | "A2" or a table of its own',
        ),
        ({"kind": "ideal", "circuit": "A1"}, "vt", 'circuit and burden_va belong to kind = "cvt"'),
        ({"burden_va": 25.0}, "vt", 'circuit and burden_va belong to kind = "cvt"'),
        (
            {"kind": "cvt", "circuit": "A1", "burden_va": -1.0},
            "vt.burden_va",
            "input should be greater than or equal to 0, not -1.0",
        ),
        (
            {"kind": "cvt", "circuit": {"ce_nf": 1.0, "lc_h": 10.0, "rf_ohm": 3e6}},
            "vt.circuit",
            "passes 0.33 of the voltage at 103 degrees at 50 Hz; a tuned circuit passes 1.00 at 0: see ce_nf"
            ", lc_h and burden_va",
        ),
        ({"kind": "cvt", "circuit": {"ce_nf": 100.0}}, "vt.circuit.rf_ohm", "missing; it has no default"),
    ],
)
def test_wrong_input(vt: dict[str, Any], key: str, what: str) -> None:
    with pytest.raises(InputError) as error:
        RelaySettings.from_dict(GOOD | {"vt": vt})
    assert (error.value.key, error.value.what) == (key, what)


@pytest.mark.parametrize("method", ["kalman-bank", "fourier"])
def test_a_relay_goes_back_to_what_it_saved(method: str) -> None:
    """Blocks and checkpoints make no difference, with an inverse in the estimator and in the decision."""
    data = GOOD | {"vt": {"kind": "cvt", "circuit": "A2"}, "estimator": {"method": method}}
    t = np.arange(2400)[:, None] / RATE
    wave = np.cos(OMEGA * t - np.array([0, 2, 4]) * math.pi / 3)
    x = np.hstack([1e5 * wave * np.where(t < 0.3, 1.0, 0.2), 300 * wave * np.where(t < 0.3, 1.0, 8.0)])
    whole, parts = Relay(RelaySettings.from_dict(data)), Relay(RelaySettings.from_dict(data))

    def words(relay: Relay, samples: np.ndarray, block: int) -> np.ndarray:
        rows, done = [], 0
        while done < len(samples):
            m = relay.advance(samples[done : done + block])
            rows.append(np.column_stack([relay.phasors, relay.pickup, relay.operate]))
            done += m
        return np.concatenate(rows)

    first = words(whole, x, 10**6)
    np.testing.assert_array_equal(words(parts, x[:1000], 7), first[:1000])
    saved = parts.save()
    np.testing.assert_array_equal(words(parts, x[1000:], 31), first[1000:])
    parts.restore(saved)
    np.testing.assert_array_equal(words(parts, x[1000:], 960), first[1000:])
