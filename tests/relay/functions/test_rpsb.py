"""RPSB: swings of every speed are blocked, faults in them are found; boxes and rules."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant
from faultloop.relay import Relay, RelaySettings
from faultloop.relay.functions.rpsb import RPSB
from tests.measured import Measured
from tests.relay import swings
from tests.relay.functions.kernel import GIVEN
from tests.relay.network import Network, play, settings_dict
from tests.relay.test_records import analog

NETWORK = Network()
BOXES = {"outer_resistance_ohm": 45.0, "inner_resistance_ohm": 22.0}
ZONES = [
    {"zone": 1, "reach_pu": 0.85},
    {"zone": 2, "reach_pu": 1.3, "delay_ms": 300.0},
    {"zone": 3, "reach_pu": 0.6, "direction": "reverse", "delay_ms": 600.0},
    {"zone": 4, "reach_pu": 0.85, "characteristic": "quad", "resistive_reach_ohm": 15.0},
]


def relay(rpsb: dict[str, Any] | None, method: str = "kalman-bank") -> Relay:
    given: dict[str, Any] = settings_dict(NETWORK, ZONES, estimator={"method": method}) | {"rpsb": rpsb}
    given["relay"]["nominal_kv"] = 230
    return Relay(RelaySettings.from_dict(given))


def trips(r: Relay, x: np.ndarray) -> list[tuple[float, str]]:
    return [(e.sample_count / 4800, e.trip.function) for e in play(r, x) if e.trip]


@pytest.mark.parametrize("method", ["kalman-bank", "fourier"])
@pytest.mark.parametrize("slip", [0.5, 1.0, 2.0, 3.5, 5.0, 7.0])
@pytest.mark.parametrize("load", [-20.0, 20.0])
def test_no_zone_trips_while_the_sources_slip(slip: float, load: float, method: str) -> None:
    x = swings.samples(NETWORK, swings.slipping(NETWORK, slip, 0.3 + max(1.5 / slip, 0.6), load_deg=load))
    assert trips(relay(BOXES, method), x) == []
    if 0.5 < slip < 7.0:  # a loop of the fastest one is no piece of line, and zone 1 sees that, too
        assert trips(relay(None, method), x), "without it a zone trips"


@pytest.mark.parametrize("most", [100.0, 140.0])
@pytest.mark.parametrize("hz", [0.5, 1.0, 2.0])
def test_no_zone_trips_in_a_stable_swing(hz: float, most: float) -> None:
    x = swings.samples(NETWORK, swings.stable(NETWORK, hz, most, 0.3 + 1.5 / hz))
    assert trips(relay(BOXES), x) == []


@pytest.mark.parametrize("hz", [45.0, 54.0])
@pytest.mark.parametrize("load", [-35.0, 25.0])
def test_an_estimator_that_settles_off_the_nominal_frequency_is_no_swing(hz: float, load: float) -> None:
    network, r = Network(frequency_hz=hz, angle_deg=load), relay(BOXES)
    found = play(r, network.samples([(0.0, network.solve())], 0.25))
    assert not [event.text for event in found if "swing" in event.text]


@pytest.mark.parametrize(("trip", "slips", "before", "after"), [
    ("way-in", 1, 90.0, 180.0), ("way-out", 1, 180.0, 330.0), ("way-out", 2, 540.0, 690.0)
])  # fmt: skip
def test_out_of_step_trips_on_the_way_in_or_out(trip: str, slips: int, before: float, after: float) -> None:
    """Within these angles of the far source."""
    angles = swings.slipping(NETWORK, 1.5, 1.8)
    table = BOXES | {"trip": trip} | ({"slips": slips} if slips > 1 else {})
    found = trips(relay(table), swings.samples(NETWORK, angles))
    assert found and found[0][1] == "RPSB1"
    assert before < -angles[int(found[0][0] * 4800)] < after


def test_no_stable_swing_trips_on_the_way_out() -> None:
    table = BOXES | {"trip": "way-out"}
    assert trips(relay(table), swings.samples(NETWORK, swings.stable(NETWORK, 1.0, 150.0, 2.0))) == []


NEAR_THE_CENTRE = [
    ("BCG", 0.40, 176.0, 4.1),
    ("AG", 0.78, 161.0, 3.2),
    ("ABCG", 0.71, 215.0, 3.9),
    ("AB", 0.77, 90.0, 2.0),
]


@pytest.mark.parametrize(("kind", "at", "degrees", "slip"), NEAR_THE_CENTRE)
def test_a_fault_that_changes_next_to_nothing_trips_within_60_ms(
    kind: str, at: float, degrees: float, slip: float, measured: Measured
) -> None:
    """Near 180 degrees the voltage is gone without a fault, too: a loop that stands still tells it."""
    start = 0.3 + (degrees - 20.0) / (360 * slip)
    x = swings.samples(NETWORK, swings.slipping(NETWORK, slip, start + 0.1), kind, at, start)
    [(at_s, _)] = trips(relay(BOXES), x)[:1]
    measured("trip near the swing's centre", 1000 * (at_s - start), "ms")
    assert start < at_s <= start + 0.060


@pytest.mark.parametrize("at", [0.02, 0.3, 0.6])
@pytest.mark.parametrize("weak", [0.5, 5.0, 25.0])
def test_a_three_phase_fault_trips_as_soon_as_without_it(at: float, weak: float) -> None:
    """It leaps, and what its estimate still does then is no swing's motion."""
    network = Network(zs1=(1 + 12j) * weak, zs0=(1.5 + 15j) * weak)
    x = network.fault("ABC", at, 0.3, 0.4)
    found = [trips(relay(rpsb), x) for rpsb in (BOXES, None)]
    assert found[0][:1] == found[1][:1] and found[0]


@pytest.mark.parametrize("kind", ["ABC", "CG", "AB", "BCG"])
@pytest.mark.parametrize(("at", "degrees"), [(-1.0, 120.0), (-1.0, 240.0), (0.95, 90.0), (0.95, 185.0)])
def test_no_fault_outside_trips_in_a_swing_and_none_when_it_has_gone(
    kind: str, at: float, degrees: float
) -> None:
    slip = 1.8
    start = 0.3 + (degrees - 20.0) / (360 * slip)
    angle = swings.slipping(NETWORK, slip, start + 0.3)
    assert trips(relay(BOXES), swings.samples(NETWORK, angle, kind, at, start, end_s=start + 0.15)) == []


def behind_and_ahead(near: float, far: float, angle_deg: float = 0.0) -> Network:
    """Sources in parts of `NETWORK`'s."""
    return Network(
        zs1=(1 + 12j) * near, zs0=(1.5 + 15j) * near, zr1=(1.5 + 18j) * far, zr0=(3 + 30j) * far,
        angle_deg=angle_deg,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("near", "far", "hz", "most", "kind", "at", "start_s"),
    [
        # the swing's end was taken for its turning: the fault's memory was of a moment in it
        (2.7128487253, 0.6486182018, 3.0, 74.0262068, "AG", 0.4469564338, 0.6647448712),
        # outside the boxes the fault itself ended the swing, and was what is normal from then on
        (0.4954690208, 1.4494544780, 1.1238134919, 66.0614619, None, 0.5, 1.1),
        (1.7495454701, 2.3122662419, 3.0, 89.4164117, "CG", 0.7671064973, 0.7244679973),
    ],
)
def test_a_fault_where_a_stable_swing_is_slow_trips(
    near: float, far: float, hz: float, most: float, kind: str | None, at: float, start_s: float
) -> None:
    network = behind_and_ahead(near, far)
    for one in [kind] if kind else ["AG", "BC", "CAG", "ABC"]:
        angle = -swings.stable(network, hz, most, start_s + 0.15)
        found = trips(relay(BOXES), swings.samples(network, angle, one, at, start_s))
        assert found, one
        assert 0 < found[0][0] - start_s < 0.06, one


@pytest.mark.parametrize(
    ("near", "far", "slip", "kind", "at", "start_s"),
    [
        # every loop stood still for a while, I2 and all: it was taken for a three-phase fault
        (0.3470674787, 0.5865275946, 0.6688962204, "CAG", 0.9932068031, 0.8917171098),
        # without a loop that stands the resistances near the swing's centre told A-B
        (0.5745689203, 0.4084906038, 1.2122501332, "CG", 0.9626599800, 0.6505084941),
    ],
)
def test_a_fault_near_the_far_bus_in_a_swing_is_no_other_loops(
    near: float, far: float, slip: float, kind: str, at: float, start_s: float
) -> None:
    network = behind_and_ahead(near, far)
    angle = swings.slipping(network, slip, start_s + 0.4, load_deg=20.0)
    x = swings.samples(network, angle, kind, at, start_s, end_s=start_s + 0.15)
    assert trips(relay(BOXES), x) == []


@pytest.mark.parametrize(
    ("near", "far", "at", "load_deg", "rate", "stands_s", "slip_hz"),
    [
        (2.6512420301, 0.3506572792, 0.9888309906, 12.6, 65.0, 0.198, 3.0),
        (0.4322569735, 0.3218291279, -1.0, 19.1, 50.0, 0.15, 2.0),
    ],
)
def test_no_zone_takes_the_swing_after_a_fault_for_a_three_phase_fault(
    near: float, far: float, at: float, load_deg: float, rate: float, stands_s: float, slip_hz: float
) -> None:
    """The fault beyond, or behind, accelerates the far source; a zone that the fault had started let zone 1
    start in the swing."""
    network = behind_and_ahead(near, far)
    t = np.arange(6000) / 4800 - 0.3
    gone, begins = np.maximum(t - stands_s, 0.0), rate * stands_s
    angle = 0.5 * rate * np.clip(t, 0.0, stands_s) ** 2 + begins * gone
    angle += (2 * np.pi * slip_hz - begins) * (gone - 0.2 * (1 - np.exp(-gone / 0.2)))
    for sign in (-1.0, 1.0):
        for kind in ("CAG", "AG", "ABC"):
            degrees = sign * (load_deg + np.degrees(angle))
            x = swings.samples(network, degrees, kind, at, 0.3, end_s=0.3 + stands_s)
            assert trips(relay(BOXES), x) == [], (sign, kind)


@pytest.mark.parametrize(
    ("near", "far", "kind", "at", "resistance", "degrees", "rate", "stands_s"),
    [
        (1.1998, 0.2561, "BCG", 0.9323, 0.0, -22.2, 82.0, 0.193),  # BC was AB after 156 ms
        (2.0595, 1.5968, "CAG", -1.0, 0.0, -28.9, 92.0, 0.163),  # the energy's sign turned ...
        (1.6835, 0.5895, "ABCG", -1.0, 0.0, -31.7, 82.0, 0.167),  # ... though V1 / I1 stays at zero
        (2.4485, 1.0533, "ABC", -1.0, 0.0, -34.3, 102.0, 0.183),  # that remembered was of the other side
        (0.6193, 0.5550, "BCG", 0.9268, 3.94, -23.2, 39.9, 0.174),  # the change was a current of no fault
    ],
)
def test_sources_that_slip_in_a_fault_outside_make_none_inside(
    near: float,
    far: float,
    kind: str,
    at: float,
    resistance: float,
    degrees: float,
    rate: float,
    stands_s: float,
) -> None:
    """The reference from before turns away from them: after 100 ms the change is that of a swing."""
    t = np.arange(5300) / 4800 - 0.31
    gone = np.maximum(t - stands_s, 0.0)
    angle = 0.5 * rate * np.clip(t, 0.0, stands_s) ** 2 + rate * stands_s * gone
    angle = degrees + np.copysign(1.0, degrees) * np.degrees(angle)
    network = behind_and_ahead(near, far)
    x = swings.samples(network, angle, kind, at, 0.31, resistance=resistance, end_s=0.31 + stands_s)
    assert trips(relay(BOXES), x) == []


def test_a_fault_at_the_centre_stands_while_it_draws_no_current() -> None:
    """The swing's centre goes through its place 45 ms after it has begun: I2 and I0 are gone for 12 ms."""
    start = 0.7956391662
    angle = swings.slipping(NETWORK, 2.725, start + 0.1, load_deg=20.0)
    x = swings.samples(behind_and_ahead(0.9100643, 1.5426869), angle, "BG", 0.7839762269, start)
    [(at_s, _)] = trips(relay(BOXES), x)[:1]
    assert start < at_s <= start + 0.060


@pytest.mark.parametrize(
    ("near", "far", "slip", "load_deg", "kind", "start_s"),
    [
        # as it went one pair stood still for a moment, and was a fault ahead
        (1.0276482876, 0.3877745646, 3.6, 20.0, "ABC", 0.6546194167),
        # a pair that goes on with a slow swing left little, and was a fault ahead
        (0.8263193617, 0.3749613241, 0.8, 20.0, "AG", 0.9213440847),
    ],
)
def test_a_fault_behind_in_a_swing_is_none_ahead_while_it_comes_and_goes(
    near: float, far: float, slip: float, load_deg: float, kind: str, start_s: float
) -> None:
    network = behind_and_ahead(near, far)
    for sign in (-1.0, 1.0):
        angle = sign * swings.slipping(network, slip, start_s + 0.4, load_deg=load_deg)
        x = swings.samples(network, angle, kind, -1.0, start_s, end_s=start_s + 0.15)
        assert trips(relay(BOXES), x) == [], sign


def on_bergeron_lines(angle: np.ndarray, kind: str, at: float, start_s: float) -> np.ndarray:
    """(n, 6) at A of lines X - A - B - C of 50, 100 and 50 km, whose source at C has these angles, with a
    fault on A - B; a second of the steady state comes first."""
    line = {"model": "bergeron", "r1_ohm_per_km": 0.03, "x1_ohm_per_km": 0.3, "b1_us_per_km": 3.5}
    line |= {"r0_ohm_per_km": 0.12, "x0_ohm_per_km": 0.9, "b0_us_per_km": 2.2}
    ends = (("X", "A", 50.0), ("A", "B", 100.0), ("B", "C", 50.0))
    points = range(0, len(angle), 24)
    data: dict[str, Any] = {
        "scenario": {"name": "swing", "duration_s": len(angle) / 4800},
        "system": {"frequency_hz": 50, "base_kv": 230, "sampling_hz": 4800},
        "source": [
            {"name": "SX", "bus": "X", "z1_ohm": [1.18, 14.17], "z0_ohm": [1.77, 17.71]},
            {"name": "SC", "bus": "C", "z1_ohm": [3.48, 41.76], "z0_ohm": [6.96, 69.6]},
        ],
        "swing": [
            {
                "source": "SC",
                "at_s": [k / 4800 for k in points],
                "angle_deg": [float(angle[k]) for k in points],
            }
        ],
        "line": [{"name": a + b, "from": a, "to": b, "length_km": km, **line} for a, b, km in ends],
        "relay": [{"name": "RA", "line": "AB", "end": "from", "settings": "none"}],
        "fault": [{"line": "AB", "at_pu": at, "type": kind, "start_s": start_s}],
        "front_end": {"antialias_hz": 1500},
    }
    plant = Plant(Scenario.from_dict(data))
    rows = [plant.history(4800)[:, 0].copy()]
    while plant.sample_count < len(angle):
        plant.advance(len(angle) - plant.sample_count)
        rows.append(plant.samples[:, 0].copy())
    return np.concatenate(rows)


@pytest.mark.parametrize("kind", ["ABC", "ABCG"])
def test_a_three_phase_fault_in_a_swing_trips_where_lines_ring(kind: str) -> None:
    """Its loops do not stand still, as they ring: it was a swing again, for ever."""
    angle = -swings.stable(NETWORK, 3.0, 91.81, 0.7)
    found = trips(relay(BOXES), on_bergeron_lines(angle, kind, 0.774, 0.5123))
    assert found
    assert 0 < found[0][0] - 1.5123 < 0.06


def osc_relay(method: str, rpsb: dict[str, Any] | None) -> Relay:
    """The real relay's reach is not known; its zone 1 operated in this swing."""
    given = {
        "relay": {"frequency_hz": 50, "sampling_hz": 1200, "nominal_kv": 110},
        "estimator": {"method": method},
        "vt": {"kind": "ideal"},
        "line": {"z1_ohm": [5.0, 19.4], "z0_ohm": [15.0, 58.0]},
        "pdis": [
            {"zone": 1, "reach_pu": 1.4, "direction": "forward"},
            {"zone": 2, "reach_pu": 2.0, "delay_ms": 500.0},
            {"zone": 3, "reach_pu": 1.4, "direction": "none"},
        ],
        "rpsb": rpsb,
    }
    return Relay(RelaySettings.from_dict(given))


@pytest.mark.parametrize("method", ["kalman-bank", "fourier"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_real_swing_is_blocked_in_both_directions_of_the_current(
    records: Path, sign: float, method: str
) -> None:
    x = analog(records / "osc-swing-110kv", "2", "cp1251")
    samples = np.column_stack([*(1e3 * x[4:7]), *(sign * x[31:34])])
    boxes = {"outer_resistance_ohm": 60.0, "inner_resistance_ohm": 30.0}
    if (method, sign) != ("kalman-bank", 1.0):
        assert [e for e in play(osc_relay(method, None), samples) if e.trip], "without it a zone trips"
    events = play(osc_relay(method, boxes), samples)
    assert [e for e in events if e.trip] == [], events
    assert any("RPSB1 power swing" in e.text for e in events)


@pytest.mark.parametrize(
    ("table", "key", "words"),
    [
        ({}, "rpsb.outer_resistance_ohm", "missing"),
        ({"outer_resistance_ohm": 20.0, "inner_resistance_ohm": 30.0}, "rpsb", "below outer"),
        ({"outer_resistance_ohm": 15.0}, "rpsb.inner_resistance_ohm", "PDIS1 reaches 15"),
        ({"outer_resistance_ohm": 40.0, "total_ohm": 60.0, "inner_resistance_ohm": 20.0}, "rpsb", "either"),
        ({"outer_resistance_ohm": 40.0, "total_ohm": 60.0, "initial_slip_hz": 10.0, "crossing_ms": 40.0},
         "rpsb.total_ohm", "the rule"),
        ({"outer_resistance_ohm": 40.0, "slips": 2}, "rpsb", "way-out"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(table: dict[str, Any], key: str, words: str) -> None:
    with pytest.raises(InputError) as error:
        RelaySettings.from_dict(GIVEN | {"pdis": [{"zone": 1, "reach_ohm": 30.0}], "rpsb": table})
    assert (error.value.key or "").startswith(key)
    assert words in error.value.what


def test_the_rule_gives_the_inner_box() -> None:
    given = {"outer_resistance_ohm": 123.5, "total_ohm": 155.75}
    settings = RelaySettings.from_dict(GIVEN | {"rpsb": given})
    assert RPSB.values(settings, settings.rpsb)["inner"] == pytest.approx(75.9, abs=0.05)
