"""PHS by itself: the type of every fault from phasors of a network solved in phase coordinates."""

from __future__ import annotations

import pytest

from faultloop.relay.functions.phs import PHS, loops_of_both
from faultloop.relay.quantities import FAULTS, LOOPS
from tests.relay.functions.kernel import Kernel
from tests.relay.network import TYPES, Network

NETWORKS = {
    "strong": Network(),
    "weak": Network(zs1=20 + 300j, zs0=30 + 400j),
    "import": Network(angle_deg=20),
}
LOOP = {"ABG": "AB", "BCG": "BC", "CAG": "CA", "ABCG": "ABC"}
SIXTEENTH = 6  # samples of 96


def disturbed(network: Network, kind: str, at: float = 0.5, **fault: float) -> Kernel:
    """Just settled in the fault's state: nothing has moved within a snapshot, something within a cycle."""
    k = Kernel(PHS, {})
    k.disturb(network.solve(), network.solve(kind, at, **fault))
    k.q["memory"]["drift"], k.q["memory"]["moving"] = 0.0, 1
    return k


@pytest.mark.parametrize("network", NETWORKS)
@pytest.mark.parametrize("kind", TYPES)
def test_every_type_is_told(network: str, kind: str) -> None:
    for at in (-0.5, 0.05, 0.5, 0.95):
        k = disturbed(NETWORKS[network], kind, at)
        k.step(count=SIXTEENTH)
        wanted = LOOP.get(kind, kind)
        assert FAULTS[int(k.q["fault"])] == wanted, at
        released = {loop for bit, loop in enumerate(LOOPS) if int(k.q["pickup"]) >> bit & 1}
        assert released == ({"AB", "BC", "CA"} if wanted == "ABC" else {wanted})


@pytest.mark.parametrize("pair", ["AB", "BC", "CA"])
@pytest.mark.parametrize("ground", [0.0, 3.0, 10.0, 30.0, 100.0])
@pytest.mark.parametrize("network", NETWORKS)
@pytest.mark.parametrize("energised", [False, True])
def test_two_phases_to_ground_are_never_one(network: str, ground: float, pair: str, energised: bool) -> None:
    """A resistance to ground turns the zero sequence towards that of another phase's fault."""
    for at in (-0.5, 0.05, 0.5, 0.95):
        before = NETWORKS[network].solve()
        if energised:
            before[3:] = 0.0
        k = Kernel(PHS, {})
        k.disturb(before, NETWORKS[network].solve(f"{pair}G", at, ground=ground))
        k.q["memory"]["drift"], k.q["memory"]["moving"] = 0.0, 1
        k.step(count=SIXTEENTH)
        assert FAULTS[int(k.q["fault"])] == pair, at


@pytest.mark.parametrize("phase", range(3))
@pytest.mark.parametrize("charge", [0.0, 0.2, 0.4, 0.6])
def test_a_line_that_is_energised_takes_its_charge_in_the_healthy_phases(phase: int, charge: float) -> None:
    """Before: two phases from a quarter of the fault's change on."""
    network = NETWORKS["weak"]
    before, now = network.solve(), network.solve(f"{'ABC'[phase]}G", 0.6)
    before[3:] = 0.0
    taken = 1j * charge * max(abs(now[3:])) * before[:3] / abs(before[:3])
    now[3:] += taken
    now[:3] -= network.zs1 * taken
    k = Kernel(PHS, {})
    k.disturb(before, now)
    k.q["memory"]["drift"], k.q["memory"]["moving"] = 0.0, 1
    k.step(count=SIXTEENTH)
    assert FAULTS[int(k.q["fault"])] == f"{'ABC'[phase]}G"


def test_a_type_must_stand_for_a_sixteenth_of_a_cycle_or_half_a_cycle_while_it_moves() -> None:
    k = disturbed(NETWORKS["strong"], "AG")
    k.step(count=SIXTEENTH - 1)
    assert (k.q["fault"], k.q["pickup"]) == (0, 0)
    k = disturbed(NETWORKS["strong"], "AG")
    k.q["memory"]["drift"] = float("inf")
    k.step(count=47)
    assert k.q["fault"] == 0
    k.step()
    assert FAULTS[int(k.q["fault"])] == "AG"


def test_a_pole_that_is_open_or_carries_nothing_has_no_loops() -> None:
    k = disturbed(NETWORKS["strong"], "ABC")
    k.q["dead"] = 0b001
    k.step(count=SIXTEENTH)
    assert int(k.q["released"]) == 1 << LOOPS.index("BC")
    k.q["dead"] = 0b100
    k.step()
    assert int(k.q["released"]) == 1 << LOOPS.index("AB")


def test_at_rest_there_is_no_fault() -> None:
    k = disturbed(NETWORKS["strong"], "BC")
    k.step(count=SIXTEENTH)
    k.q["disturbed"] = 0
    k.step()
    assert (k.q["fault"], k.q["released"], k.q["pickup"]) == (0, 0, 0)


def second(first: str, side: int, kind: str, energy: int) -> Kernel:
    """A fault that has settled, on this side; then ``kind``, the change against it, with such an energy."""
    network = NETWORKS["strong"]
    k = disturbed(network, first)
    k.q["direction"] = side
    k.step(count=SIXTEENTH)
    k.q["second"]["settled"] = 1
    k.step()
    k.q["second"]["active"], k.q["second"]["energy"]["direction"] = 1, energy
    k.q["second"]["reference"] = network.solve(first)
    k.q["second"]["d"] = network.solve(kind) - network.solve()
    k.q["x"] = k.q["second"]["reference"] + k.q["second"]["d"]
    return k


def test_a_second_fault_ahead_of_one_behind() -> None:
    k = second("AG", -1, "BC", 1)
    k.step(count=SIXTEENTH)
    assert (FAULTS[int(k.q["crossed"])], FAULTS[int(k.q["fault"])]) == ("BC", "BC")
    assert (int(k.q["behind"]), int(k.q["released"])) == (0b001, 1 << LOOPS.index("BC"))


def test_a_second_fault_ahead_of_one_ahead_releases_both_ones_loops() -> None:
    k = second("AG", 1, "BG", 1)
    k.step(count=SIXTEENTH)
    assert (int(k.q["crossed"]), int(k.q["behind"])) == (0, 0)
    assert int(k.q["released"]) == sum(1 << LOOPS.index(loop) for loop in ("AG", "BG", "AB"))


def test_what_changes_behind_holds_its_phases_back() -> None:
    """For good, and so only what has stood still for an eighth of a cycle: an estimator that begins anew
    holds its phasors for a twelfth."""
    k = second("AG", 1, "AG", -1)
    k.g["ideal_vt"] = 1
    k.q["memory"]["drift"] = 0.0
    k.step(count=2 * SIXTEENTH - 1)
    assert int(k.q["from_behind"]) == 0
    k.step()
    assert (int(k.q["from_behind"]), int(k.q["crossed"])) == (0b001, 0)


def test_what_changes_in_the_phases_of_the_first_is_no_second_fault() -> None:
    """It clears, or an infeed goes: from ahead of the relay, while the fault is behind."""
    k = second("ABG", -1, "AG", 1)
    k.step(count=SIXTEENTH)
    assert (int(k.q["crossed"]), FAULTS[int(k.q["fault"])]) == (0, "AB")


def test_a_fault_of_two_phases_of_which_one_is_behind_waits_for_a_cycle() -> None:
    """Two faults at once, one on each side, look like one of two phases: zone 1 must not have it at once."""
    network = NETWORKS["strong"]
    k = disturbed(network, "ABG")
    k.q["d"][4] *= -1.0  # phase B's current comes from the line
    k.step(count=48)
    assert k.q["fault"] == 0
    k.step()
    assert FAULTS[int(k.q["fault"])] == "AG" and int(k.q["behind"]) == 0b010
    k = disturbed(network, "ABG")
    k.q["d"][4] *= -1.0
    k.q["memory"]["drift"] = float("inf")  # it never stands still, and is taken as it looks
    k.step(count=96)
    assert k.q["fault"] == 0
    k.step()
    assert FAULTS[int(k.q["fault"])] in ("AB", "BC", "CA")


@pytest.mark.parametrize(
    ("first", "second", "loops"),
    [
        ("BG", "CG", {"BG", "CG", "BC"}),  # the second may be B-C, of which B is held
        ("AG", "BC", {"AG", "BC", "AB", "CA"}),
        ("AB", "AB", {"AB"}),
        ("BC", "CA", {"BC", "CA", "AB"}),
        ("ABC", "AG", {"AB", "BC", "CA", "AG"}),
    ],
)
def test_of_two_faults_ahead_the_pairs_between_them_count(first: str, second: str, loops: set[str]) -> None:
    mask = loops_of_both(FAULTS.index(first), FAULTS.index(second))
    assert {loop for bit, loop in enumerate(LOOPS) if mask >> bit & 1} == loops
