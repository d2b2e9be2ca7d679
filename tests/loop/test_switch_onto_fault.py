"""A line that is closed onto a fault, its voltage measured on its own side or at the bus."""

from __future__ import annotations

from typing import Any

import pytest

from faultloop.loop.case import Cases
from faultloop.loop.scenario import Scenario
from faultloop.relay import RelaySettings
from tests.examples import scenario

LINE = (complex(6.0, 40.0), complex(24.0, 120.0))
SETTINGS = RelaySettings.from_dict(
    {
        "relay": {"frequency_hz": 50, "nominal_kv": 220},
        "vt": {"kind": "ideal"},
        "line": {"z1_ohm": [6.0, 40.0], "z0_ohm": [24.0, 120.0]},
        "pdis": [{"zone": 1, "reach_pu": 0.8}],
    }
)
CLOSES_S = 0.4
SLOWEST_MS = 100.0


def trip_ms(
    kind: str,
    at: float,
    in_service: bool,
    charged: bool = False,
    *,
    side: str = "line",
    sir: float | None = None,
    load_mw: float = 20.0,
    opens_s: float = 0.02,
    closes_s: float = CLOSES_S,
) -> tuple[str, float] | None:
    """Function and time from the closing of A's trip; a line that was ``in_service`` is opened before, and
    keeps its charge where it is ``charged``."""
    operations: list[dict[str, Any]] = [
        {"name": "S1", "breaker": "QA", "operation": "close", "at_s": closes_s}
    ]
    if in_service:
        operations.append({"name": "S0", "breaker": "QA", "operation": "open", "at_s": opens_s})
    source = dict(scenario()["source"][0])
    if sir is not None:
        z1, z0 = sir * LINE[0], 1.5 * sir * LINE[0]
        source |= {"z1_ohm": [z1.real, z1.imag], "z0_ohm": [z0.real, z0.imag]}
    tables = scenario(
        scenario={"duration_s": 0.6},
        fault=[{"line": "AB", "at_pu": at, "type": kind, "start_s": 0.15}],
        breaker=[
            {"name": "QA", "line": "AB", "end": "from", "closed": in_service},
            {"name": "QB", "line": "AB", "end": "to", "closed": not charged},
        ],
        relay=[
            {
                "name": "RA",
                "line": "AB",
                "end": "from",
                "breaker": "QA",
                "settings": "none",
                "voltage_at": side,
            }
        ],
        source=[source],
        load=[{"name": "L", "bus": "B", "mw": load_mw, "mvar": 0.0}],
        switching=operations,
    )
    done = Cases().prepare(Scenario.from_dict(tables), {"RA": SETTINGS}).run()
    trip = next((trip for trip in done.trips if trip.t_ns > closes_s * 1e9), None)
    return None if trip is None else (trip.function, (trip.t_ns - closes_s * 1e9) / 1e6)


@pytest.mark.parametrize("kind", ["AG", "BC", "CAG", "ABC"])
@pytest.mark.parametrize("at", [0.0, 0.5])
def test_a_line_that_was_in_service(kind: str, at: float) -> None:
    """Before: no three-phase fault at the relay, whose voltages counted as lost as the breaker closed."""
    found = trip_ms(kind, at, in_service=True)
    assert found is not None
    assert 0.0 < found[1] <= SLOWEST_MS


@pytest.mark.parametrize("kind", ["AG", "BC", "ABC"])
def test_a_line_that_keeps_its_charge(kind: str) -> None:
    """Phases without a fault stand at their peak, which an estimator takes for a phasor of a fifth of it."""
    found = trip_ms(kind, 0.5, in_service=True, charged=True)
    assert found is not None
    assert 0.0 < found[1] <= SLOWEST_MS


@pytest.mark.parametrize("kind", ["AG", "BG", "CG"])
@pytest.mark.parametrize("closes_s", [0.365, 0.3675, 0.37, 0.3725])
def test_one_phase_behind_a_weak_source(kind: str, closes_s: float) -> None:
    """Before: two phases, and no trip, as the healthy ones take the line's charge."""
    found = trip_ms(kind, 0.6, in_service=True, side="bus", sir=10.0, closes_s=closes_s)
    assert found is not None
    assert 0.0 < found[1] <= SLOWEST_MS


@pytest.mark.parametrize("opens_s", [0.08, 0.082, 0.084, 0.086, 0.088])
@pytest.mark.parametrize("sir", [3.0, 10.0])
def test_three_phases_after_poles_that_opened_in_turn(sir: float, opens_s: float) -> None:
    """Before: a pole's voltage counted as lost, as its current was estimated for longer."""
    found = trip_ms("ABC", 0.01, in_service=True, sir=sir, load_mw=50.0, opens_s=opens_s)
    assert found is not None
    assert 0.0 < found[1] <= SLOWEST_MS


@pytest.mark.parametrize("kind", ["AG", "CAG", "BC"])
def test_a_line_that_the_relay_has_never_seen_live(kind: str) -> None:
    """Before: not AG close in, as two healthy voltages made the relay ready and ended PSOF."""
    found = trip_ms(kind, 0.0, in_service=False)
    assert found is not None and found[0] == "PSOF1"
    assert found[1] <= SLOWEST_MS


def test_no_voltage_that_was_ever_seen_is_no_three_phase_fault() -> None:
    """It cannot be told from a transformer that nobody wired: `current_a` is for that."""
    assert trip_ms("ABC", 0.0, in_service=False) is None
