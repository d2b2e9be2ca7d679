"""A fault that begins within a balanced disturbance that is none: a load change, an infeed, a swing."""

from __future__ import annotations

import cmath
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import faultloop
from faultloop.loop.scenario import Scenario
from faultloop.relay import Relay, RelaySettings
from faultloop.relay.functions.phs import PHS
from faultloop.relay.memory import begins_anew, thaw
from tests.relay.functions.kernel import Kernel
from tests.relay.network import Network, settings_dict

SETTINGS = Path(__file__).parents[2] / "scenarios" / "settings" / "ab-mho.toml"
LINE = {"model": "bergeron", "r1_ohm_per_km": 0.06, "x1_ohm_per_km": 0.4, "b1_us_per_km": 2.8,
        "r0_ohm_per_km": 0.24, "x0_ohm_per_km": 1.2, "b0_us_per_km": 1.8}  # fmt: skip
BALANCED: dict[str, dict[str, Any]] = {
    "a swing that more load comes of": {
        "swing": [{"source": "SB", "at_s": [0.1, 0.25], "angle_deg": [-12.0, -30.0]}]
    },
    "a swing that turns the load around": {
        "swing": [{"source": "SB", "at_s": [0.1, 0.2], "angle_deg": [-12.0, 8.0]}]
    },
    "the source behind moves": {"swing": [{"source": "SA", "at_s": [0.1, 0.2], "angle_deg": [0.0, 18.0]}]},
    "a load that goes": {
        "line": [{"name": "BL", "from": "B", "to": "L", "length_km": 1, **LINE}],
        "load": [{"name": "LL", "bus": "L", "mw": 300.0, "mvar": 60.0}],
        "breaker": [{"name": "QL", "line": "BL", "end": "from"}],
        "switching": [{"breaker": "QL", "operation": "open", "at_s": 0.1}],
    },
}


def scenario(more: dict[str, Any], kind: str, at_pu: float, after_s: float) -> Scenario:
    tables: dict[str, Any] = {
        "scenario": {"name": "a fault in a change", "duration_s": 0.4},
        "system": {"frequency_hz": 50, "base_kv": 220},
        "source": [
            {"name": "SA", "bus": "A", "voltage_pu": 1.02, "z1_ohm": [1.2, 14.0], "z0_ohm": [2.0, 11.0]},
            {"name": "SB", "bus": "B", "angle_deg": -12, "z1_ohm": [1.8, 20.0], "z0_ohm": [3.0, 17.0]},
        ],
        "line": [{"name": "AB", "from": "A", "to": "B", "length_km": 100, **LINE}],
        "fault": [{"line": "AB", "type": kind, "at_pu": at_pu, "after_s": after_s, "angle_deg": 60}],
        "relay": [
            {"name": name, "line": "AB", "end": end, "settings": str(SETTINGS)}
            for name, end in (("RA", "from"), ("RB", "to"))
        ],
    }
    for name, rows in more.items():
        tables[name] = [*tables.get(name, []), *rows]
    return Scenario.from_dict(tables)


@pytest.mark.parametrize("what", BALANCED)
@pytest.mark.parametrize("kind", ["AG", "AB", "CAG", "BG"])
def test_the_fault_has_type_direction_and_time_of_its_own(what: str, kind: str) -> None:
    """By the change against before both, an A-G was A-B, and behind for the relay whose source had moved."""
    for after_s in (0.16, 0.18):
        result = faultloop.run(scenario(BALANCED[what], kind, 0.45, after_s), keep=False)
        began = result.fault_start_ns
        assert began is not None
        first = {trip.relay: trip for trip in reversed(result.trips)}
        assert set(first) == {"RA", "RB"}
        for trip in first.values():
            assert (trip.function, trip.loop) == ("PDIS1", kind.removesuffix("G") if len(kind) == 3 else kind)
            assert 0 < trip.t_ns - began < 16_000_000


@pytest.mark.parametrize("what", BALANCED)
def test_without_a_fault_nothing_trips(what: str) -> None:
    tables = scenario(BALANCED[what], "AG", 0.45, 0.3)
    result = faultloop.run(tables.model_copy(update={"fault": ()}), keep=False)
    assert not result.trips


# ---------------------------------------------------------------- the condition by itself

CYCLE = 96
ROTOR = cmath.rect(1.0, 0.001)
BEFORE, LOADED = Network().solve(), Network(angle_deg=25).solve()
FAULTED = Network(angle_deg=25).solve("AG")


def begins(
    before: Any,
    was: Any,
    now: Any,
    earlier: Any = None,
    age: int = 2 * CYCLE,
    tick: int = 1,
    **table: float,
) -> bool:
    """Of phasors before the disturbance, at both snapshots within it (the earlier as the later), and now."""
    k = Kernel(PHS, table)
    m = k.q["memory"]
    m["rotor"], m["age"], m["tick"], m["head"], m["reference"] = ROTOR, age, tick, 3, before
    back = 5 * int(k.g["snapshots"]) // 16
    for times, state in ((1, was), (2, was if earlier is None else earlier)):
        ago = times * back * int(k.g["snapshot"]) + tick
        m["ring"][(3 - times * back) % int(k.g["snapshots"])] = state / ROTOR**ago
    anew = bool(begins_anew(k.g, m, now))
    assert not anew or np.allclose(m["work"], was, rtol=1e-9)
    return anew


def test_what_is_not_balanced_begins_anew_in_what_was() -> None:
    assert begins(BEFORE, LOADED, FAULTED)
    assert begins(BEFORE, LOADED, Network(angle_deg=25).solve("BC", 0.9))


def test_not_before_the_first_one_is_a_cycle_and_a_half_old_and_once_a_snapshot() -> None:
    assert begins(BEFORE, LOADED, FAULTED, age=3 * CYCLE // 2)
    assert not begins(BEFORE, LOADED, FAULTED, age=3 * CYCLE // 2 - 1)
    assert not begins(BEFORE, LOADED, FAULTED, tick=2)


def test_what_stays_or_is_balanced_is_the_first_one_itself() -> None:
    assert not begins(BEFORE, LOADED, LOADED)
    assert not begins(BEFORE, LOADED, Network(angle_deg=40).solve())
    assert not begins(BEFORE, LOADED, Network(angle_deg=25).solve("ABC"))
    assert not begins(BEFORE, BEFORE, Network().solve("AG")), "nothing had changed half a cycle ago"


def test_balanced_is_what_the_phase_selection_takes_for_three_phases() -> None:
    """Here I2 is 0.3 of I1 in the change."""
    now = LOADED + 0.6 * (FAULTED - LOADED) + 0.25 * (Network(angle_deg=25).solve("ABC") - LOADED)
    assert begins(BEFORE, LOADED, now, three_phase_unbalance=0.1)
    assert not begins(BEFORE, LOADED, now, three_phase_unbalance=0.45)


def test_what_settles_begins_nothing() -> None:
    """As a three-phase fault with resistance, whose phasors are still on their way."""
    moved = LOADED + 0.4 * (FAULTED - LOADED)
    assert not begins(BEFORE, LOADED, FAULTED, earlier=LOADED - (moved - LOADED))
    moved = LOADED + 0.3 * (FAULTED - LOADED)
    assert begins(BEFORE, LOADED, FAULTED, earlier=LOADED - (moved - LOADED))


def test_within_a_fault_none_begins() -> None:
    """A fault of one phase, or one of three that takes a fifth of the voltage."""
    assert not begins(BEFORE, Network().solve("AG"), Network().solve("CAG"))
    assert not begins(BEFORE, Network().solve("ABC"), Network().solve("BC"))


def test_a_disturbance_does_not_end_at_a_faults_first_samples() -> None:
    """The state of that moment would be what is normal, and the fault lie behind (bench/functions.py change,
    seed 70010, case 163: zone 4 started 9 ms after a fault behind)."""
    for now, ends in ((LOADED, True), (LOADED + 0.3 * (FAULTED - LOADED), False)):
        k = Kernel(PHS, {})
        m = k.q["memory"]
        m["frozen"], m["still"], m["rotor"], m["reference"] = 1, 2 * CYCLE, 1.0, BEFORE
        m["ring"][int(m["head"])] = LOADED
        thaw(k.g, m, now, 50.0, 7, False)
        assert (m["frozen"] == 0) == ends
        assert np.allclose(m["reference"], LOADED if ends else BEFORE)


@pytest.mark.parametrize("sampling_hz", [800, 1200, 4800])
def test_the_reference_stays_that_of_before_the_fault(sampling_hz: int) -> None:
    """At any sampling rate (before: below 1600 Hz the next sample took that of a cycle and a quarter ago)."""
    network = Network(sampling_hz=sampling_hz)
    load = Network(sampling_hz=sampling_hz, angle_deg=-35)
    x = network.samples([(0.0, network.solve()), (0.3, load.solve()), (0.35, load.solve("AG"))], 0.4)
    given = settings_dict(network, [{"zone": 1, "reach_pu": 0.8}], estimator={"method": "kalman-bank"})
    r, began = Relay(RelaySettings.from_dict(given)), False
    for sample in x:
        r.advance(sample[None])
        q = r._state[0]["shared"]
        if q["disturbed"] and q["number"] > 0.35 * sampling_hz and q["memory"]["age"] < 0.01 * sampling_hz:
            np.testing.assert_allclose(np.abs(q["memory"]["reference"]), np.abs(load.solve()), rtol=0.05)
            began = True
    assert began and q["proven"] == 7, "no voltage of before is doubted"
