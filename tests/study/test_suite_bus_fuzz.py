"""The fuzz of a breaker node, small; and that it finds what it looks for."""

from __future__ import annotations

from itertools import combinations

import pytest

from faultloop.io.can.frames import Frame, Rejection, State, decode
from faultloop.io.can.table import Kind
from faultloop.nodes.goose import Subscriber
from faultloop.study.suites import run_suite
from faultloop.study.suites.bus.fuzz import ATTACKS, CONFIGURATIONS, fuzz
from faultloop.study.suites.bus.residual import undetected, undetected_bursts


@pytest.mark.parametrize("name", list(CONFIGURATIONS))
def test_nothing_operates_and_every_genuine_command_does_once(name: str) -> None:
    outcome = fuzz(10_000, seed=7, **CONFIGURATIONS[name])
    assert outcome.operations == []
    assert set(outcome.genuine.values()) == {1} and len(outcome.genuine) == 2  # a trip and a close in 1 s
    refused = outcome.refused.total()
    assert outcome.frames.total() == 10_000 == refused + outcome.passed_over + outcome.accepted
    assert all(
        outcome.causes[kind].total() == outcome.frames[kind] for kind in ("truncated", "1 to 20 s old")
    )


def test_it_is_deterministic_by_seed() -> None:
    first, second, other = (fuzz(2000, seed=seed, authenticated=True) for seed in (1, 1, 2))
    assert first == second and first != other


def test_a_plain_node_obeys_a_forger_and_the_fuzz_says_so() -> None:
    """What keys are for, and that an operation would be found."""
    outcome = fuzz(200, seed=1, authenticated=False, fuzzers={"forged": ATTACKS["plain trip"]})
    assert outcome.operations


def test_an_authenticated_node_obeys_who_has_the_key_and_the_fuzz_says_so() -> None:
    def with_the_key(w):
        return w.seal(bytes(range(16))).close(w.t_ns, w.command(Kind.TRIP).encode())

    outcome = fuzz(200, seed=1, authenticated=True, fuzzers={"forged": with_the_key})
    assert outcome.operations


def test_the_unseen_patterns_are_those_that_decode_finds() -> None:
    frame = State(Kind.TRIP, 0, 0, 9, 3, 5, 123_456).encode()
    whole = int.from_bytes(frame.data, "little")

    def unseen(pattern: tuple[int, ...]) -> bool:
        wrong = whole ^ sum(1 << bit for bit in pattern)
        return decode(Frame(frame.id, wrong.to_bytes(8, "little"))) is not Rejection.CRC

    # Every eighth bit and the first two bytes: enough patterns of three to have some unseen.
    some = sorted({*range(16), *range(17, 64, 3)})
    found = {p for p in undetected(3) if set(p) <= set(some)}
    assert found == {p for p in combinations(some, 3) if unseen(p)} and found
    assert all(unseen(pattern) for pattern in undetected_bursts())
    assert undetected(2) == []


def test_no_three_bits_and_no_burst_turn_an_idle_frame_into_a_trip() -> None:
    patterns = [*undetected(3), *undetected_bursts()]
    for st_num in range(0, 256, 5):
        last = State(Kind.TRIP, 0, 0, st_num, 9, 3, 100_000)
        subscriber = Subscriber()
        assert subscriber.receive(last, 1_000_000_000) is True
        frame = last._replace(sq_num=10, counter=4, time=200_000).encode()
        whole = int.from_bytes(frame.data, "little")
        for pattern in patterns:
            wrong = (whole ^ sum(1 << bit for bit in pattern)).to_bytes(8, "little")
            message = decode(Frame(frame.id, wrong))
            if isinstance(message, State) and message.poles:
                assert isinstance(subscriber.copied().receive(message, 2_000_000_000), Rejection)


def test_the_suite_runs_by_name() -> None:
    (report,) = run_suite("bus", ["fuzz"], quick=True)
    assert report.held, [check for check in report.checks if not check.held]
