"""Profiles 1 and 5 against autosar-e2e: what it makes, and what it accepts and refuses."""

from __future__ import annotations

from e2e import p01, p05
from hypothesis import given, settings
from hypothesis import strategies as st

from faultloop.io.can.e2e import P01_COUNTERS
from faultloop.io.can.frames import Frame, Rejection, SampledValues, State, decode
from faultloop.io.can.table import Kind
from faultloop.nodes.goose import Publisher

reproducible = settings(derandomize=True, deadline=None)
STATE_IDENTIFIERS = st.sampled_from(
    [kind + n for kind in (Kind.TRIP, Kind.CLOSE, Kind.PILOT, Kind.BREAKER_STATUS) for n in (0, 7, 15)]
)
FLIPS = st.lists(st.integers(0, 63), max_size=6, unique=True)


@reproducible
@given(STATE_IDENTIFIERS, st.binary(min_size=8, max_size=8), FLIPS)
def test_profile_1_judges_alike(identifier: int, content: bytes, flips: list[int]) -> None:
    data = bytearray(content)
    p01.e2e_p01_protect(data, identifier, increment_counter=False)
    wrong = int.from_bytes(data, "little") ^ sum(1 << bit for bit in flips)
    received = wrong.to_bytes(8, "little")
    ours = decode(Frame(identifier, received)) not in (Rejection.CRC, Rejection.VALUE)  # counter 15
    assert ours is p01.e2e_p01_check(bytearray(received), identifier)
    assert ours or flips or content[1] & 15 == 15


@reproducible
@given(st.integers(0, 15), st.binary(min_size=32, max_size=32), FLIPS)
def test_profile_5_judges_alike(number: int, content: bytes, flips: list[int]) -> None:
    identifier = Kind.SAMPLED_VALUES + number
    data = bytearray(content)
    p05.e2e_p05_protect(data, identifier, increment_counter=False)
    wrong = int.from_bytes(data, "little") ^ sum(1 << 4 * bit for bit in flips)
    received = wrong.to_bytes(32, "little")
    ours = decode(Frame(identifier, received, fd=True)) is not Rejection.CRC
    assert ours is p05.e2e_p05_check(received, identifier)
    assert ours or flips


@reproducible
@given(STATE_IDENTIFIERS, STATE_IDENTIFIERS)
def test_another_data_id_fails(sent_as: int, made_as: int) -> None:
    data = bytearray(State(Kind.TRIP, made_as - Kind.TRIP, 7, 2, 0, 1, 100).encode().data)
    assert p01.e2e_p01_check(bytearray(data), made_as)
    assert p01.e2e_p01_check(bytearray(data), sent_as) is (sent_as == made_as)
    assert (decode(Frame(sent_as, bytes(data))) is Rejection.CRC) is (sent_as != made_as)


def test_a_publishers_counters_are_those_of_profile_1() -> None:
    publisher, theirs = Publisher(Kind.TRIP, 3), bytearray(8)
    for _ in range(3 * P01_COUNTERS):
        frame = publisher.poll(publisher.next_ns)
        assert frame is not None
        theirs[2:] = frame.data[2:]
        if (
            publisher.record["sq_num"][0] > 1
        ):  # theirs counts on before it sends: the first is where ours begins
            p01.e2e_p01_protect(theirs, frame.id)
        else:
            p01.e2e_p01_protect(theirs, frame.id, increment_counter=False)
        assert bytes(theirs) == frame.data


def test_sampled_values_count_as_profile_5_does() -> None:
    theirs = bytearray(32)
    for count in range(300):
        frame = SampledValues(2, count, (1.0,) * 6, count).encode()
        theirs[3:] = frame.data[3:]
        p05.e2e_p05_protect(theirs, frame.id, increment_counter=count > 0)
        assert bytes(theirs) == frame.data
