"""A log in the formats of other tools: COMTRADE, CAN logs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError, nearest
from faultloop.io.can.frames import Frame
from faultloop.io.can.log import LoggedFrame, write_can_log
from faultloop.io.comtrade.record import AnalogChannel, Rate, Record, StatusChannel
from faultloop.io.comtrade.write import write_comtrade
from faultloop.io.mcap_reader import Log
from faultloop.io.messages import CHANNELS

SECOND_NS = 1_000_000_000


def log_to_comtrade(
    log: Log, path: Path, *, relay: str | None = None, revision: str = "2013", format: str = "FLOAT32"
) -> list[Path]:
    """Sampled values of one relay or of all; element bits and breaker poles as status channels.

    Values are primary.  The trigger is the first trip, or the first sample.  Returns the files written;
    raises InputError where the log has no such relay or no samples.
    """
    if relay is not None and relay not in log.relays:
        raise InputError(f"no relay '{relay}'; {nearest(relay, log.relays)}", file=log.path, key="--relay")
    names = log.relays if relay is None else (relay,)
    if not names or not len(log.samples(names[0])):
        raise InputError("holds no sampled values to export", file=log.path)
    t_ns = log.samples(names[0])["t_ns"]
    # A run that was cut off may have one relay a few samples ahead of another.
    count = min(len(log.samples(name)) for name in names)
    t_ns = t_ns[:count]
    record = Record(
        t_ns=t_ns - t_ns[0],
        analog=[channel for name in names for channel in _analog(log, name, count)],
        status=[channel for name in names for channel in _bits(log, name, count)] + _own(log, t_ns),
        rates=_rates(t_ns),
        start_ns=log.start_ns + int(t_ns[0]),
        trigger_ns=log.start_ns + (log.trips[0].t_ns if log.trips else int(t_ns[0])),
        frequency_hz=_frequency(log),
        station=log.metadata.get("scenario", {}).get("name", log.path.stem),
        device="faultloop",
    )
    return write_comtrade(path, record, revision=revision, format=format)


def log_to_can(log: Log, path: Path) -> list[Path]:
    """The CAN frames as ``.blf``, ``.asc`` or candump ``.log``."""
    frames = [
        LoggedFrame(
            log.start_ns + entry.t_ns,
            Frame(entry.id, entry.data, entry.extended, entry.fd, entry.fd),
            entry.direction == "tx",
        )
        for entry in log.can
    ]
    return [write_can_log(path, frames)]


def _analog(log: Log, name: str, count: int) -> list[AnalogChannel]:
    rows = log.samples(name)[:count]
    return [
        AnalogChannel(
            name=f"{name} {channel.upper()}",
            values=np.ascontiguousarray(rows[channel]),
            unit="V" if channel[0] == "v" else "A",
            phase=channel[1].upper(),
            circuit=name,
        )
        for channel in CHANNELS
    ]


def _bits(log: Log, name: str, count: int) -> list[StatusChannel]:
    """Those element bits that were ever on."""
    rows = log.elements(name)[:count]
    channels = []
    for word, names in log.bits(name).items():
        for place, bit in enumerate(names):
            values = (rows[word] >> np.uint64(place) & np.uint64(1)).astype(bool)
            if values.any():
                channels.append(StatusChannel(f"{name} {bit}", values, circuit=name))
    return channels


def _own(log: Log, t_ns: NDArray[np.int64]) -> list[StatusChannel]:
    """Breakers' poles, and a replayed record's own digital channels."""
    channels: dict[int, StatusChannel] = {}
    for entry in log.digital:
        zeros = StatusChannel(
            entry.name, np.zeros(len(t_ns), bool), circuit="record", normal=int(entry.normal)
        )
        channel = channels.setdefault(entry.number, zeros)
        channel.values[np.searchsorted(t_ns, entry.t_ns) :] = entry.on
    return _poles(log, t_ns) + list(channels.values())


def _poles(log: Log, t_ns: NDArray[np.int64]) -> list[StatusChannel]:
    """Each breaker's poles, on where closed."""
    channels = []
    for breaker in log.breakers:
        entries = [entry for entry in log.breaker_states if entry.topic == f"/breaker/{breaker}"]
        for pole in "abc":
            values = np.ones(len(t_ns), bool)
            for entry in entries:
                values[np.searchsorted(t_ns, entry.t_ns) :] = entry.fields[f"pole_{pole}"]
            channels.append(StatusChannel(f"{breaker} {pole.upper()}", values, pole.upper(), breaker, 1))
    return channels


def _rates(t_ns: NDArray[np.int64]) -> tuple[Rate, ...]:
    """The sampling rate; none, so that the stamps count, where samples are left out."""
    if len(t_ns) < 2:
        return (Rate(1.0, len(t_ns)),)
    steps = np.diff(t_ns)
    if steps.max() > 1.5 * np.median(steps):
        return ()
    return (Rate(float(round((len(t_ns) - 1) * SECOND_NS / int(t_ns[-1] - t_ns[0]))), len(t_ns)),)


def _frequency(log: Log) -> float:
    return float(log.metadata.get("scenario", {}).get("frequency_hz", 0))
