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
from faultloop.io.messages import CAN_FRAME, CHANNELS, ELEMENTS, values
from faultloop.io.output_file import missing_folders
from faultloop.loop.recorded import recorded_scenario
from faultloop.review.summary import find_inception
from faultloop.review.survey import survey

SECOND_NS = 1_000_000_000


def log_to_comtrade(
    log: Log, path: Path, *, relay: str | None = None, revision: str = "2013", format: str = "FLOAT32"
) -> list[Path]:
    """Sampled values of one relay or of all; element bits and breaker poles as status channels.

    Values are primary.  The trigger is the fault's inception: as the plant tells it, else as the samples show
    it, else the first pickup; the first sample where there is none.  Returns the files written; raises
    InputError where the log has no such relay or no samples.
    """
    if relay is not None and relay not in log.relays:
        raise InputError(f"no relay '{relay}'; {nearest(relay, log.relays)}", file=log.path, key="--relay")
    names = log.relays if relay is None else (relay,)
    counts = [survey(log, name).count for name in names]
    if not counts or not counts[0]:
        raise InputError("holds no sampled values to export", file=log.path)
    # A run that was cut off may have one relay a few samples ahead of another.
    count = min(counts)
    t_ns = np.empty(count, np.int64)
    columns = {name: np.empty((len(CHANNELS), count)) for name in names}
    bits = {name: np.zeros((2, count), np.uint64) for name in names}
    _fill(log, t_ns, columns, bits)
    record = Record(
        t_ns=t_ns - t_ns[0],
        analog=[channel for name in names for channel in _analog(name, columns[name])],
        status=[channel for name in names for channel in _bits(log, name, bits[name])] + _own(log, t_ns),
        rates=_rates(t_ns),
        start_ns=log.start_ns + int(t_ns[0]),
        trigger_ns=log.start_ns + _trigger_ns(log, t_ns),
        frequency_hz=_frequency(log),
        station=_one_line(recorded_scenario(log)["scenario"].get("name", log.path.stem)),
        device="faultloop",
    )
    with missing_folders(path.parent):
        return write_comtrade(path, record, revision=revision, format=format)


def log_to_can(log: Log, path: Path) -> list[Path]:
    """The CAN frames as ``.blf``, ``.asc`` or candump ``.log``."""
    frames = (
        LoggedFrame(
            log.start_ns + entry.t_ns,
            Frame(entry.id, entry.data, entry.extended, entry.fd, entry.fd),
            entry.direction == "tx",
        )
        for span in log.windows()
        for entry in log.entries(CAN_FRAME, from_ns=span[0], to_ns=span[1])
    )
    return [write_can_log(path, frames)]


def _fill(
    log: Log,
    t_ns: NDArray[np.int64],
    columns: dict[str, NDArray[np.float64]],
    bits: dict[str, NDArray[np.uint64]],
) -> None:
    """Times, samples (6, n) and element words (2, n) of relays, stretch by stretch."""
    count, filled = len(t_ns), dict.fromkeys(columns, 0)
    told = dict.fromkeys(columns, 0)
    for span in log.windows():
        for place, (name, into) in enumerate(columns.items()):
            rows = log.samples(name, *span)[: count - filled[name]]
            here = slice(filled[name], filled[name] + len(rows))
            into[:, here] = values(rows)[:, -len(CHANNELS) :].T
            if place == 0:
                t_ns[here] = rows["t_ns"]
            filled[name] = here.stop
            if ELEMENTS.topic_for(name) in log.topics:
                words = log.elements(name, *span)[: count - told[name]]
                here = slice(told[name], told[name] + len(words))
                bits[name][0, here], bits[name][1, here] = words["pickup"], words["operate"]
                told[name] = here.stop


def _trigger_ns(log: Log, t_ns: NDArray[np.int64]) -> int:
    """The inception, where it is in the record."""
    found = find_inception(log).t_ns
    return int(t_ns[0]) if found is None or not t_ns[0] <= found <= t_ns[-1] else found


def _one_line(text: str) -> str:
    """A name without what a .cfg cannot keep."""
    return "".join(" " if mark in ",\r\n\x1a" else mark for mark in text)


def _analog(name: str, columns: NDArray[np.float64]) -> list[AnalogChannel]:
    return [
        AnalogChannel(
            name=f"{name} {channel.upper()}",
            values=column,
            unit="V" if channel[0] == "v" else "A",
            phase=channel[1].upper(),
            circuit=name,
        )
        for channel, column in zip(CHANNELS, columns, strict=True)
    ]


def _bits(log: Log, name: str, words: NDArray[np.uint64]) -> list[StatusChannel]:
    """Those element bits that were ever on."""
    channels = []
    for word, names in zip(words, log.bits(name).values(), strict=True):
        ever = int(np.bitwise_or.reduce(word)) if len(word) else 0
        for place, bit in enumerate(names):
            if ever >> place & 1:
                on = (word >> np.uint64(place) & np.uint64(1)).astype(bool)
                channels.append(StatusChannel(f"{name} {bit}", on, circuit=name))
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
    return float(recorded_scenario(log)["system"].get("frequency_hz", 0))
