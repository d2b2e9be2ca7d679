"""What a replay feeds its relay with: a record, or another relay's samples out of a log."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError, nearest
from faultloop.io.comtrade.mapping import SLOTS, numbers_of, parse_mapping
from faultloop.io.comtrade.read import read_comtrade
from faultloop.io.comtrade.record import SECOND_NS, Record, StatusChannel
from faultloop.io.comtrade.resample import resample, sample_numbers
from faultloop.io.comtrade.select import Overrides, SixChannels, select_channels, slots_of
from faultloop.io.mcap_reader import open_log
from faultloop.loop.record_checks import check_frequency, check_values
from faultloop.relay import RelaySettings

LEAST_PER_CYCLE = 8
"""Samples of a cycle from which a relay's samples are made.  With eight, the spline is within 0.1 % of a
sinusoid's peak, and the third harmonic is still there; with four, within 2 %, and a step becomes anything."""
UNKNOWN_START_NS = 1_577_836_800 * SECOND_NS
"""2020-01-01, where a record does not say when it began: as of a scenario that does not say."""


@dataclass(frozen=True)
class Choices:
    """What a user says of a record (`faultloop.replay` explains each)."""

    mapping: str | None = None
    unit: Mapping[str, str] = field(default_factory=dict)
    scale: Mapping[str, float] = field(default_factory=dict)
    ct_ratio: float | None = None
    vt_ratio: float | None = None
    from_s: float = 0.0
    to_s: float = math.inf

    def check(self) -> None:
        numbers_of({slot: str(value) for slot, value in self.scale.items()}, "--scale")
        for key, ratio in (("--ct-ratio", self.ct_ratio), ("--vt-ratio", self.vt_ratio)):
            if ratio is not None and not (math.isfinite(ratio) and ratio > 0):
                raise InputError(f"{ratio:g}: a ratio is a number greater than 0", key=key)
        if not 0 <= self.from_s < self.to_s:
            raise InputError(f"from {self.from_s:g} s to {self.to_s:g} s is no time", key="--from, --to")

    def as_metadata(self) -> dict[str, str]:
        """For the log; nothing of what was not said."""
        said = {
            "map": self.mapping or "",
            "unit": ",".join(f"{slot}={unit}" for slot, unit in self.unit.items()),
            "scale": ",".join(f"{slot}={factor:.17g}" for slot, factor in self.scale.items()),
            "ct_ratio": "" if self.ct_ratio is None else f"{self.ct_ratio:.17g}",
            "vt_ratio": "" if self.vt_ratio is None else f"{self.vt_ratio:.17g}",
            "from_s": "" if self.from_s == 0 else f"{self.from_s:.17g}",
            "to_s": "" if math.isinf(self.to_s) else f"{self.to_s:.17g}",
        }
        return {key: text for key, text in said.items() if text or key == "map"}


@dataclass(frozen=True)
class DigitalChange:
    """A named channel of the record is on or off from here; at the beginning every channel has one."""

    t_ns: int
    number: int
    name: str
    on: bool
    normal: bool


@dataclass(frozen=True)
class Played:
    """What the relay is fed with.

    ``samples`` (n, 6) are primary, at its own rate; ``numbers`` (n,) their sample numbers from the record's
    beginning, with gaps where the record has nothing for a relay.  ``closed``: (t_ns, mask of closed poles),
    whenever the record's own auxiliary contacts change.
    """

    samples: NDArray[np.float64]
    numbers: NDArray[np.int64]
    start_ns: int
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    digital: tuple[DigitalChange, ...] = ()
    closed: tuple[tuple[int, int], ...] = ()

    @property
    def pieces(self) -> list[tuple[int, int]]:
        """First and one past the last row of each piece without a gap."""
        edges = [0, *(np.flatnonzero(np.diff(self.numbers) != 1) + 1).tolist(), len(self.numbers)]
        return list(pairwise(edges))


# -- a log ------------------------------------------------------------------------------------------------


def from_log(record: Path, settings: RelaySettings, choices: Choices) -> Played:
    """A relay's samples out of a log; its rate must be the relay's own."""
    said = choices.as_metadata().keys() - {"map", "from_s", "to_s"}
    if said:
        option = f"--{min(said).replace('_', '-')}"
        raise InputError("a log's samples are primary volts and amperes already", file=record, key=option)
    opened = open_log(record)
    name = _relay_of(opened.relays, record, choices.mapping)
    rows = opened.samples(name)
    if len(rows) < 2:
        raise InputError(f"relay '{name}' has {len(rows)} samples; at least 2 are needed", file=record)
    rate = round(SECOND_NS / float(np.median(np.diff(rows["t_ns"]))))
    if rate != settings.relay.sampling_hz:
        raise InputError(
            f"is {settings.relay.sampling_hz}, but relay '{name}' of {record.name} was sampled at {rate}",
            file=settings.path,
            key="relay.sampling_hz",
        )
    t_ns = rows["t_ns"]
    rows = rows[(t_ns >= choices.from_s * SECOND_NS) & (t_ns < choices.to_s * SECOND_NS)]
    if len(rows) < 2:
        raise InputError(f"the log lasts to {t_ns[-1] / 1e9:g} s", file=record, key="--from, --to")
    samples = np.column_stack([rows[channel] for channel in SLOTS])
    first = int(t_ns[0]) if choices.from_s == 0 else 0
    numbers = np.rint((rows["t_ns"] - first) * (rate / SECOND_NS)).astype(np.int64)
    return Played(samples, numbers, opened.start_ns + first)


def _relay_of(relays: tuple[str, ...], record: Path, mapping: str | None) -> str:
    name = relays[0] if len(relays) == 1 else None
    if mapping is not None:
        key, _, name = mapping.partition("=")
        if key.strip() != "relay" or not name:
            raise InputError(f"of a log say relay=NAME, not '{mapping}'", key="--map")
        name = name.strip()
    if name is None:
        raise InputError(
            f"which relay's samples? say --map relay=NAME with one of {', '.join(relays) or 'none'}",
            file=record,
        )
    if name not in relays:
        raise InputError(f"no relay '{name}'; {nearest(name, relays)}", file=record, key="--map")
    return name


# -- a COMTRADE record ------------------------------------------------------------------------------------


def from_comtrade(record: Path, settings: RelaySettings, choices: Choices) -> Played:
    """Six channels of a COMTRADE record on the relay's own clock, in primary volts and amperes.

    Where the record is secondary and does not state its ratios, the settings' ratios are taken.
    """
    read = read_comtrade(record)
    header = settings.relay
    ct_ratio, vt_ratio = choices.ct_ratio, choices.vt_ratio
    if header.ohms == "secondary" and not _states_ratios(read):
        ct_ratio = header.ct_ratio if ct_ratio is None else ct_ratio
        vt_ratio = header.vt_ratio if vt_ratio is None else vt_ratio
    overrides = Overrides(choices.unit, choices.scale, ct_ratio, vt_ratio)
    try:
        contacts = parse_mapping(read, choices.mapping or "").contacts
        six = select_channels(read, choices.mapping, overrides=overrides)
        warnings = _absent(read, six, choices)
        warnings += check_frequency(six, read.frequency_hz, header.frequency_hz)
        six = resample(
            six,
            header.sampling_hz,
            least_hz=LEAST_PER_CYCLE * header.frequency_hz,
            shortest_s=1 / header.frequency_hz,
            window_s=(choices.from_s, choices.to_s),
        )
    except InputError as error:
        file = settings.path if error.key == "relay.frequency_hz" else record
        raise error.within(file) from None
    warnings += check_values(six, header.frequency_hz, header.nominal_kv)
    names = ", ".join(f"{slot} = {name}" for slot, name in zip(SLOTS, six.names, strict=True) if name)
    notes = [f"channels: {names}", f"sampled at {_rates(read)} Hz, played at {header.sampling_hz} Hz"]
    span = int(six.t_ns[0]), int(six.t_ns[-1])
    start_ns = read.start_ns
    if start_ns <= 0:
        notes.append("when the record began is not known: its log begins at 2020-01-01T00:00:00Z")
        start_ns = UNKNOWN_START_NS
    return Played(
        six.values,
        sample_numbers(six.t_ns, header.sampling_hz),
        start_ns,
        (*notes, *read.notes, *six.notes),
        (*warnings, *six.warnings),
        _digital(read, *span),
        _closed(read, contacts, *span),
    )


def _rates(read: Record) -> str:
    """The sampling rates one after the other, if they are few."""
    hz = [f"{stretch.hz:g}" for stretch in read.stretches]
    return ", then ".join(hz) if len(hz) <= 6 else f"{', then '.join(hz[:5])} and {len(hz) - 5} more"


def _states_ratios(record: Record) -> bool:
    return all(channel.scale != "S" or channel.to_primary == channel.to_primary for channel in record.analog)


def _absent(read: Record, six: SixChannels, choices: Choices) -> list[str]:
    """Channels that were not found and not said to be absent: one or two of three are refused, three told."""
    given = parse_mapping(read, choices.mapping or "").analog
    warnings = []
    for first, words in ((0, "voltages"), (3, "currents")):
        slots = SLOTS[first : first + 3]
        lost = [slot for slot in slots if slot in six.missing and slot not in given]
        if not lost:
            continue
        why = _why_not(read, slots[0][0], choices)
        if any(slot not in six.missing for slot in slots):
            raise InputError(
                f"{', '.join(lost)} not found by name, phase and unit{why}: map it, or say that "
                f"there is none ({lost[0]}=-); `faultloop channels` lists them",
                key="--map",
            )
        warnings.append(f"no phase {words}{why}")
    return warnings


def _why_not(read: Record, quantity: str, choices: Choices) -> str:
    """Channels of the quantity that were left out, and why."""
    reasons: dict[str, list[str]] = {}
    for channel, (slot, label) in zip(read.analog, slots_of(read, choices.unit), strict=True):
        if not slot and label.quantity == quantity:
            why = label.why if not label.is_phase else f"phase {label.phase.upper()} without the other two"
            reasons.setdefault(why, []).append(f"'{channel.name}'")
    told = [
        f"{', '.join(names[:3])}{' ..' if len(names) > 3 else ''}: {why}" for why, names in reasons.items()
    ]
    return f" ({'; '.join(told[:3])})" if told else ""


def _digital(read: Record, first_ns: int, last_ns: int) -> tuple[DigitalChange, ...]:
    """The digital channels' states at the beginning, and every change."""
    found = []
    for number, channel in enumerate(read.status):
        for t_ns, on in _changes(read, channel.values, first_ns, last_ns):
            found.append(DigitalChange(t_ns, number, channel.name, bool(on), bool(channel.normal)))
    return tuple(sorted(found, key=lambda change: (change.t_ns, change.number)))


def _changes(read: Record, values: NDArray, first_ns: int, last_ns: int) -> list[tuple[int, int]]:
    """The value at the beginning of a span of time, and every change in it."""
    begin = max(int(np.searchsorted(read.t_ns, first_ns, side="right")) - 1, 0)
    stop = int(np.searchsorted(read.t_ns, last_ns, side="right"))
    rows = begin + 1 + np.flatnonzero(np.diff(values[begin:stop]))
    later = [(int(read.t_ns[row]), int(values[row])) for row in rows.tolist()]
    return [(first_ns, int(values[begin])), *later]


def _closed(
    read: Record, contacts: Mapping[str, StatusChannel], first_ns: int, last_ns: int
) -> tuple[tuple[int, int], ...]:
    """When which poles are closed, by the auxiliary contacts; a pole without one counts as closed.

    Where a pole's 52a and 52b say the same, it is on its way (or one is broken), and stays what it was.
    """
    if not contacts:
        return ()
    mask = np.zeros(len(read), np.int64)
    for bit, pole in enumerate("abc"):
        mask |= _pole(read, contacts, pole).astype(np.int64) << bit
    return tuple(_changes(read, mask, first_ns, last_ns))


def _pole(read: Record, contacts: Mapping[str, StatusChannel], pole: str) -> NDArray[np.bool_]:
    a = contacts.get(f"52a_{pole}", contacts.get("52a"))
    b = contacts.get(f"52b_{pole}", contacts.get("52b"))
    if a is None:
        return np.ones(len(read), bool) if b is None else ~b.values
    if b is None:
        return a.values
    agree = np.flatnonzero(a.values != b.values)
    if not len(agree):
        return np.ones(len(read), bool)
    last = np.searchsorted(agree, np.arange(len(read)), side="right") - 1
    return a.values[agree[np.maximum(last, 0)]]
