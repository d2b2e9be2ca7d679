"""PIOC, and the direction that it shares with PTOC."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.relay import RelaySettings
from faultloop.relay.functions.function import Function
from faultloop.relay.functions.pioc import PIOC
from faultloop.relay.functions.ptoc import PTOC
from tests.relay.functions.kernel import GIVEN, TURN, Kernel
from tests.relay.network import TYPES, Network

NETWORK = Network()
FORWARD = {"direction": "forward"}
ALONE = {"quantity": "phase", "pickup_a": 300.0}


def stage(**table: object) -> Kernel:
    return Kernel(PIOC, {"pickup_a": 100.0} | table)


def test_it_operates_when_it_has_stood_and_drops_out_below_the_ratio() -> None:
    k = stage(confirm_ms=2.0)  # 10 samples
    x = np.zeros(6, complex)
    x[4] = 101.0
    k.step(x, count=10)
    assert (k.q["pickup"], k.q["operate"]) == (1, 0)
    k.step()
    assert (k.q["operate"], k.q["request"]["made"], k.q["request"]["three_pole"]) == (1, 1, 1)
    x[4] = 96.0
    k.step(x, count=20)
    assert k.q["operate"] == 1
    x[4] = 94.0
    k.step(x)
    assert (k.q["pickup"], k.q["operate"]) == (0, 0)


def test_a_single_sample_does_not_operate() -> None:
    k = stage()
    for _ in range(5):
        k.step(np.r_[np.zeros(3), 1000.0, 0, 0], count=9)
        k.step(np.zeros(6))
    assert k.q["operate"] == 0


def test_an_emergency_stage_is_there_only_while_the_fuse_has_failed() -> None:
    x = np.r_[np.zeros(3), 1000.0 * TURN]
    k = Kernel(PIOC, {"pickup_a": 100.0, "when": "fuse-failure"}, tvtr={})
    k.step(x, count=50)
    assert k.q["pickup"] == 0
    k.step(x, count=50, fuse_failure=1)
    assert k.q["operate"] == 1


def test_an_emergency_stage_is_there_while_no_voltage_is_proven() -> None:
    """All three lost without load: no fuse failure that can be told from a dead line, but no voltage
    either."""
    x = np.r_[np.zeros(3), 1000.0 * TURN]
    k = Kernel(PIOC, {"pickup_a": 100.0, "when": "fuse-failure"}, tvtr={})
    k.q["proven"] = 0b100
    k.step(x, count=50)
    assert k.q["pickup"] == 0
    k.q["proven"] = 0
    k.step(x, count=50)
    assert k.q["operate"] == 1


@pytest.mark.parametrize(("polarization", "operates"), [("block", 0), ("non-directional", 1)])
def test_what_a_directional_stage_does_without_voltage(polarization: str, operates: int) -> None:
    k = stage(without_voltage=polarization, **FORWARD)
    k.step(NETWORK.solve("ABC", -0.1), count=50, fuse_failure=1)  # behind
    assert k.q["operate"] == operates


@pytest.mark.parametrize("function", [PIOC, PTOC], ids=["PIOC", "PTOC"])
@pytest.mark.parametrize("kind", TYPES)
@pytest.mark.parametrize("at", [0.02, 0.9, -0.02])
def test_every_type_of_fault_has_its_side(function: Function, kind: str, at: float) -> None:
    """Phases by quadrature, 3I0 by V0 where there is ground, by V2 where it is not balanced, I2 by V2."""
    stages = [{"quantity": "phase", "pickup_a": 1500.0}]
    if kind.endswith("G") and not kind.startswith("ABC"):
        stages += [
            {"quantity": "residual", "pickup_a": 200.0},
            {"quantity": "residual", "pickup_a": 200.0, "polarization": "negative-sequence"},
        ]
    if not kind.startswith("ABC"):
        stages += [{"quantity": "negative-sequence", "pickup_a": 100.0}]
    for table in stages:
        for direction, side in (("forward", 1), ("reverse", -1)):
            k = Kernel(function, table | {"direction": direction, "minimum_polarizing_v": 500.0})
            k.disturb(NETWORK.solve(), NETWORK.solve(kind, at))
            k.step(count=20)
            assert k.q["pickup"] == (side * at > 0), (table, direction)


def test_a_memory_polarizes_a_three_phase_fault_close_in_and_the_last_direction_stands_after_it() -> None:
    for at, direction in ((0.0, "forward"), (-1e-9, "reverse")):
        k = stage(direction=direction, minimum_polarizing_v=2000.0)
        k.disturb(NETWORK.solve(), NETWORK.solve("ABC", at))
        k.step(count=20)
        assert k.q["operate"] == 1
        k.q["memory"]["age"] = 10_000
        k.step(count=20)
        assert k.q["operate"] == 1
        other = stage(
            direction="reverse" if direction == "forward" else "forward", minimum_polarizing_v=2000.0
        )
        other.disturb(NETWORK.solve(), NETWORK.solve("ABC", at))
        other.step(count=20)
        assert other.q["pickup"] == 0


def test_without_any_voltage_a_directional_stage_does_not_start() -> None:
    k = stage(**FORWARD)
    k.step(np.r_[np.zeros(3), 1000.0 * TURN], count=20)
    assert k.q["pickup"] == 0


@pytest.mark.parametrize("key", ["pioc", "ptoc"])
@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"polarization": "quadrature"}, "direction"),
        ({"characteristic_angle_deg": 30.0}, "direction"),
        ({"direction": "forward", "polarization": "zero-sequence"}, "quadrature"),
        ({"direction": "forward", "quantity": "residual", "polarization": "quadrature"}, "zero-sequence"),
        ({"direction": "forward", "sector_deg": 120.0}, "90"),
        ({"when": "fuse-failure"}, "[tvtr]"),
    ],
)
def test_what_is_wrong_is_named(key: str, table: dict, words: str) -> None:
    with pytest.raises(InputError) as error:
        RelaySettings.from_dict(GIVEN | {key: [{"pickup_a": 100.0} | table]})
    assert (error.value.key or "").startswith(f"{key}[1]")
    assert words in error.value.what
