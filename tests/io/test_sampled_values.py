"""Sampled Values: samples as the messages of merging units, and back."""

from __future__ import annotations

import math
import struct
from collections import Counter
from random import Random
from typing import Any

import pytest

from faultloop.errors import InputError
from faultloop.io.can.frames import Frame, SampledValues, decode
from faultloop.io.iec61850.gateway import Gateway
from faultloop.io.iec61850.sampled_values import profile_of
from tests.io.process_bus import START_NS, station

sv = pytest.importorskip("open61850.sv")

RATES = [(4000, 50, 1), (4800, 50, 2), (4800, 60, 1), (12800, 50, 8), (15360, 60, 8), (14400, 50, 6)]


def samples(count: int, first: int = 0) -> list[SampledValues]:
    return [
        SampledValues(
            1,
            n,
            tuple(round(k * 1e4 * math.sin(n / 9 + k), 2 if k < 4 else 3) for k in range(1, 7)),
            n & 0xFF,
        )
        for n in range(first, first + count)
    ]


def gateway(**options: Any) -> Gateway:
    return Gateway(station(**options), start_ns=START_NS)


@pytest.mark.parametrize(("rate", "frequency", "asdus"), RATES)
def test_samples_come_through_to_the_last_bit(rate: int, frequency: int, asdus: int) -> None:
    out, into = (
        gateway(sampling_hz=rate, frequency_hz=frequency),
        gateway(sampling_hz=rate, frequency_hz=frequency),
    )
    first = rate - 24  # smpCnt begins again within
    first -= first % asdus
    sent = samples(48, first)
    got, messages = [], []
    for sample in sent:
        for data in out.encode(sample.encode()):
            messages.append(sv.decode_sv_frame(data)[1])
            got += [decode(f) for f in into.decode(data, sample.sample_count * 10**9 // rate)]
    assert got == [decode(sample.encode()) for sample in sent]
    assert {len(m.asdus) for m in messages} == {asdus}
    assert [a.smp_cnt for m in messages for a in m.asdus] == [s.sample_count % rate for s in sent]


def test_a_message_is_that_of_9_2le() -> None:
    (data,) = gateway().encode(SampledValues(0, 5, (1.0, 2.0, -3.0, 0.5, 0.25, math.nan)).encode())
    frame, pdu = sv.decode_sv_frame(data)
    (asdu,) = pdu.asdus
    assert (asdu.sv_id, asdu.conf_rev, asdu.smp_synch, asdu.smp_cnt) == ("RA_MUMU0101", 1, 2, 5)
    assert (asdu.dat_set, asdu.refr_tm, asdu.smp_rate, asdu.smp_mod, asdu.gm_identity) == (None,) * 5
    derived, invalid = 0x2000, 0x2
    assert sv.decode_int32_samples(asdu.sample) == [
        (500, 0), (250, 0), (0, invalid), (750, derived | invalid),
        (100, 0), (200, 0), (-300, 0), (0, derived),
    ]  # fmt: skip
    assert (frame.dst_mac, frame.app_id, frame.vlan_id, frame.vlan_priority) == (
        "01:0c:cd:04:00:00",
        0x4000,
        0,
        4,
    )


def test_where_no_second_begins_at_time_zero_samples_are_synchronised_locally() -> None:
    own = Gateway(station(), start_ns=START_NS + 1)
    assert sv.decode_sv_frame(own.encode_sample(0, 0, (0,) * 6)[0])[1].asdus[0].smp_synch == 1


def test_of_a_message_whose_sample_is_lost_there_is_none_and_a_double_makes_two() -> None:
    out = gateway(sampling_hz=4800)
    counts = [n for n in range(8) if n != 4] + [6, 7, 7]
    sent = [len(out.encode_sample(0, n, (0,) * 6)) for n in counts]
    assert sent == [0, 1, 0, 1, 0, 0, 1, 0, 1, 1]
    late = gateway(sampling_hz=4800)
    sent = [len(late.encode_sample(0, n, (n,) * 6)) for n in (0, 3, 1, 2)]
    assert sent == [0, 0, 1, 1]


def test_a_sample_has_the_number_in_the_run_that_is_nearest_to_now() -> None:
    out, into = gateway(), gateway()
    for second, count in ((0, 10), (7, 28_010), (86_399, 345_596_010)):
        (data,) = out.encode_sample(0, count, (0,) * 6)
        for early_ms in (-400, 0, 400):
            (frame,) = into.decode(data, second * 10**9 + 2_500_000 + early_ms * 1_000_000)
            message = decode(frame)
            assert isinstance(message, SampledValues)
            assert message.sample_count == count
    (data,) = out.encode_sample(0, 3999, (0,) * 6)
    assert into.decode(data, 0) == []  # from before the run
    (frame,) = into.decode(data, 0, numbered=False)
    assert struct.unpack_from("<I", frame.data, 4) == (3999,)


@pytest.mark.parametrize(
    ("quality", "valid"),
    [(0, True), (0x2000, True), (0x1, False), (0x2, False), (0x3, False), (0x800, False)],
)
def test_a_value_whose_quality_is_not_good_or_under_test_is_not_valid(quality: int, valid: bool) -> None:
    into = gateway()
    body = sv.encode_int32_samples([(1000, quality), *[(0, 0)] * 7])
    data = _message([sv.SvAsdu("RA_MUMU0101", 0, 1, 2, body)])
    (frame,) = into.decode(data, 0)
    message = decode(frame)
    assert isinstance(message, SampledValues)
    assert math.isnan(message.values[3]) is not valid


def _message(asdus: list[Any]) -> bytes:
    return sv.encode_sv_frame(
        sv.SvPDU(asdus), dst_mac="01:0c:cd:04:00:00", src_mac="02:00:00:00:01:00", app_id=0x4000
    )


@pytest.mark.parametrize(
    ("fields", "cause"),
    [
        ({"sv_id": "OTHER"}, "another svID"),
        ({"conf_rev": 7}, "another confRev"),
        ({"sample": b"\0" * 56}, "another data set"),
        ({"smp_cnt": 4000}, "smpCnt is beyond the sampling rate"),
    ],
)
def test_what_does_not_count_is_refused_by_its_cause(fields: dict[str, Any], cause: str) -> None:
    into = gateway()
    asdu = {
        "sv_id": "RA_MUMU0101",
        "smp_cnt": 0,
        "conf_rev": 1,
        "smp_synch": 2,
        "sample": b"\0" * 64,
    } | fields
    assert into.decode(_message([sv.SvAsdu(**asdu)]), 0) == []
    assert into.refused == Counter({cause: 1})


def test_simulated_samples_are_not_measured() -> None:
    (data,) = gateway(simulation=True).encode_sample(0, 0, (0,) * 6)
    ordinary, under_test = gateway(), gateway(accept_simulation=True)
    assert ordinary.decode(data, 0) == []
    assert ordinary.refused == Counter({"simulated": 1})
    assert len(under_test.decode(data, 0)) == 1


def mutated(count: int, seed: int) -> Counter[str]:
    random = Random(seed)
    out, into = gateway(sampling_hz=4800), gateway(sampling_hz=4800)
    told: Counter[str] = Counter()
    good = [
        d
        for n in range(40)
        for d in out.encode_sample(0, n, tuple(random.randrange(-999, 999) for _ in range(6)))
    ]
    for _ in range(count):
        data = bytearray(random.choice(good))
        for _ in range(random.choice((1, 1, 2, 8))):
            data[random.randrange(len(data))] = random.randrange(256)
        if random.random() < 0.3:
            del data[random.randrange(len(data)) :]
        for frame in into.decode(bytes(data), 0):
            assert isinstance(decode(frame), SampledValues)
            told["taken"] += 1
        told["played"] += 1
    return told


def test_mutated_messages_are_samples_or_nothing() -> None:
    assert mutated(3_000, 1)["played"] == 3_000


@pytest.mark.slow
def test_100_000_mutated_messages_are_samples_or_nothing() -> None:
    assert mutated(100_000, 2)["played"] == 100_000


@pytest.mark.parametrize(
    ("rate", "frequency", "wanted", "words"),
    [
        (5000, 50, None,
         "system.sampling_hz: 5000 is the rate of no Sampled Values at 50 Hz; it can be "
         "4000 (9-2LE, 80 samples a cycle), 12800 (9-2LE, 256 samples a cycle), "
         "4000 (F4000S1I4U4), 4800 (F4800S2I4U4), 14400 (F14400S6I4U4)"),
        (4800, 50, "9-2LE",
         "system.sampling_hz: 4800 is the rate of no Sampled Values at 50 Hz; it can be "
         "4000 (9-2LE, 80 samples a cycle), 12800 (9-2LE, 256 samples a cycle)"),
    ],
)  # fmt: skip
def test_a_rate_that_fits_no_profile_is_one_line(rate: int, frequency: int, wanted: Any, words: str) -> None:
    with pytest.raises(InputError) as error:
        profile_of(rate, frequency, wanted)
    assert str(error.value) == words


def test_a_profile_can_be_chosen_where_two_fit() -> None:
    assert profile_of(4800, 60).name == "9-2LE, 80 samples a cycle"
    assert profile_of(4800, 60, "F4800S2I4U4").asdus == 2


def test_a_frame_without_a_unit_is_told() -> None:
    with pytest.raises(InputError, match="the scenario has no merging unit 5"):
        gateway().encode(Frame(0x185, bytes(32), fd=True))
