"""Transients against closed forms: the offset of an R-L circuit, and waves on an open line."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.plant import Plant
from tests.measured import Measured
from tests.plant.record import now_ns, record
from tests.plant.reference import BASE_KV, KM, LINE, build

OMEGA = 2 * np.pi * 50


@pytest.mark.parametrize("angle", [0.0, 47.0, 90.0])
def test_fault_current_with_offset(angle: float, measured: Measured) -> None:
    """A bolted three-phase fault half-way along an R-L line behind an infinite bus."""
    source = {"name": "A", "bus": "A", "z1_ohm": [0.0, 1e-3], "z0_ohm": [0.0, 1e-3]}
    far = {"name": "B", "bus": "B", "angle_deg": -5, "z1_ohm": [3.0, 20.0], "z0_ohm": [3.0, 20.0]}
    fault = {"name": "F", "line": "L", "at_pu": 0.5, "type": "ABCG", "angle_deg": angle, "after_s": 0.02}
    plant = Plant(build("rl", source=[source, far], fault=[fault]))
    x, changes = record(plant, 2000)
    start = changes[0].t_ns * 1e-9
    r, l = LINE["r1"] * KM / 2, (LINE["x1"] * KM / 2 + 1e-3) / OMEGA
    z = r + 1j * OMEGA * l
    t = np.arange(len(x)) / 4800
    after = t >= start
    for phase in range(3):
        steady = BASE_KV * 1e3 * np.sqrt(2 / 3) / z * np.exp(1j * (OMEGA * t - 2 * np.pi / 3 * phase))
        before = x[~after, 0, 3 + phase]
        k = np.arange(len(before))
        fit = np.linalg.lstsq(
            np.stack([np.cos(OMEGA * k / 4800), np.sin(OMEGA * k / 4800)], axis=1), before, rcond=None
        )[0]
        initial = fit @ [np.cos(OMEGA * start), np.sin(OMEGA * start)]
        first = (steady[0] * np.exp(1j * OMEGA * start)).real
        exact = steady.real + (initial - first) * np.exp(-(t - start) * r / l)
        error = np.abs(x[after, 0, 3 + phase] - exact[after]).max() / np.abs(exact[after]).max()
        measured("error", 100 * error, "% of the peak")
        assert error < 1e-3, (phase, error)


def energized(length_km: float) -> tuple[np.ndarray, np.ndarray, int]:
    """A lossless line, open at B, cut off at A and closed again on an infinite bus: voltages at A's and B's
    line ends every step of 10 us, and the step of closing."""
    line = {"name": "L", "from": "A", "to": "B", "length_km": length_km, "model": "bergeron"}
    line |= {f"{k}_{'us' if k[0] == 'b' else 'ohm'}_per_km": v for k, v in LINE.items() if k[0] != "r"}
    line |= {"r1_ohm_per_km": 0.0, "r0_ohm_per_km": 0.0}
    plant = Plant(
        build(
            system={"sampling_hz": 100_000, "steps_per_sample": 1},
            source=[{"name": "A", "bus": "A", "z1_ohm": [0.0, 1e-4], "z0_ohm": [0.0, 1e-4]}],
            line=[line],
            breaker=[{"name": "Q", "line": "L", "end": "from", "operate_ms": 0.0, "close_ms": 13.0}],
            relay=[
                {"name": n, "line": "L", "end": end, "settings": "none.toml", "voltage_at": "line"}
                for n, end in (("RA", "from"), ("RB", "to"))
            ],
        )
    )
    plant.advance(1)
    plant.command("Q", "open", 7, 0)
    _, changes = record(plant, 3000)
    assert changes[-1].value == 0
    plant.command("Q", "close", 7, now_ns(plant))
    x, changes = record(plant, 2000)
    step = changes[0].t_ns // 10_000
    return x[:, 0, :3], x[:, 1, :3], step - 3001


def travel_steps(length_km: float) -> float:
    return length_km * np.sqrt(LINE["x1"] * LINE["b1"] * 1e-6) / OMEGA / 1e-5


@pytest.mark.parametrize("steps", [20.0, 20.4])
def test_reflection_at_the_open_end(steps: float, measured: Measured) -> None:
    near, far, closing = energized(100 * steps / travel_steps(100))
    surge = (
        near[closing + 1] - near[closing]
    )  # all poles at once: the aerial modes arrive first, twice as high
    surge -= surge.mean()
    drift = 0.01 * np.abs(surge).max()  # the trapped voltage and the 50 Hz move a little
    last_quiet, arrived = closing + int(np.floor(steps)) - 1, closing + int(np.ceil(steps)) + 2
    assert np.abs(far[last_quiet] - far[closing]).max() < drift
    rise = far[arrived] - far[last_quiet]
    assert np.abs(rise - rise.mean() - 2 * surge).max() < 3 * drift
    # the moment of arrival: where the sum over the front would sit if it were a step (closing acts
    # right after its step, so the first changed sample is the next one)
    front = (far[last_quiet : arrived + 1] - far[last_quiet]) @ surge / (rise @ surge)
    arrival = arrived - front.sum() + 1 - (closing + 1)
    measured("error of the arrival", abs(arrival - steps), "steps")
    assert arrival == pytest.approx(steps, abs=0.05)


def test_a_bergeron_line_keeps_its_trapped_charge() -> None:
    near, far, closing = energized(100.0)
    open_line = slice(closing - 200, closing)  # 2 ms before closing
    assert np.abs(near[open_line]).min() > 0.5 * BASE_KV * 1e3 * np.sqrt(2 / 3)
    assert np.abs(far[open_line] - near[open_line]).max() < 0.02 * BASE_KV * 1e3
