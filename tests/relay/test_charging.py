"""A line's charging in the depth of a zone that ends on it, against the exact equations of a long line."""

from __future__ import annotations

import cmath
from typing import Any

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.relay import Relay, RelaySettings
from faultloop.relay.charging import charge_in_time, charging_voltage
from faultloop.relay.functions.pdif import PDIF, agreement
from faultloop.relay.functions.pdis import PDIS, charged_part
from faultloop.relay.loop_fit import fit, gather
from faultloop.relay.relay import records_of
from faultloop.relay.zone_depth import by_characteristic, depth_alone, depth_in_time, is_charged
from tests.relay.functions.kernel import Kernel

TURN = np.exp(-2j * np.pi / 3 * np.arange(3))
PHASES = np.column_stack([TURN**0, TURN, TURN**2])  # phases of zero, positive and negative sequence
LOOPS = {"AG": 0, "BG": 1, "CG": 2, "AB": 3, "BC": 4, "CA": 5}
LINE = {"z1_ohm": [12.0, 120.0], "z0_ohm": [80.0, 380.0]}
CHARGED = LINE | {"b1_us": 2200.0, "b0_us": 1300.0}
"""400 km at 60 Hz: theta^2 is -0.26 and -0.5."""
SHAPES: dict[str, dict[str, Any]] = {
    "mho": {},
    "quad": {"characteristic": "quad", "resistive_reach_ohm": 40.0},
}


def sequences(part: float, turn: float = 1.0) -> list[tuple[complex, complex]]:
    """Z and Y of the zero, positive and negative sequence of a part of the line."""
    found = []
    for n in (0, 1, 1):
        r, x = CHARGED[f"z{n}_ohm"]
        found.append((part * complex(r, turn * x), part * complex(0.0, turn * CHARGED[f"b{n}_us"] * 1e-6)))
    return found


def at_the_relay(v: np.ndarray, i: np.ndarray, part: float, turn: float = 1.0) -> np.ndarray:
    """va vb vc ia ib ic of sequence quantities (0, 1, 2) at ``part`` of the line, current towards it."""
    own = np.empty((2, 3), complex)
    for n, (z, y) in enumerate(sequences(part, turn)):
        theta, surge = cmath.sqrt(z * y), cmath.sqrt(z / y)
        own[0, n] = v[n] * cmath.cosh(theta) + i[n] * surge * cmath.sinh(theta)
        own[1, n] = v[n] / surge * cmath.sinh(theta) + i[n] * cmath.cosh(theta)
    return np.concatenate([PHASES @ own[0], PHASES @ own[1]])


def drawn(kind: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Sequence voltages and currents at a bolted fault, whatever the network on both sides: in its loop there
    is no voltage."""
    phases = rng.normal(scale=100e3, size=3) + 1j * rng.normal(scale=100e3, size=3)
    if kind.endswith("G"):
        phases["ABC".index(kind[0])] = 0.0
    else:
        phases["ABC".index(kind[1])] = phases["ABC".index(kind[0])]
    i = rng.normal(scale=800.0, size=3) + 1j * rng.normal(scale=800.0, size=3)
    return np.linalg.solve(PHASES, phases), i


@pytest.mark.parametrize("kind", LOOPS)
def test_at_the_reach_a_bolted_fault_has_no_voltage_whatever_the_network(kind: str) -> None:
    rng, loop = np.random.default_rng(5), LOOPS[kind]
    for part in (0.3, 0.8, 0.95):
        for turn in (0.9, 1.0, 1.1):
            k = Kernel(PDIS, {"zone": 1, "reach_pu": part}, line=CHARGED)
            k.q["memory"]["frequency"] = 50.0 * turn
            x = k.q["x"][:] = at_the_relay(*drawn(kind, rng), part, turn)
            z1, k0 = complex(*LINE["z1_ohm"]), k.c["k0"]
            if loop < 3:
                v, i0 = x[loop], x[3:].sum() / 3
                z0 = complex(*LINE["z0_ohm"])
                drop = part * sum(complex(z.real, turn * z.imag) * i
                                  for z, i in ((z1, x[3 + loop] - i0), (z0, i0)))  # fmt: skip
                assert k0 == pytest.approx((z0 - z1) / (3 * z1))
            else:
                first, second = "ABC".index(kind[0]), "ABC".index(kind[1])
                v, i = x[first] - x[second], x[3 + first] - x[3 + second]
                drop = part * complex(z1.real, turn * z1.imag) * i
            assert abs(v + charging_voltage(k.g, k.q, part, loop) - drop) < 1e-6 * abs(x[:3]).max()
            assert abs(v - drop) > 1e-4 * abs(x[:3]).max()  # and without it has


def depths(shape: str, at: float) -> np.ndarray:
    """(300, 2): m of bolted A-G faults at ``at`` of the line in a zone of 80 %, told the charging and not,
    whatever the network on both sides."""
    rng, found = np.random.default_rng(7), []
    for _ in range(300):
        v, i = drawn("AG", rng)
        x, both = at_the_relay(v, 0.3 * i, at), []
        for line in (CHARGED, LINE):
            k = Kernel(PDIS, {"zone": 1, "reach_pu": 0.8} | SHAPES[shape], line=line)
            k.q["x"][:] = x
            sequences = [np.linalg.solve(PHASES, x[:3]), np.linalg.solve(PHASES, x[3:])]
            k.q["sequence"][:] = np.concatenate(sequences)
            k.q["polarizing"] = k.q["sequence"][1]
            both.append(by_characteristic(k.g, k.q, k.c, 0, x[0], x[3] + k.c["k0"] * x[3:].sum()))
        found.append(both)
    return np.array(found)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_bolted_fault_at_the_reach_is_not_inside_and_one_before_it_is(shape: str) -> None:
    """Where the charging is not told 34 of 300 at the reach are inside, down to a half of it."""
    told, plain = depths(shape, 0.8).T
    near = (plain > 0.3) & (plain < 1.0)
    assert near.sum() > 30 and plain[near].min() < 0.6
    assert (told[near] > 1.0).all()
    assert (told[plain >= 1.0] == plain[plain >= 1.0]).all()
    for at in (0.02, 0.1, 0.3, 0.6):
        told, plain = depths(shape, at).T
        inside = (plain > -0.15) & (plain < 1.0)
        assert (told[inside] < 1.0).mean() > 0.97, at


def test_it_takes_nothing_off() -> None:
    """Where the charging makes a fault look farther (a three-phase one always) a zone stays as it is."""
    k = Kernel(PDIS, {"zone": 1, "reach_pu": 0.8}, line=CHARGED)
    x = k.q["x"][:] = at_the_relay(np.zeros(3, complex), np.array([0.0, 900.0 - 300j, 0.0]), 0.78)
    k.q["polarizing"] = x[0]
    told = by_characteristic(k.g, k.q, k.c, 3, x[0] - x[1], x[3] - x[4])
    k.c["charged"] = 0.0
    assert told == by_characteristic(k.g, k.q, k.c, 3, x[0] - x[1], x[3] - x[4])
    assert told > 0.78 / 0.8


def test_zones_that_end_on_the_line_have_it() -> None:
    data = {"relay": {"frequency_hz": 50}, "line": CHARGED}
    zones = ({"reach_pu": 0.8}, {"reach_ohm": 60.0}, {"reach_pu": 1.2},
             {"reach_pu": 0.5, "direction": "reverse"}, {"reach_pu": 0.5, "direction": "none"})  # fmt: skip
    told = RelaySettings.from_dict(data | {"pdis": [{"zone": 1, "delay_ms": 500.0} | zone for zone in zones]})
    parts = [charged_part(told, zone) for zone in told.pdis]
    assert parts == pytest.approx([0.8, 60.0 / abs(complex(*LINE["z1_ohm"])), 0.0, 0.0, 0.0])
    plain = RelaySettings.from_dict(data | {"line": LINE, "pdis": [{"zone": 1, "reach_pu": 0.8}]})
    assert charged_part(plain, plain.pdis[0]) == 0.0


def test_susceptances_are_primary_where_ohms_are_secondary() -> None:
    head = {"frequency_hz": 50, "ohms": "secondary", "ct_ratio": 240, "vt_ratio": 2000}
    own = {key: [v * 240 / 2000 for v in z] for key, z in LINE.items()} | {"b1_us": 2200.0, "b0_us": 1300.0}
    relay = Relay(
        RelaySettings.from_dict({"relay": head, "line": own, "pdis": [{"zone": 1, "reach_pu": 0.8}]})
    )
    constants = records_of(relay)[0][0]
    assert (constants["shared"]["b1"], constants["shared"]["b0"]) == pytest.approx((2.2e-3, 1.3e-3))
    assert constants["pdis"][0]["charged"] == pytest.approx(0.8)


def test_the_differential_takes_that_of_the_line_where_it_has_none_of_its_own() -> None:
    pdif = {"pickup_a": 200.0}
    own = {"relay": {"frequency_hz": 50}, "line": LINE, "pdif": pdif | {"b1_us": 2200.0, "b0_us": 1300.0}}
    line = own | {"line": CHARGED, "pdif": pdif}
    none = own | {"line": CHARGED, "pdif": pdif | {"b1_us": 0.0, "b0_us": 0.0}}
    a, b, c = (RelaySettings.from_dict(data) for data in (own, line, none))
    assert agreement(a) == agreement(b) != agreement(c)
    found = [[PDIF.values(s, s.pdif)[key] for key in ("b1", "b0")] for s in (a, b, c)]
    assert found[0] == pytest.approx([2.2e-3, 1.3e-3])
    assert found == [found[0], found[0], [0.0, 0.0]]


@pytest.mark.parametrize(
    ("given", "key", "said"),
    [
        ({"b1_us": 2200.0}, "line", "b1_us and b0_us, or neither"),
        ({"b0_us": 2200.0}, "line", "b1_us and b0_us, or neither"),
        ({"b1_us": 1300.0, "b0_us": 2200.0}, "line", "at most b1_us, 1300"),
        ({"b1_us": -1.0, "b0_us": 1.0}, "line.b1_us", "greater than 0"),
        ({"b1_us": 0.0, "b0_us": 0.0}, "line.b1_us", "greater than 0"),
        ({"b1_us": 22000.0, "b0_us": 13000.0}, "line.b1_us", "must be below 8.29e+03"),
    ],
)
def test_susceptances_that_are_none(given: dict[str, float], key: str, said: str) -> None:
    with pytest.raises(InputError) as error:
        RelaySettings.from_dict({"relay": {"frequency_hz": 50}, "line": LINE | given})
    assert (error.value.key, said in error.value.what) == (key, True), error.value


def sampled(kind: str, at: float, hertz: list[float]) -> np.ndarray:
    """(n, 6) samples at 4800 Hz of a bolted fault at ``at`` of `CHARGED` without its losses, with several
    frequencies, whatever the network on both sides."""
    rng, t = np.random.default_rng(11), np.arange(2 * 96) / 4800
    out = np.zeros((len(t), 6))
    for k, f in enumerate(hertz):
        v, i = drawn(kind, rng)
        own = np.empty((2, 3), complex)
        for n in range(3):
            name = "0" if n == 0 else "1"
            x, b = CHARGED[f"z{name}_ohm"][1], CHARGED[f"b{name}_us"] * 1e-6
            theta, surge = at * f / 50 * np.sqrt(x * b), np.sqrt(x / b)
            own[:, n] = (np.cos(theta) * v[n] + 1j * surge * np.sin(theta) * i[n],
                         1j * np.sin(theta) / surge * v[n] + np.cos(theta) * i[n])  # fmt: skip
        phasors = np.concatenate([PHASES @ own[0], PHASES @ own[1]])
        out += (phasors * np.exp(2j * np.pi * f * t)[:, None]).real * 0.5**k
    return out


@pytest.mark.parametrize("kind", LOOPS)
def test_the_fit_in_time_finds_the_place_on_a_line_that_rings(kind: str) -> None:
    """400 km, 50, 90 and 140 Hz: without the charging five times as much
    is left and more."""
    loop = LOOPS[kind]
    k = Kernel(PDIS, {"zone": 1, "reach_pu": 0.8}, line=CHARGED)
    g = k.g.copy()
    g["z1"], g["z0"] = 1j * g["z1"].imag, 1j * g["z0"].imag
    k0 = (g["z0"] - g["z1"]) / (3 * g["z1"])
    recent = k.q["recent"]
    for at in (0.2, 0.4, 0.6, 0.75):
        x = sampled(kind, at, [50.0, 90.0, 140.0])
        recent["value"][:144], recent["value"][144:], recent["head"] = 0.0, 0.0, 143
        recent["value"][:144, :6] = x[:144]
        drop = (g["z1"], k0 * g["z1"])
        plain = fit(gather(g, recent, drop, loop, (12, 12, 12), 70), 1)
        found = plain
        for _ in range(4):
            charge = charge_in_time(g, found[0], loop)
            found = fit(gather(g, recent, drop, loop, (12, 12, 12), 70, charge), 1)
        assert found[0] == pytest.approx(at, abs=0.01), (at, plain, found)
        assert found[1] < 0.02, (at, plain, found)
        assert at < 0.5 or plain[1] > 5 * found[1]


@pytest.mark.parametrize("at", [0.0, 0.03, 0.05])
@pytest.mark.parametrize("told", [LINE, CHARGED])
def test_behind_the_relay_the_fit_with_the_charging_is_no_nearer_than_the_memory_lets_it(
    told: dict[str, Any], at: float
) -> None:
    """A bolted B-C fault behind, with the direction forced: the fit alone has m of nothing to -0.05, and was
    inside without a characteristic once."""
    volts = 230e3
    i = -volts * np.array([0, -1j, 1j]) * np.sqrt(3) / 2 / (1.5 * complex(*LINE["z1_ohm"]))
    half = -at * complex(*LINE["z1_ohm"]) * (i[1] - i[2]) / 2
    v = np.array([volts, -volts / 2 + half, -volts / 2 - half])
    k = Kernel(PDIS, {"zone": 1, "reach_pu": 0.8}, line=told, vt={"kind": "ideal"})
    k.disturb(np.concatenate([volts * TURN, 300.0 * TURN]), np.concatenate([v, i]), age=140)
    for key, value in {"direction": 1, "fault": 5, "released": 16, "polarizing": volts}.items():
        k.q[key] = value
    assert depth_alone(k.g, k.q, k.c, 4) == np.inf
    k.w.fault, k.w.counter = 5, 1.0
    for _ in range(60):
        k.step(count=1, direction=1, fault=5, released=16, polarizing=volts)
        assert not k.w.pickup


def test_where_nothing_rings_the_charging_takes_nothing_off_by_the_fit() -> None:
    """Sinusoids alone: the fit without leaves nothing, and is outside."""
    k = Kernel(PDIS, {"zone": 1, "reach_pu": 0.8}, line=CHARGED, vt={"kind": "ideal"})
    k.disturb(np.zeros(6, complex), np.zeros(6, complex), age=140)
    fits = (1.02, 0.001, 0.0), (1.02, 0.2, 0.0), (0.9, 0.001, 0.0)
    assert [is_charged(k.g, k.q, k.c, fit) for fit in fits] == [False, True, True]
    assert not is_charged(k.g, k.q, k.c, (-0.05, 0.2, 0.0))  # behind nothing is known of the line


def test_a_fit_of_two_equations_does_not_stand_alone() -> None:
    """Ten values a cycle and two fifths of one: two unknowns fit whatever there is."""
    k = Kernel(PDIS, {"zone": 1, "reach_pu": 0.8}, line=CHARGED, vt={"kind": "ideal"})
    volts = 230e3
    x = np.concatenate([volts * np.array([1, -0.5 - 0.1j, -0.5 + 0.1j]), 900.0 * np.array([0, -1, 1])])
    k.disturb(np.concatenate([volts * TURN, 300.0 * TURN]), x, age=140)
    for key, value in {"direction": 1, "fault": 5, "released": 16, "polarizing": volts}.items():
        k.q[key] = value
    whole = depth_alone(k.g, k.q, k.c, 4)
    assert whole < 1.0 and depth_in_time(k.g, k.q, k.c, 4, 4.0) < 1.0
    k.g["values"] = k.g["cycle"] = 10
    k.q["memory"]["age"] = 4
    assert depth_alone(k.g, k.q, k.c, 4) == np.inf
