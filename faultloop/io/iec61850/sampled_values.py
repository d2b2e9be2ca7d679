"""Streams of Sampled Values (IEC 61850-9-2): samples out, samples in.

Every profile here carries four currents and four voltages, INT32 in mA and 10 mV with 32 bits of quality
each; a relay's six channels are in it, with In and Vn as their sums, marked as derived.  Source: UCA,
"Implementation guideline for digital interface to instrument transformers using IEC 61850-9-2" (9-2LE), R2-1;
IEC 61869-9, clauses 6.903 f.
"""

from __future__ import annotations

import math
import struct
from typing import Any, NamedTuple

from faultloop.config.iec61850 import Iec61850, SampledValuesProfile
from faultloop.errors import InputError
from faultloop.io.can.frames import SampledValues
from faultloop.io.can.table import CURRENT_LSB, VOLTAGE_LSB
from faultloop.io.iec61850.data_set import Refused
from faultloop.io.iec61850.goose import simulated
from faultloop.io.iec61850.streams import CONF_REV, Station, Unit

CHANNELS = 8
SAMPLE_BYTES = 8 * CHANNELS
VALIDITY, INVALID, QUESTIONABLE, OVERFLOW, TEST, DERIVED = 0x3, 0x2, 0x3, 0x4, 0x800, 0x2000
GLOBAL, LOCAL = 2, 1
MOST = 2**31 - 1
KEPT = 64
"""Messages that wait for a sample of theirs."""
_SAMPLE = struct.Struct("!" + "iI" * CHANNELS)


class Profile(NamedTuple):
    """How many samples a second, and how many of them in a message."""

    name: str
    rate: int
    asdus: int

    @property
    def is_9_2le(self) -> bool:
        return self.name.startswith("9-2LE")


IEC_61869_9 = {
    name: Profile(name, rate, asdus)
    for name, rate, asdus in (("F4000S1I4U4", 4000, 1), ("F4800S2I4U4", 4800, 2), ("F14400S6I4U4", 14400, 6))
}


def profiles(frequency_hz: int) -> list[Profile]:
    """All of them at a nominal frequency, that first which is taken first."""
    return [
        Profile("9-2LE, 80 samples a cycle", 80 * frequency_hz, 1),
        Profile("9-2LE, 256 samples a cycle", 256 * frequency_hz, 8),
        *IEC_61869_9.values(),
    ]


def profile_of(sampling_hz: int, frequency_hz: int, wanted: SampledValuesProfile | None = None) -> Profile:
    """The profile of a sampling rate.

    Raises
    ------
    InputError : there is none, or it is not the one wanted.
    """
    known = [p for p in profiles(frequency_hz) if wanted is None or p.name.startswith(wanted)]
    for profile in known:
        if profile.rate == sampling_hz:
            return profile
    can_be = ", ".join(f"{profile.rate} ({profile.name})" for profile in known)
    raise InputError(
        f"{sampling_hz} is the rate of no Sampled Values at {frequency_hz} Hz; it can be {can_be}",
        key="system.sampling_hz",
    )


def station_profile(station: Station) -> Profile:
    """The profile of a station's merging units."""
    options: Iec61850 = station.options
    return profile_of(station.sampling_hz, station.frequency_hz, options.sampled_values)


class UnitPublication:
    """A merging unit's stream that goes out: a prepared message in which only what changes is written.

    Parameters
    ----------
    station : whose settings it has.
    unit : which one.
    start_ns : time zero of the run [ns since 1970]: samples are synchronised globally where it is a whole
    second.
    """

    def __init__(self, station: Station, unit: Unit, start_ns: int) -> None:
        self.profile = station_profile(station)
        synch = LOCAL if start_ns % 1_000_000_000 else GLOBAL
        asdus = self.profile.asdus
        self._frame = _prepared(station, unit, asdus, synch)
        marks = [self._frame.find(_mark(k)) for k in range(asdus)]
        self._samples = marks
        self._counts = [mark - 13 for mark in marks]  # before smpSynch, confRev and the tags of all three
        self._bodies: dict[int, bytes] = {}
        self._sent = -1

    def frames(self, sample_count: int, values: tuple[int, ...], invalid: int = 0) -> list[bytes]:
        """The message that this sample completes, or none.

        Parameters
        ----------
        sample_count : number of the sample since the run's start.
        values : va vb vc [10 mV] ia ib ic [mA].
        invalid : bit set of the channels that are not valid, va first.
        """
        asdus = self.profile.asdus
        message, place = divmod(sample_count, asdus)
        if message == self._sent:  # the last sample of it again: a copy
            return [bytes(self._frame)] if place == asdus - 1 else []
        self._bodies[sample_count] = _packed(values, invalid)
        first = message * asdus
        if any(first + k not in self._bodies for k in range(asdus)):
            if len(self._bodies) > KEPT * asdus:
                self._bodies.pop(min(self._bodies))
            return []
        for k in range(asdus):
            at = self._samples[k]
            self._frame[at : at + SAMPLE_BYTES] = self._bodies.pop(first + k)
            struct.pack_into("!H", self._frame, self._counts[k], (first + k) % self.profile.rate)
        self._sent = message
        return [bytes(self._frame)]


def _mark(k: int) -> bytes:
    return bytes(range(k, k + SAMPLE_BYTES))


def _prepared(station: Station, unit: Unit, asdus: int, synch: int) -> bytearray:
    from open61850.sv import SvAsdu, SvPDU, encode_sv_frame

    pdu = SvPDU([SvAsdu(unit.id, 0, CONF_REV, synch, _mark(k)) for k in range(asdus)])
    address, options = unit.address, station.options
    frame = encode_sv_frame(
        pdu,
        dst_mac=address.destination,
        src_mac=address.source,
        app_id=address.app_id,
        vlan_id=options.vlan_id,
        vlan_priority=options.vlan_priority,
    )
    return bytearray(simulated(frame) if options.simulation else frame)


def _packed(values: tuple[int, ...], invalid: int) -> bytes:
    va, vb, vc, ia, ib, ic = values
    qva, qvb, qvc, qia, qib, qic = (INVALID if invalid >> k & 1 else 0 for k in range(6))
    i_n, q_in = _sum((ia, ib, ic), qia | qib | qic)
    v_n, q_vn = _sum((va, vb, vc), qva | qvb | qvc)
    return _SAMPLE.pack(ia, qia, ib, qib, ic, qic, i_n, q_in, va, qva, vb, qvb, vc, qvc, v_n, q_vn)


def _sum(values: tuple[int, int, int], quality: int) -> tuple[int, int]:
    total = sum(values)
    limited = min(max(total, -MOST - 1), MOST)
    return limited, DERIVED | quality | (QUESTIONABLE | OVERFLOW if limited != total else 0)


class UnitSubscription:
    """A merging unit's stream that comes in.

    Parameters
    ----------
    station : whose names and settings the stream must have.
    unit : which one.
    """

    def __init__(self, station: Station, unit: Unit) -> None:
        self._station, self._unit = station, unit
        self._rate = station.sampling_hz
        self.simulated = False

    def take(self, frame: Any, pdu: Any, now_ns: int | None) -> list[SampledValues]:
        """The samples in an ``SvPDU`` that came at run time `now_ns`; Refused where they do not count.

        Without `now_ns` a sample's number is that within its second.
        """
        is_simulated = bool(frame.reserved1 & 0x8000)
        if is_simulated and not self._station.options.accept_simulation:
            raise Refused("simulated")
        if self.simulated and not is_simulated:
            raise Refused("not simulated, as its stream is")
        for asdu in pdu.asdus:
            if self._station.named and asdu.sv_id != self._unit.id:
                raise Refused("another svID")
            if asdu.conf_rev != CONF_REV:
                raise Refused("another confRev")
            if len(asdu.sample) != SAMPLE_BYTES:
                raise Refused("another data set")
            if self._station.named and asdu.smp_cnt >= self._rate:
                raise Refused("smpCnt is beyond the sampling rate")
        self.simulated = is_simulated
        samples = [self._sample(asdu, now_ns) for asdu in pdu.asdus]
        return [sample for sample in samples if sample.sample_count >= 0]  # others are from before the run

    def _sample(self, asdu: Any, now_ns: int | None) -> SampledValues:
        ia, qia, ib, qib, ic, qic, _, _, va, qva, vb, qvb, vc, qvc, _, _ = _SAMPLE.unpack(asdu.sample)
        count = asdu.smp_cnt
        if now_ns is not None:  # of the samples of that number in their second the one nearest to now
            expected = now_ns * self._rate // 1_000_000_000
            count = expected + (count - expected + self._rate // 2) % self._rate - self._rate // 2
        values = (
            _value(va, qva, VOLTAGE_LSB), _value(vb, qvb, VOLTAGE_LSB), _value(vc, qvc, VOLTAGE_LSB),
            _value(ia, qia, CURRENT_LSB), _value(ib, qib, CURRENT_LSB), _value(ic, qic, CURRENT_LSB),
        )  # fmt: skip
        return SampledValues(self._unit.number, count, values, count & 0xFF, min(asdu.smp_synch, GLOBAL))


def _value(raw: int, quality: int, lsb: float) -> float:
    return math.nan if quality & (VALIDITY | TEST) else raw * lsb
