"""Low-pass, noise and converter between the primary values and the samples."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.plant import Plant
from tests.plant.record import record
from tests.plant.reference import BASE_KV, build, phasors

IDEAL, _ = record(Plant(build("rl")), 960)


@pytest.mark.parametrize("order", [2, 4])
def test_the_low_pass_is_settled_and_is_a_butterworth(order: int) -> None:
    """Of an analog Butterworth at 50 Hz: gain 1/sqrt(1 + (f/fc)^2n), phase from its poles."""
    cut_off = 150.0
    plant = Plant(build("rl", front_end={"antialias_hz": cut_off, "antialias_order": order}))
    x, _ = record(plant, 960)
    poles = np.exp(1j * np.pi * (2 * np.arange(1, order + 1) + order - 1) / (2 * order))
    gain = 1 / np.prod(1j * 50 / cut_off - poles)
    assert np.abs(phasors(x, 0, 4800) / phasors(IDEAL, 0, 4800) / gain - 1).max() < 1e-3
    assert np.abs(x[:96] - x[-96:]).max() < 1e-9 * np.abs(x).max()


def test_a_ramp_of_frequencies_is_cut() -> None:
    fault = {"name": "F", "line": "L", "at_pu": 0.5, "type": "AG", "start_s": 0.02}
    spectra = []
    for hz in (0.0, 600.0):
        x, _ = record(Plant(build("bergeron", fault=[fault], front_end={"antialias_hz": hz})), 300)
        spectra.append(np.abs(np.fft.rfft(np.hanning(192) * x[96:288, 0, 0]))[40:].sum())  # above 1 kHz
    assert spectra[1] < 0.4 * spectra[0]


def test_noise_has_its_size_no_colour_and_is_each_relays_own() -> None:
    settings = {"voltage_noise_v": 120.0, "current_noise_a": 3.0}
    x, _ = record(Plant(build("rl", front_end=settings)), 20_000)
    quiet, _ = record(Plant(build("rl")), 20_000)
    noise = (x - quiet).reshape(20_000, 12)
    assert noise.std(axis=0) == pytest.approx([120.0] * 3 + [3.0] * 3 + [120.0] * 3 + [3.0] * 3, rel=0.03)
    assert np.abs(noise.mean(axis=0) / noise.std(axis=0)).max() < 0.03
    z = noise / noise.std(axis=0)
    assert np.abs(z.T @ z / len(z) - np.eye(12)).max() < 0.03  # channels and relays
    assert np.abs((z[1:] * z[:-1]).mean(axis=0)).max() < 0.03  # one sample and the next
    assert np.abs((z**4).mean(axis=0) - 3).max() < 0.3  # normal
    other, _ = record(Plant(build("rl", front_end=settings, scenario={"seed": 2})), 100)
    assert not np.any(other == x[:100])


def test_the_converter_rounds_and_clips() -> None:
    settings = {"adc_bits": 8, "voltage_full_scale_v": 100e3, "current_full_scale_a": 200.0}
    x, _ = record(Plant(build("rl", front_end=settings)), 960)
    lsb = np.array([100e3 / 128] * 3 + [200.0 / 128] * 3)
    expected = np.clip(np.rint(IDEAL / lsb), -128, 127) * lsb
    assert np.abs(x - expected).max() < 1e-9 * 100e3
    assert x[..., 0].min() == -100e3 and x[..., 0].max() == 127 / 128 * 100e3


def test_voltage_full_scale_defaults_to_twice_the_crest() -> None:
    x, _ = record(Plant(build("rl", front_end={"adc_bits": 16, "current_full_scale_a": 1e4})), 96)
    codes = x[..., :3] / (2 * BASE_KV * 1e3 * np.sqrt(2 / 3) / 2**15)
    assert np.abs(codes - np.rint(codes)).max() < 1e-6


def test_a_relay_may_have_its_own() -> None:
    relays = [r | {"front_end": {"adc_bits": 4, "current_full_scale_a": 1e4}} for r in RELAYS[:1]] + RELAYS[
        1:
    ]
    x, _ = record(Plant(build("rl", relay=relays)), 960)
    assert len(np.unique(x[:, 0, 0])) <= 16
    assert np.array_equal(x[:, 1], IDEAL[:, 1])


RELAYS = [{"name": f"R{e}", "line": "L", "end": e, "settings": "none.toml"} for e in ("from", "to")]


def test_a_low_pass_above_the_plants_own_band_is_refused() -> None:
    with pytest.raises(InputError, match="too near half the plant's 19200 steps"):
        Plant(build("rl", front_end={"antialias_hz": 9000.0}))


def test_the_history_runs_into_the_first_samples() -> None:
    """Samples before sample 0 and from it on are one sinusoid, behind the low-pass too."""
    plant = Plant(build("rl", front_end={"antialias_hz": 900.0}))
    before = plant.history(96)
    plant.advance(96)
    whole = np.concatenate([before, plant.samples])[:, 0]
    t = 2 * np.pi * 50 * np.arange(-96, 96) / 4800
    basis = np.column_stack([np.cos(t), np.sin(t)])
    fitted = basis @ np.linalg.lstsq(basis, whole, rcond=None)[0]
    assert np.abs(whole - fitted).max() < 1e-6 * np.abs(whole).max()
