"""Differential data on the wire and at a node: what is taken, and what is refused and why."""

from __future__ import annotations

import cantools
import numpy as np
import pytest
from e2e import p05

from faultloop.io.can.authentication import CmacSeal
from faultloop.io.can.dbc import DBC_PATH
from faultloop.io.can.frames import Differential, Frame, Rejection, decode
from faultloop.io.can.table import Kind
from faultloop.nodes.relay import RelayNode

MS = 1_000_000
HASH = 0x1234


def set_at(ms: float, relay: int = 1, **keys: object) -> Frame:
    own = {"currents": (100 + 1j, -50 - 86j, -50 + 86j), "agreement": HASH} | keys
    return Differential(relay, round(ms * 1000) % 2**32, **own).encode()  # type: ignore[arg-type]


def node(agreement: int = HASH) -> RelayNode:
    return RelayNode(0, 0, [1], 1.0, 0.0, linked=[1], agreement=agreement)


def test_a_set_is_taken_once_and_in_order() -> None:
    at = node()
    assert at.receive(10 * MS, set_at(9))
    assert not at.receive(11 * MS, set_at(9))
    assert not at.receive(12 * MS, set_at(6.5))
    assert at.rejected == {Rejection.OLD: 2}
    assert at.receive(13 * MS, set_at(11.5))
    assert [int(t) for t in at.nodes.sets["time"][0][:2]] == [9000, 11500]
    np.testing.assert_allclose(at.nodes.sets["values"][0, 0, :6], [100, 1, -50, -86, -50, 86])


@pytest.mark.parametrize(
    ("frame", "why"),
    [
        (set_at(9, agreement=0x1235), Rejection.SETTINGS),
        (set_at(9, test=True), Rejection.TEST),
        (set_at(-1500), Rejection.STALE),
        (set_at(300), Rejection.STALE),
        (set_at(9)._replace(fd=False), Rejection.FORMAT),
        (Frame(0x041, set_at(9).data[:24], fd=True), Rejection.LENGTH),
        # another relay's, under this one's name: the CRC is over the identifier
        (set_at(9, relay=2)._replace(id=0x041), Rejection.CRC),
    ],
)
def test_what_is_refused(frame: Frame, why: Rejection) -> None:
    at = node()
    assert not at.receive(10 * MS, frame)
    assert at.rejected == {why: 1}
    assert not int(at.nodes.source["count"][0])


def test_who_is_not_linked_is_not_heard() -> None:
    at = node()
    assert not at.receive(10 * MS, set_at(9, relay=3))
    assert not node(agreement=0).receive(10 * MS, set_at(9))
    assert not at.rejected


def test_a_flipped_bit_anywhere_is_refused() -> None:
    good = set_at(9)
    for bit in range(8 * len(good.data)):
        data = bytearray(good.data)
        data[bit // 8] ^= 1 << bit % 8
        assert decode(good._replace(data=bytes(data))) is Rejection.CRC


def test_the_frame_by_other_libraries() -> None:
    message = Differential(
        3, 4_000_000_000, (83_000.01 - 2j, -83_886.07 + 0j, 0.01j), 0xBEEF, 5, 1, True, False, True, 200
    )
    frame = message.encode()
    assert decode(frame) == message
    assert p05.e2e_p05_check(bytearray(frame.data), frame.id)
    signals = cantools.database.load_file(DBC_PATH).decode_message(frame.id, frame.data, decode_choices=False)
    assert signals["ia_re"] == pytest.approx(83_000.01) and signals["ib_re"] == pytest.approx(-83_886.07)
    assert (signals["valid"], signals["synchronized"], signals["external"], signals["bare"]) == (5, 1, 1, 1)
    assert (signals["agreement"], signals["counter"], signals["time"]) == (0xBEEF, 200, 4000.0)


def test_what_is_no_number_is_not_valid_and_what_is_too_large_is_limited() -> None:
    got = decode(Differential(0, 0, (complex("nan"), 1e6 + 0j, 1 + 0j)).encode())
    assert isinstance(got, Differential)
    assert got.valid == 6 and got.currents == (0, 83886.07 + 0j, 1 + 0j)


def test_sealed_it_has_64_bytes_and_is_taken_once() -> None:
    key = {Kind.DIFFERENTIAL + 1: bytes(16)}
    sender, receiver = CmacSeal(key, 0), CmacSeal(key, 0)
    sealed = sender.close(10 * MS, set_at(9))
    assert len(sealed.data) == 64 and sealed.fd
    assert receiver.open(11 * MS, sealed) == set_at(9)
    assert receiver.open(12 * MS, sealed) is Rejection.OLD
    forged = sealed._replace(data=sealed.data[:40] + bytes([1]) + sealed.data[41:])
    assert receiver.open(13 * MS, forged) is Rejection.TAG
    assert receiver.open(13 * MS, set_at(12)) is Rejection.LENGTH


def test_of_three_ends_each_is_told_in_turn_when_its_set_was_heard() -> None:
    """Whom a set answers is in it: an end takes no other's round trip for its own."""
    by_channel = HASH | 1 << 16
    at = RelayNode(0, 0, [1, 2], 1.0, 0.0, linked=[1, 2], agreement=by_channel)
    at.nodes.sent_us[0, 0] = 0  # of what it has not sent nobody can have heard
    for ms in range(0, 40, 5):
        for other in (1, 2):  # 1 hears of 0 in its sets, 2 only of 1
            frame = set_at(ms, relay=other, whom=other - 1, heard=0, ago=2000)
            at.receive((ms + 3) * MS, frame)
    trips = dict(zip(at.nodes.source["number"].tolist(), at.nodes.source["trip_us"].tolist(), strict=True))
    assert trips[1] > 0 and trips[2] == 0
    said = []
    for ms in range(40, 60, 5):
        at.nodes.node["set_ns"] = ms * MS
        at.nodes.own_set["kind"], at.nodes.own_set["time"] = Kind.DIFFERENTIAL, ms * 1000
        said += [decode(f) for f in at.poll(ms * MS) if f.id == Kind.DIFFERENTIAL]
    assert [m.whom for m in said if isinstance(m, Differential)] == [2, 1, 2, 1]
