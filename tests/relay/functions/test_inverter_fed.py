"""Direction and depth of faults that inverters feed: by magnitudes, by the loop's own current."""

from __future__ import annotations

import cmath
import math
from typing import Any

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.relay import RelaySettings
from faultloop.relay.characteristics import quad_measures
from faultloop.relay.functions.pdis import PDIS
from faultloop.relay.functions.rdir import RDIR
from faultloop.relay.quantities import FAULTS
from tests.relay.functions.kernel import GIVEN, Kernel
from tests.relay.functions.test_phs import LOOP
from tests.relay.network import TYPES, Network

CYCLE, EIGHTH = 96, 12
AHEAD = abs(Network().z1 + Network().zr1)
BEHIND = abs(Network().zs1)
SIDES = {
    "behind": {"inverters": "behind", "source_ohm": AHEAD},
    "ahead": {"inverters": "ahead", "source_ohm": BEHIND},
}
TURN = np.exp(2j * np.pi / 3 * np.arange(3))


def ratio(before: np.ndarray, now: np.ndarray) -> float:
    """|dV| / |dI| of positive and negative sequence [ohm]."""
    v, i = ([abs(turn @ half) for turn in (TURN, TURN.conj())] for half in np.split(now - before, 2))
    return math.hypot(*v) / math.hypot(*i)


@pytest.mark.parametrize("kind", TYPES)
@pytest.mark.parametrize("resistance", [0.0, 5.0, 100.0])
def test_the_ratio_of_the_changes_is_the_impedance_on_the_far_side_of_the_relay(
    kind: str, resistance: float
) -> None:
    """Whatever the fault and its resistance: what the direction for inverters rests on."""
    network = Network()
    load = network.solve()
    given = {"resistance": resistance, "ground": resistance}
    assert ratio(load, network.solve(kind, -0.5, **given)) == pytest.approx(AHEAD, rel=1e-6)
    for at in (0.02, 0.5, 0.98):
        assert ratio(load, network.solve(kind, at, **given)) == pytest.approx(BEHIND, rel=1e-6)


def fault(before: np.ndarray, now: np.ndarray, kind: str, side: str) -> Kernel:
    k = Kernel(RDIR, SIDES[side])
    k.disturb(before, now, CYCLE + 1)
    k.q["fault"] = FAULTS.index(LOOP.get(kind, kind))
    return k


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("kind", TYPES)
def test_from_the_synchronous_side_it_is_as_anywhere(kind: str, side: str) -> None:
    """The source behind is 12 ohm and what is ahead 48: with inverters ahead a fault behind is theirs."""
    network = Network()
    for at, direction in ((0.02, 1), (0.98, 1), (-0.5, -1)):
        k = fault(network.solve(), network.solve(kind, at), kind, side)
        k.step(count=2 * EIGHTH)
        assert k.q["direction"] == direction, at


@pytest.mark.parametrize(("side", "direction"), [("behind", 1), ("ahead", -1)])
@pytest.mark.parametrize("angle_deg", range(0, 360, 45))
def test_from_inverters_it_is_away_from_them_whatever_the_angle(
    side: str, direction: int, angle_deg: int
) -> None:
    """250 A of load that become 300 A at any angle, with 2 % of a negative sequence at another, while a phase
    loses its voltage; what energy and impedances say of it does not count."""
    before = np.r_[132e3 * TURN.conj(), 250.0 * TURN.conj()]
    now = before.copy()
    now[0] = 0.1 * before[0]
    now[3:] = 300.0 * TURN.conj() * cmath.rect(1, math.radians(angle_deg)) + 6.0j * TURN
    k = fault(before, now, "AG", side)
    for said in (1, -1):
        k.q["energy"]["direction"] = said
        k.step(count=EIGHTH - 1)
        assert k.q["direction"] == 0
        k.step(count=CYCLE)
        assert k.q["direction"] == direction
        k = fault(before, now, "AG", side)


def test_a_source_that_changes_is_waited_for() -> None:
    network = Network()
    load, now = network.solve(), network.solve("BC", 0.5)
    k = fault(load, now, "BC", "behind")
    k.step(count=2 * EIGHTH)
    k.disturb(load, np.r_[now[:3], load[3:] + 5.0], CYCLE + 30)  # the far end has opened: no current is left
    k.step(count=EIGHTH - 1)
    assert k.q["direction"] == 0
    k.step()
    assert k.q["direction"] == 1


@pytest.mark.parametrize("loop", range(6))
def test_the_loops_own_current_gives_place_and_resistance_whatever_feeds_it(loop: int) -> None:
    """Currents at random, as of a control; the voltages are those of 0.6 of the line and a resistance."""
    rng = np.random.default_rng(loop)
    table = {"zone": 1, "characteristic": "quad", "polarization": "loop", "tilt_deg": 0.0}
    k = Kernel(PDIS, table | {"reach_pu": 0.8, "resistive_reach_ohm": 10.0})
    z1, z0 = complex(*GIVEN["line"]["z1_ohm"]), complex(*GIVEN["line"]["z0_ohm"])
    k0 = (z0 - z1) / (3 * z1)
    currents = rng.normal(size=3) + 1j * rng.normal(size=3)
    first, second = ((0, 1), (1, 2), (2, 0))[loop % 3]
    i = currents[loop] + k0 * currents.sum() if loop < 3 else currents[first] - currents[second]
    through = i / (1 + k0) if loop < 3 else i  # the fault's: without infeed from the far end
    v = 0.6 * z1 * i + 4.0 * through
    k.disturb(np.zeros(6), np.zeros(6))
    m, r = quad_measures(k.g, k.q, k.c, loop, v, i, k.c.tilt)
    if loop < 3:  # across the resistance the reach's own angle and 1 + k0 are 4 degrees apart
        assert m == pytest.approx(0.75, abs=0.02)
    else:
        assert m == pytest.approx(0.75, abs=1e-9)
    assert r == pytest.approx(4.0, abs=1e-6)


@pytest.mark.parametrize(
    ("tables", "key", "what"),
    [
        (
            {"rdir": {"inverters": "behind"}},
            "rdir",
            'inverters = "behind" or "ahead" and source_ohm go together',
        ),
        (
            {"rdir": {"source_ohm": 40.0}},
            "rdir",
            'inverters = "behind" or "ahead" and source_ohm go together',
        ),
        (
            {"rdir": {"inverters": "behind", "source_ohm": 20.0}},
            "rdir.source_ohm",
            "must be the whole line, 30.15 ohm, with what is ahead of it, as the inverters are behind;"
            " not 20",
        ),
        (
            {"pdis": [{"zone": 1, "reach_pu": 0.8, "polarization": "loop"}]},
            "pdis",
            'polarization = "loop" belongs to characteristic = "quad"',
        ),
        (
            {
                "pdis": [
                    {"zone": 1, "reach_pu": 0.8, "characteristic": "quad", "resistive_reach_ohm": 5.0}
                    | {"polarization": "memory"}
                ]
            },
            "pdis",
            'polarization = "memory" belongs to characteristic = "mho"',
        ),
    ],
)
def test_what_is_wrong_is_named(tables: dict[str, Any], key: str, what: str) -> None:
    with pytest.raises(InputError) as error:
        RelaySettings.from_dict(GIVEN | tables)
    assert (error.value.key or "").startswith(key)
    assert error.value.what == what
