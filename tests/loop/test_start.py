"""How a run begins: nothing is told that happened before it, or that never did."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import faultloop
from faultloop.loop.scenario import Scenario, load_scenario
from faultloop.plant import Plant
from faultloop.relay import Relay
from tests.relay.network import Network, settings_dict

AG = Path(__file__).resolve().parents[2] / "scenarios" / "ag-zone1.toml"
MHO = AG.parent / "settings" / "ab-mho.toml"


def slipping(*frequencies: float, duration_s: float = 0.4, angle_deg: float = -12.0) -> Scenario:
    """`../shared/cases/swing-trips-at-zero`: two systems, no fault."""
    data = load_scenario(AG).model_dump(by_alias=True, exclude_none=True, mode="json")
    data |= {"fault": [], "expect": []}
    data["scenario"] |= {"duration_s": duration_s}
    data["source"][1]["angle_deg"] = angle_deg
    for source, frequency_hz in zip(data["source"], frequencies, strict=True):
        source["frequency_hz"] = frequency_hz
    return Scenario.from_dict(data, path=AG)


@pytest.mark.parametrize("frequencies", [(50.0, 51.0), (50.0, 49.0), (49.5, 50.5), (50.0, 53.0)])
def test_two_systems_that_slip_do_not_trip_before_the_swing_enters_a_zone(
    frequencies: tuple[float, float],
) -> None:
    """At 51 Hz they are 180 degrees apart at (180 - 12 or 180 + 12) / 360 s; zone 1 is entered near there."""
    slip = frequencies[1] - frequencies[0]
    result = faultloop.run(slipping(*frequencies, duration_s=0.4 / abs(slip)))
    apart_s = (180 + math.copysign(12, slip)) / 360 / abs(slip)
    early = [trip for trip in result.trips if trip.t_ns / 1e9 < 0.6 * apart_s]
    assert early == []
    assert not [event for event in result.events if event.t_ns == 0 and "PTRC1" in event.text]


@pytest.mark.parametrize("frequencies", [(50.0, 51.0), (51.0, 51.0), (50.0, 150.0)])
def test_the_samples_before_the_run_lead_into_it(frequencies: tuple[float, float]) -> None:
    """No step at sample 0; before it the impedance stands still, however the systems slip after it."""
    plant = Plant(slipping(*frequencies))
    before = plant.history(4800)[:, 0]
    plant.advance(96)
    both = np.concatenate([before, plant.samples[:96, 0]])
    step = np.abs(np.diff(both, axis=0))
    assert (step[4790:4810].max(axis=0) <= 1.01 * step[:4700].max(axis=0)).all()
    if frequencies[1] < 60:
        peaks = np.abs(before).reshape(10, 480, 6).max(axis=1)
        assert (np.ptp(peaks, axis=0) < 0.01 * peaks.max(axis=0)).all()


def test_a_harmonic_source_is_no_system_that_slips() -> None:
    before = Plant(slipping(50.0, 150.0)).history(4800)[:, 0, 0]
    spectrum = np.abs(np.fft.rfft(before))
    assert spectrum[150] > 0.05 * spectrum[50] > 100 * spectrum[100]


def test_a_trip_from_before_the_run_is_not_told_as_one_of_it() -> None:
    """A relay that sees a fault in its warm-up: it begins anew, says so, and holds no trip."""
    relay = Relay(faultloop.load_settings(MHO))
    plant = Plant(load_scenario(AG))
    healthy = plant.history(4800)[:, 0]
    rows = []
    while plant.sample_count < 4800 // 5:
        plant.advance(96)
        rows.append(plant.samples[:, 0].copy())
    faulted = np.concatenate(rows)
    relay.warm_up(np.concatenate([healthy, faulted[: 960 - 960 % 96]]))
    assert relay.outputs.trip_poles == 0
    assert relay.sample_count == 0
    (event,) = relay.events
    assert event.trip is None and "before the run" in event.text


@pytest.mark.parametrize("language", ["plain", "compiled"])
def test_a_users_element_sees_no_estimate_that_has_not_settled(tmp_path: Path, language: str) -> None:
    """An under-voltage element, which a filter that fills would trip."""
    compiled = "import numba\n@numba.njit\n" if language == "compiled" else ""
    source = f"{compiled}def step(state, x, out):\n    out[1] = 1.0 if x[0]**2 + x[1]**2 < 50e3**2 else 0.0\n"
    (tmp_path / "under.py").write_text(source)
    data = settings_dict(Network(), [{"zone": 1, "reach_pu": 0.4}])
    data["element"] = [{"name": "PTUV1", "function": "under.py:step", "trip": True}]
    relay = Relay(faultloop.RelaySettings.from_dict(data, path=tmp_path / "relay.toml"))
    t = np.arange(960) / 4800
    turns = 2 * np.pi * 50 * t[:, None] - 2 * np.pi / 3 * np.array([0, 1, 2, 0, 1, 2])
    samples = np.array([180e3, 180e3, 180e3, 700, 700, 700]) * np.cos(turns)
    done, words = 0, []
    while done < len(samples):
        done += relay.advance(samples[done : done + 100])
        words.append(relay.operate.copy())
    bit = relay.bits.index("PTUV1")
    assert not (np.concatenate(words) >> np.uint64(bit) & np.uint64(1)).any()
    samples[:] *= 0.1  # and then it does its work
    relay.advance(samples)
    assert relay.outputs.trip_poles == 7


def test_poles_that_open_between_two_frames_are_one_state(shared: Path) -> None:
    """`../shared/cases/pole-status-refused`: a healthy bus refuses nothing, and tells nothing of it."""
    scenario = shared / "cases" / "pole-status-refused" / "bc-60-percent.toml"
    result = faultloop.run(scenario, keep=False)
    assert sorted((trip.relay, trip.poles, trip.opened_ns is not None) for trip in result.trips) == [
        ("RA", 7, True),
        ("RB", 7, True),
    ]
    assert [event.text for event in result.events if "refused" in event.text] == []
