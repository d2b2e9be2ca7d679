"""Between the frames that nodes speak and those of a process bus, without any socket."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Collection

from faultloop.errors import InputError
from faultloop.io.can.frames import (
    Differential,
    Frame,
    Measurements,
    Rejection,
    SampledValues,
    TimeSync,
    decode,
)
from faultloop.io.can.table import BY_IDENTIFIER, Kind
from faultloop.io.iec61850 import require
from faultloop.io.iec61850.data_set import Refused
from faultloop.io.iec61850.goose import Publication, Subscription
from faultloop.io.iec61850.sampled_values import UnitPublication, UnitSubscription
from faultloop.io.iec61850.streams import Station, Stream, Unit

GOOSE, SAMPLED_VALUES = 0x88B8, 0x88BA
_RAW = struct.Struct("<4xI6i")


class Gateway:
    """Frames of CAN into Ethernet frames of GOOSE and Sampled Values, and back.

    Parameters
    ----------
    station : who is on the bus.
    identifiers : of the frames that are wanted from it; None for all.
    start_ns : time zero of the run [ns since 1970].

    Attributes
    ----------
    refused : messages of our streams that do not count, by cause.
    """

    def __init__(
        self, station: Station, identifiers: Collection[int] | None = None, start_ns: int = 0
    ) -> None:
        require()
        self.station, self.start_ns = station, start_ns
        self.refused: Counter[str] = Counter()
        streams, units = station.streams(), station.units()
        self._streams = {(stream.block.kind, stream.block.page, stream.number): stream for stream in streams}
        self._units = {unit.number: unit for unit in units}
        self._goose_out: dict[Stream, Publication] = {}
        self._samples_out: dict[Unit, UnitPublication] = {}
        heard = [s for s in streams if identifiers is None or s.identifier in identifiers]
        seen = [u for u in units if identifiers is None or Kind.SAMPLED_VALUES + u.number in identifiers]
        self._goose = {stream.address.app_id: Subscription(station, stream) for stream in heard}
        self._samples = {unit.address.app_id: UnitSubscription(station, unit) for unit in seen}

    @property
    def identifiers(self) -> frozenset[int]:
        """Of the frames of CAN that GOOSE streams of the station carry."""
        return frozenset(stream.identifier for stream in self._streams.values())

    @property
    def app_ids(self) -> list[int]:
        """Of the messages that are wanted."""
        return sorted((*self._goose, *self._samples))

    # -- out ------------------------------------------------------------------------------------------------

    def encode(self, frame: Frame, now_ns: int = 0) -> list[bytes]:
        """The Ethernet frames that a frame becomes, without their check sequence: one, or none as yet.

        Raises
        ------
        InputError : GOOSE carries no such frame.
        """
        kind, number = BY_IDENTIFIER.get(frame.id, (None, 0))
        if kind == Kind.SAMPLED_VALUES and len(frame.data) == _RAW.size:
            sample_count, *raw = _RAW.unpack(frame.data)
            return self.encode_sample(number, sample_count, tuple(raw), frame.data[3] & 0x3F)
        message = decode(frame)
        if kind is None or isinstance(message, (Rejection, SampledValues, Differential, TimeSync)):
            what = message if isinstance(message, Rejection) else type(message).__name__
            raise InputError(f"GOOSE carries no frame {frame.id:#05x} ({what})", key="goose")
        page = message.page.value if isinstance(message, Measurements) else 0
        stream = self._streams.get((kind, page, number))
        if stream is None:
            raise InputError(f"the scenario has no publisher of {kind.name} {number}", key="goose")
        publication = self._goose_out.get(stream)
        if publication is None:
            publication = self._goose_out[stream] = Publication(self.station, stream)
        return [publication.frame(message, self.start_ns, now_ns)]

    def encode_sample(self, number: int, count: int, raw: tuple[int, ...], invalid: int = 0) -> list[bytes]:
        """The same for a sample of relay `number`: va vb vc [10 mV] ia ib ic [mA], bit set of those not
        valid."""
        unit = self._units.get(number)
        if unit is None:
            raise InputError(f"the scenario has no merging unit {number}", key="goose")
        publication = self._samples_out.get(unit)
        if publication is None:
            publication = self._samples_out[unit] = UnitPublication(self.station, unit, self.start_ns)
        return publication.frames(count, raw, invalid)

    # -- in -------------------------------------------------------------------------------------------------

    def decode(self, data: bytes, now_ns: int, *, numbered: bool = True) -> list[Frame]:
        """The frames in an Ethernet frame that came at run time `now_ns`.  Any bytes will do; nothing is
        raised.

        `numbered`: the run's time is known, so that samples have their number in the run; else in their
        second.
        """
        try:
            return self._decoded(data, now_ns, numbered)
        except Refused as refusal:
            self.refused[str(refusal)] += 1
        return []

    def _decoded(self, data: bytes, now_ns: int, numbered: bool) -> list[Frame]:
        from open61850.ber import BerError
        from open61850.ethernet import parse_frame
        from open61850.goose import decode_goose_pdu
        from open61850.sv import decode_sv_pdu

        frame = parse_frame(data, (GOOSE, SAMPLED_VALUES))
        if frame is None:
            return []
        try:
            if frame.ethertype == GOOSE:
                subscription = self._goose.get(frame.app_id)
                if subscription is None:
                    return []
                pdu = decode_goose_pdu(frame.apdu, strict=True)
                if frame.reserved1 & 0x8000 and not pdu.simulation:
                    raise Refused("the frame is simulated, its message is not")
                return [subscription.take(pdu, self.start_ns, now_ns).encode()]
            unit = self._samples.get(frame.app_id)
            if unit is None:
                return []
            samples = unit.take(frame, decode_sv_pdu(frame.apdu), now_ns if numbered else None)
            return [sample.encode() for sample in samples]
        except BerError as error:
            raise Refused(f"malformed ({_cause(error)})") from None


def _cause(error: Exception) -> str:
    """Without the numbers of this one message: causes are counted."""
    return "not conformant" if str(error).startswith("not conformant") else type(error).__name__
