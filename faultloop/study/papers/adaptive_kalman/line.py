"""The line of seed paper 000 in our plant: 300 km, travelling waves, 24 samples per cycle.

The paper gives the length, the fault places and the sampling rate, and the rest only as "dynamic model".
Here: a 500 kV line with the parameters below, a source at each end, the sending one leading by 15
degrees, and before the sampling a second-order low-pass at a third of its rate, without which travelling
waves alias; its delay of 0.6 ms is in every time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant

Array = NDArray[np.float64]

F0 = 50.0
PER_CYCLE = 24
SAMPLING_HZ = 1200
LENGTH_KM = 300.0
START_S = 0.1
SETTLE_S = 0.6
KEPT_S = 0.16
Z1_PER_KM, Z0_PER_KM = 0.02 + 0.28j, 0.18 + 0.85j
ZS1, ZS0 = 1.5 + 30j, 2.5 + 25j

PHASES = {"AG": (0,), "BC": (1, 2), "BCG": (1, 2), "ABC": (0, 1, 2)}
CASES = (("AG", 160.0), ("AG", 290.0), ("ABC", 160.0), ("BC", 160.0), ("BCG", 160.0))


@dataclass(frozen=True)
class Record:
    """A fault at the sending end.

    samples : (n, 6) from the start to `KEPT_S` after the inception, over the settled fault current or the
        nominal peak voltage.
    settled : (6,) the fault's phasors, peak, in the same unit, from a cycle half a second later.
    since : number of the first sample at or after the inception.
    late_s : its time after the inception.
    """

    samples: Array
    settled: NDArray[np.complex128]
    since: int
    late_s: float


def time_constant_s(kind: str, at_km: float) -> float:
    """L / R of the loop from the sending source to the fault [s]: what a setting would take."""
    z1, z0 = ZS1 + at_km * Z1_PER_KM, ZS0 + at_km * Z0_PER_KM
    loop = 2.0 * z1 + z0 if kind == "AG" else z1
    return loop.imag / (2.0 * np.pi * F0 * loop.real)


def line_time_constant_s(kind: str) -> float:
    """L / R of the line alone [s]: what the paper would take for the offset's time constant."""
    loop = 2.0 * Z1_PER_KM + Z0_PER_KM if kind == "AG" else Z1_PER_KM
    return loop.imag / (2.0 * np.pi * F0 * loop.real)


def scenario(kind: str, at_km: float, start_s: float) -> Scenario:
    """The network with one fault."""
    line: dict[str, Any] = {
        "name": "MN", "from": "M", "to": "N", "length_km": LENGTH_KM, "model": "bergeron",
        "r1_ohm_per_km": Z1_PER_KM.real, "x1_ohm_per_km": Z1_PER_KM.imag, "b1_us_per_km": 4.1,
        "r0_ohm_per_km": Z0_PER_KM.real, "x0_ohm_per_km": Z0_PER_KM.imag, "b0_us_per_km": 2.7,
    }  # fmt: skip
    source1, source0 = [ZS1.real, ZS1.imag], [ZS0.real, ZS0.imag]
    return Scenario.from_dict(
        {
            "scenario": {"name": "300 km", "duration_s": 1.0},
            "system": {
                "frequency_hz": 50,
                "base_kv": 500,
                "sampling_hz": SAMPLING_HZ,
                "steps_per_sample": 16,
            },
            "source": [
                {"name": "SM", "bus": "M", "angle_deg": 15.0, "z1_ohm": source1, "z0_ohm": source0},
                {"name": "SN", "bus": "N", "angle_deg": 0.0, "z1_ohm": source1, "z0_ohm": source0},
            ],
            "line": [line],
            "fault": [{"line": "MN", "at_km": at_km, "type": kind, "start_s": start_s}],
            "relay": [{"name": "R", "line": "MN", "end": "from", "settings": "none"}],
            "front_end": {"antialias_hz": SAMPLING_HZ / 3.0, "antialias_order": 2},
        }
    )


def record(kind: str, at_km: float, turn: float) -> Record:
    """One fault; ``turn`` of a cycle after `START_S`, 0 to 1."""
    start_s = START_S + turn / F0
    plant = Plant(scenario(kind, at_km, start_s))
    wanted = round((start_s + SETTLE_S) * SAMPLING_HZ)
    blocks = []
    while plant.sample_count < wanted:
        m = plant.advance(wanted - plant.sample_count)
        blocks.append(plant.samples[:m, 0].copy())
    samples = np.concatenate(blocks)
    turns = np.exp(-2j * np.pi * np.arange(wanted - PER_CYCLE, wanted) / PER_CYCLE)
    settled = (2.0 / PER_CYCLE * (turns @ samples[-PER_CYCLE:])).astype(np.complex128)
    unit = np.repeat([500e3 * np.sqrt(2.0 / 3.0), np.abs(settled[3:]).max()], 3)
    since = int(np.ceil(start_s * SAMPLING_HZ - 1e-9))
    kept = since + round(KEPT_S * SAMPLING_HZ)
    return Record(
        samples[:kept] / unit, (settled / unit).astype(np.complex128), since, since / SAMPLING_HZ - start_s
    )
