"""Faults between a sender and the bus: what they do, how often, and that they do it again."""

from __future__ import annotations

from itertools import groupby, pairwise
from typing import Any

import pytest

from faultloop.config.bus_fault import BusFault
from faultloop.errors import InputError
from faultloop.io.can.faults import SenderFaults
from faultloop.io.can.frames import Frame, Rejection, State, decode
from faultloop.io.can.table import Kind
from faultloop.loop.scenario import Scenario
from tests.examples import scenario

MS = 1_000_000
TRIP, OTHER = Frame(0x010, bytes(8)), Frame(0x100, bytes(8))


def fault(kind: str, **keys: Any) -> BusFault:
    return BusFault(name="B1", kind=kind, **keys)  # type: ignore[arg-type]


def sent(faults: list[BusFault], count: int, frame: Frame = TRIP, seed: int = 1, sender: str = "RA"):
    stage = SenderFaults(seed, faults, sender)
    return [stage.send(i * MS, frame) for i in range(count)], stage


def test_a_pattern_hits_where_it_says_and_begins_anew():
    out, stage = sent([fault("loss", pattern="0010")], 9)
    assert [len(frames) for frames in out] == [1, 1, 0, 1, 1, 1, 0, 1, 1]
    assert stage.hits == {"B1": 2}


def test_window_sender_and_message_choose_the_frames():
    window = fault("loss", start_s=0.002, duration_s=0.003, node="RA", message="trip")
    out, stage = sent([window], 8)
    assert [len(frames) for frames in out] == [1, 1, 0, 0, 0, 1, 1, 1]
    assert stage.send(3 * MS, OTHER) == [(3 * MS, OTHER)]
    assert stage.send(3 * MS, TRIP._replace(extended=True))
    assert all(sent([window], 8, sender="RB")[0])


def test_independent_loss_has_its_probability_and_no_memory():
    lost = [not frames for frames in sent([fault("loss", probability=0.3)], 40_000)[0]]
    assert sum(lost) / len(lost) == pytest.approx(0.3, abs=4 * (0.21 / 40_000) ** 0.5)
    after = [b for a, b in pairwise(lost) if a]
    assert sum(after) / len(after) == pytest.approx(0.3, abs=4 * (0.21 / len(after)) ** 0.5)


def test_bursts_have_their_share_and_mean_length():
    out, _ = sent([fault("loss", probability=0.2, burst_length=5)], 200_000)
    lost = [not frames for frames in out]
    bursts = [sum(1 for _ in run) for hit, run in groupby(lost) if hit]
    assert sum(lost) / len(lost) == pytest.approx(0.2, abs=0.008)
    # geometric lengths: mean L, standard deviation sqrt(L (L - 1))
    assert sum(bursts) / len(bursts) == pytest.approx(5, abs=4 * (20 / len(bursts)) ** 0.5)


def test_same_seed_same_fate_and_every_sender_its_own():
    faults = [fault("loss", probability=0.5), fault("delay", delay_ms=1, jitter_ms=3)]
    first = sent(faults, 200)[0]
    assert first == sent(faults, 200)[0]
    assert first != sent(faults, 200, seed=2)[0]
    assert first != sent(faults, 200, sender="RB")[0]
    delays = [frames[0][0] - i * MS for i, frames in enumerate(first) if frames]
    assert min(delays) >= MS
    assert max(delays) <= 4 * MS
    assert len(set(delays)) > 50


@pytest.mark.parametrize("bits", [1, 2])
def test_corruption_flips_bits_and_the_crc_sees_them(bits):
    good = State(Kind.TRIP, 0, 7, 2, 0, 1, 100).encode()
    out, _ = sent([fault("corruption", bits=bits)], 300, good)
    for ((_, frame),) in out:
        flipped = int.from_bytes(frame.data, "big") ^ int.from_bytes(good.data, "big")
        assert flipped.bit_count() == bits
        # CRC-8 of SAE J1850 (0x1D) has a Hamming distance of 3 up to 247 bits
        assert decode(frame) is Rejection.CRC
    empty = Frame(0x010, b"")
    assert sent([fault("corruption")], 1, empty)[0] == [[(0, empty)]]


def test_duplication_and_reordering():
    assert sent([fault("duplication", copies=2)], 1)[0] == [[(0, TRIP)] * 3]
    stage = SenderFaults(1, [fault("reordering", pattern="100")], "RA")
    frames = [TRIP._replace(data=bytes([i])) for i in range(4)]
    out = [stage.send(i * MS, frame) for i, frame in enumerate(frames)]
    assert out == [[], [(MS, frames[1]), (MS, frames[0])], [(2 * MS, frames[2])], []]


def test_bus_off_is_a_window():
    stage = SenderFaults(1, [fault("bus_off", node="RA", start_s=0.01, duration_s=0.02)], "RA")
    assert [stage.silent(t * MS) for t in (9, 10, 29, 30)] == [False, True, True, False]
    away = SenderFaults(1, [fault("restart", node="RA", start_s=0.01)], "RA")
    assert not away.silent(10 * MS)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"kind": "lost"}, "'loss'"),
        ({"kind": "loss", "node": "RX"}, r"bus_fault\[B1\].node: there is no node 'RX'"),
        ({"kind": "loss", "delay_ms": 1}, "delay_ms is nothing of loss"),
        ({"kind": "loss", "probability": 1.5}, r"bus_fault\[B1\].probability"),
        ({"kind": "loss", "probability": 0.5, "pattern": "01"}, "either probability or pattern"),
        ({"kind": "loss", "pattern": "0120"}, "pattern"),
        ({"kind": "loss", "burst_length": 3}, "needs a probability"),
        ({"kind": "loss", "probability": 0.9, "burst_length": 2}, "at most 0.666667"),
        ({"kind": "delay"}, "delay needs delay_ms"),
        ({"kind": "babbling", "rate_hz": 100}, "babbling needs identifier"),
        ({"kind": "babbling", "identifier": 0x800, "rate_hz": 100}, "identifier"),
        ({"kind": "bus_off", "node": "RA"}, "bus_off needs duration_s"),
        ({"kind": "restart", "node": "plant"}, "there is no node 'plant'"),
        ({"kind": "forging", "node": "QA", "message": "trip", "rate_hz": 1}, "there is no node 'QA'"),
        ({"kind": "forging", "node": "RA", "message": "heartbeat", "rate_hz": 1}, "message must be"),
        ({"kind": "loss", "start_s": 5}, "not before the end of the run"),
        ({"kind": "loss", "chance": 0.1}, "unknown key"),
    ],
)
def test_wrong_bus_faults_say_what_is_wrong(keys, words):
    with pytest.raises(InputError, match=words):
        Scenario.from_dict(scenario(bus_fault=[keys]))


def test_two_of_one_name_are_refused():
    twice = [{"kind": "loss", "name": "L"}, {"kind": "loss", "name": "L"}]
    with pytest.raises(InputError, match="two of them are called 'L'"):
        Scenario.from_dict(scenario(bus_fault=twice))
