"""The .cfg: what the lines of text say, each error with its line and field.

Real files leave fields empty, end lines with commas, CR CR LF or NULs, and claim more than they have.  What a
record cannot do without is refused with its line; the rest is taken as not stated.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field

from faultloop.errors import InputError
from faultloop.io.comtrade.record import Rate, TimeQuality
from faultloop.io.comtrade.timestamps import epoch_ns, stamp_base_ns

FORMATS = ("ASCII", "BINARY", "BINARY32", "FLOAT32")
FASTEST_HZ = 1e8
"""Times are whole nanoseconds; the fastest travelling-wave recorders take 1e7 samples/s."""

_COUNTS = re.compile(r"\s*(\d{1,9})\s*,\s*(\d{1,9})\s*[Aa]?\s*,\s*(\d{1,9})\s*[Dd]?[\s,]*$")


@dataclass(frozen=True, slots=True)
class AnalogInfo:
    """An analog channel's line; NaN and (0, 0) where a field is left out."""

    name: str
    phase: str
    circuit: str
    unit: str
    a: float
    b: float
    skew_us: float
    least: float
    greatest: float
    ratio: tuple[float, float]
    scale: str  # P, S or ""


@dataclass(frozen=True, slots=True)
class StatusInfo:
    """A status channel's line."""

    name: str
    phase: str
    circuit: str
    normal: int


@dataclass(frozen=True, slots=True)
class Config:
    """A parsed .cfg."""

    station: str
    device: str
    revision: str  # 1991, 1999 or 2013
    analog: tuple[AnalogInfo, ...]
    status: tuple[StatusInfo, ...]
    frequency_hz: float  # 0 where not stated
    samples: int  # as the file states; 0: as many as there are
    rates: tuple[Rate, ...]  # empty: times are to be taken from the stamps
    format: str
    stamp_ns: float  # what one count of a time stamp is
    start_ns: int
    trigger_ns: int
    time_quality: TimeQuality
    notes: list[str] = field(default_factory=list)


class _Lines:
    """The lines, one after the other; the number of the last one read goes into errors."""

    def __init__(self, text: str) -> None:
        # Not `splitlines`: a name may hold what it takes for a line's end in other encodings.
        self.lines = re.split(r"\r*\n|\r", text)
        while self.lines and not self.lines[-1].strip():
            self.lines.pop()
        self.number = 0

    @property
    def left(self) -> int:
        return len(self.lines) - self.number

    def next(self) -> str:
        if not self.left:
            raise InputError(f"ends after line {self.number}: it is cut off")
        self.number += 1
        return self.lines[self.number - 1]

    def next_or_none(self) -> str:
        """The next line; empty where the file has ended."""
        return self.next() if self.left else ""

    def fields(self) -> list[str]:
        """The fields of the next line; commas at its end are nothing."""
        found = [part.strip() for part in self.next().split(",")]
        while found and not found[-1]:
            found.pop()
        return found

    def wrong(self, what: str) -> InputError:
        text = self.lines[self.number - 1].strip()
        shown = text if len(text) <= 60 else text[:57] + "..."
        return InputError(f"cannot be understood: '{shown}' ({what})", key=f"line {self.number}")

    def number_of(self, text: str, name: str, missing: float | None = None) -> float:
        """A finite number; ``missing`` where the field is empty, an error where that is None."""
        if not text and missing is not None:
            return missing
        try:
            found = float(text)
        except ValueError:
            raise self.wrong(f"{name}: '{text}' is no number") from None
        if not math.isfinite(found):
            raise self.wrong(f"{name} must be a finite number")
        return found


def parse_config(text: str) -> Config:
    """Parse a .cfg.  Raises InputError that names the line."""
    lines = _Lines(re.sub("[\x00\x1a]", "", text))
    if not lines.left:
        raise InputError("empty: it must begin with a line of station, device and revision")
    station, device, revision = _head(lines.next())
    notes: list[str] = []
    analog_count, status_count = _counts(lines, notes)
    analog = tuple(_analog(lines, revision) for _ in range(analog_count))
    status = tuple(_status(lines) for _ in range(status_count))
    frequency_hz = _frequency(lines, notes)
    rates, samples = _rates(lines)
    times = lines.next_or_none(), lines.next_or_none()
    start_ns, trigger_ns = _moments(times, revision, notes)
    format = lines.next_or_none().strip(" \t,").upper()
    if format not in FORMATS:
        raise InputError(f"data format '{format}': it must be one of {', '.join(FORMATS)}")
    factor = lines.number_of(lines.next_or_none().strip(" \t,"), "time stamp multiplication factor", 1.0)
    if factor <= 0:
        raise InputError(f"time stamp multiplication factor {factor:g}: it must be greater than 0")
    codes = [part.strip() or "0" for _ in range(2) for part in [*lines.next_or_none().split(","), "", ""][:2]]
    return Config(
        station,
        device,
        revision,
        analog,
        status,
        frequency_hz,
        samples,
        rates,
        format,
        factor * stamp_base_ns(times, revision),
        start_ns,
        trigger_ns,
        TimeQuality(*codes),
        notes,
    )


def _head(line: str) -> tuple[str, str, str]:
    """Station, device and revision, whatever year is claimed."""
    parts = [part.strip() for part in line.split(",")]
    while len(parts) > 2 and not parts[-1]:
        parts.pop()
    year = parts.pop() if len(parts) > 2 and re.fullmatch(r"\d{4}", parts[-1]) else "1991"
    revision = "2013" if int(year) >= 2013 else "1999" if int(year) >= 1999 else "1991"
    return parts[0], " ".join(parts[1:]), revision


def _counts(lines: _Lines, notes: list[str]) -> tuple[int, int]:
    """How many channels; refused here if there are not so many lines, before anything is made of them."""
    match = _COUNTS.match(lines.next())
    if match is None:
        raise lines.wrong("the channels' counts, as in 8,6A,2D")
    total, analog, status = (int(count) for count in match.groups())
    if analog + status > lines.left:
        raise InputError(
            f"{analog} analog and {status} status channels are due and {lines.left} lines follow: "
            "it is cut off",
            key=f"line {lines.number}",
        )
    if total != analog + status:
        notes.append(f"the .cfg counts {total} channels, which are {analog} analog and {status} status ones")
    return analog, status


def _analog(lines: _Lines, revision: str) -> AnalogInfo:
    """``n, name, phase, circuit, unit, a, b, skew, min, max[, primary, secondary, PS]``"""
    fields = lines.fields()
    if len(fields) < 6:
        raise lines.wrong(
            f"{len(fields)} fields, where an analog channel has {13 if revision > '1991' else 10}"
        )
    fields += [""] * (13 - len(fields))
    _, name, phase, circuit, unit, a, b, skew, least, greatest, primary, secondary, scale = fields[:13]
    skew_us = lines.number_of(skew, "skew", 0.0)
    if abs(skew_us) > 1e6:
        raise lines.wrong("skew must be within a second, in microseconds")
    limits = [_or_nan(text) for text in (least, greatest)]
    ratio = [_or_nan(text) for text in (primary, secondary)]
    stated = all(math.isfinite(part) and part > 0 for part in ratio)
    return AnalogInfo(
        name,
        phase,
        circuit,
        unit,
        lines.number_of(a, "a"),
        lines.number_of(b, "b", 0.0),
        skew_us,
        limits[0],
        limits[1],
        (ratio[0], ratio[1]) if stated else (0.0, 0.0),
        scale.upper() if scale.upper() in ("P", "S") else "",
    )


def _or_nan(text: str) -> float:
    """A number that nothing depends on; NaN where it is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def _status(lines: _Lines) -> StatusInfo:
    """``n, name, phase, circuit, normal``; 1991 has ``n, name, normal``."""
    fields = [part.strip() for part in lines.next().split(",")]
    if len(fields) < 2:
        raise lines.wrong("a status channel has 5 fields, 3 in 1991")
    name, rest = fields[1], fields[2:]
    phase, circuit = ("", "") if len(rest) < 2 else (rest[0], rest[1])
    normal = rest[0] if len(rest) == 1 else rest[2] if len(rest) > 2 else ""
    return StatusInfo(name, phase, circuit, int(normal == "1"))


def _frequency(lines: _Lines, notes: list[str]) -> float:
    text = lines.next().strip(" \t,")
    found = lines.number_of(re.sub(r"\s*hz$", "", text, flags=re.IGNORECASE), "line frequency", 0.0)
    if found < 0 or found > 1e6:
        notes.append(f"a line frequency of {found:g} Hz: taken as not stated")
        return 0.0
    return found


def _rates(lines: _Lines) -> tuple[tuple[Rate, ...], int]:
    """The rates, none where the times are to be taken from the stamps; and how many samples there are."""
    count = lines.number_of(lines.next().strip(" \t,"), "number of sampling rates")
    if count != int(count) or count < 0:
        raise lines.wrong("number of sampling rates")
    if count > lines.left:
        raise InputError(f"{count:g} sampling rates are due and {lines.left} lines follow: it is cut off",
                         key=f"line {lines.number}")  # fmt: skip
    if count == 0 and lines.left and re.search("[/:]", lines.lines[lines.number]):
        return (), 0  # the line of rate 0 is left out, too
    rates = []
    for _ in range(max(int(count), 1)):
        fields = [*lines.fields(), "", ""]
        hz = lines.number_of(fields[0], "sampling rate", 0.0)
        stop = lines.number_of(fields[1], "last sample", 0.0)
        if stop != int(stop) or not 0 <= stop < 2**40:
            raise lines.wrong("last sample: a whole number, 0 or greater")
        if not 0 <= hz <= FASTEST_HZ:
            raise lines.wrong(f"a sampling rate must be from 0 to {FASTEST_HZ:g} hertz")
        rates.append(Rate(hz, int(stop)))
    samples, stops = rates[-1].stop, [rate.stop for rate in rates]
    if (stops[:-1] if samples == 0 else stops) != sorted(stops[:-1] if samples == 0 else stops):
        raise InputError(f"last samples of the rates {stops}: each must be greater than the one before")
    if count == 0 or any(rate.hz == 0 for rate in rates):
        return (), samples
    before = [0, *stops]
    return tuple(
        r for r, last in zip(rates, before, strict=False) if r.stop != last or r is rates[-1]
    ), samples


def _moments(times: tuple[str, str], revision: str, notes: list[str]) -> tuple[int, int]:
    """Start and trigger [ns since 1970]; 0 and a note where they are no times."""
    start, trigger = (epoch_ns(line, revision) for line in times)
    for what, found, line in (("first sample", start, times[0]), ("trigger", trigger, times[1])):
        if found is None:
            notes.append(f"the time of the {what} is not known: '{line.strip()[:40]}' is no time")
    if start is None:
        return 0, 0
    return start, start if trigger is None else trigger
