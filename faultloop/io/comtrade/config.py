"""The .cfg: parsed by the `comtrade` package, around which this file puts what real records need.

The package stops at a time line that is not as its revision has it, and names no line when it stops.
"""

from __future__ import annotations

import math
import re
from calendar import timegm
from dataclasses import dataclass
from datetime import datetime

from comtrade import Cfg

from faultloop.errors import InputError
from faultloop.io.comtrade.record import SECOND_NS, Rate, TimeQuality

FORMATS = ("ASCII", "BINARY", "BINARY32", "FLOAT32")

_STAND_IN = "01/01/2000,00:00:00.000000"
_DATE = re.compile(r"\s*(\d{1,4})\s*[/.-]\s*(\d{1,2})\s*[/.-]\s*(\d{1,4})\s*$")
_TIME = re.compile(r"\s*(\d{1,2}):(\d{1,2}):(\d{1,2})(?:[.,](\d*))?\s*$")


@dataclass(slots=True)
class Config:
    """A parsed .cfg."""

    parsed: Cfg
    revision: str  # 1991, 1999 or 2013
    samples: int  # as the file states
    rates: tuple[Rate, ...]  # empty: times are to be taken from the stamps
    format: str
    stamp_ns: float  # what one count of a time stamp is
    start_ns: int
    trigger_ns: int
    time_quality: TimeQuality


class _Lines:
    """The lines for the package's parser; knows how far it got."""

    def __init__(self, lines: list[str]) -> None:
        self.lines = lines
        self.read = 0

    def readline(self) -> str:
        self.read += 1
        return self.lines[self.read - 1] + "\n" if self.read <= len(self.lines) else ""


def parse_config(text: str) -> Config:
    """Parse a .cfg.  Raises InputError that names the line."""
    lines = text.replace("\x1a", "").splitlines()
    if not any(line.strip() for line in lines):
        raise InputError("empty: it must begin with a line of station, device and revision")
    lines[0], revision = _first_line(lines[0])
    times, tail = ["", ""], ["", ""]
    place = _place_of_times(lines)
    if place is not None:
        times = [*lines[place : place + 2], "", ""][:2]
        tail = [*lines[place + 4 : place + 6], "", ""][:2]
        lines = [*lines[:place], _STAND_IN, _STAND_IN, *lines[place + 2 : place + 4]]
    reading = _Lines(lines)
    parsed = Cfg(ignore_warnings=True)
    try:
        parsed.read(reading)
    except Exception as error:  # the package raises whatever a bad field happens to cause
        raise _at(lines, reading.read, error) from error
    _check_channels(parsed)
    nanoseconds = any(_fraction_digits(line) > 6 for line in times)
    start_ns, trigger_ns = (_epoch_ns(line, revision) for line in times)
    codes = [part.strip() for line in tail for part in [*line.split(","), "", ""][:2]]
    stamp_ns = parsed.timemult * (1 if nanoseconds else 1000)
    if not (math.isfinite(stamp_ns) and stamp_ns > 0):
        raise InputError(f"time stamp multiplication factor {parsed.timemult}: it must be greater than 0")
    return Config(
        parsed=parsed,
        revision=revision,
        samples=parsed.sample_rates[-1][1],
        rates=_rates(parsed),
        format=_format(parsed),
        stamp_ns=stamp_ns,
        start_ns=start_ns,
        trigger_ns=trigger_ns,
        time_quality=TimeQuality(*(code or "0" for code in codes)),
    )


def _first_line(line: str) -> tuple[str, str]:
    """The first line as the package takes it, and the revision, whatever year is claimed."""
    parts = [part.strip() for part in line.split(",")]
    year = parts[-1] if len(parts) > 2 and re.fullmatch(r"\d{4}", parts[-1]) else None
    names = parts[:-1] if year is not None or (len(parts) > 2 and not parts[-1]) else parts
    station, device = names[0], " ".join(names[1:])
    if year is None or int(year) < 1999:
        return f"{station},{device},1991", "1991"
    revision = "2013" if int(year) >= 2013 else "1999"
    return f"{station},{device},{revision}", revision


def _place_of_times(lines: list[str]) -> int | None:
    """Index of the line with the first sample's time, by the counts; None where they cannot be read."""
    counts = re.match(
        r"\s*\d+\s*,\s*(\d{1,6})\s*[Aa]\s*,\s*(\d{1,6})\s*[Dd]", lines[1] if len(lines) > 1 else ""
    )
    if counts is None:
        return None
    place = 2 + int(counts[1]) + int(counts[2]) + 1
    number = re.match(r"\s*(\d{1,4})\s*$", lines[place] if place < len(lines) else "")
    return None if number is None else place + 1 + max(int(number[1]), 1)


def _check_channels(parsed: Cfg) -> None:
    for channel in parsed.analog_channels:
        if not (math.isfinite(channel.a) and math.isfinite(channel.b) and math.isfinite(channel.skew)):
            raise InputError("a, b and skew must be finite numbers", key=f"channel {channel.name}")


def _rates(parsed: Cfg) -> tuple[Rate, ...]:
    rates = tuple(Rate(hz, stop) for hz, stop in parsed.sample_rates)
    stops = [rate.stop for rate in rates]
    if stops[0] < 0 or stops != sorted(stops):
        raise InputError(f"last samples of the rates {stops}: each must be greater than the one before")
    if any(not math.isfinite(rate.hz) or rate.hz < 0 for rate in rates):
        raise InputError("a sampling rate must be a number of hertz, 0 or greater")
    return () if parsed.timestamp_critical or any(rate.hz == 0 for rate in rates) else rates


def _format(parsed: Cfg) -> str:
    name = parsed.ft.strip().upper()
    if name not in FORMATS:
        raise InputError(f"data format '{parsed.ft}': it must be one of {', '.join(FORMATS)}")
    return name


def _fraction_digits(line: str) -> int:
    return len(line.rpartition(".")[2].strip()) if "." in line else 0


def _epoch_ns(line: str, revision: str) -> int:
    """A time line as nanoseconds since 1970, taken as UTC; 0 where it has no date.

    1991 has the month first and two digits of the year, and not all devices that claim it do: what cannot be
    a month is the day.
    """
    date, _, clock = line.partition(",")
    day, time = _DATE.match(date), _TIME.match(clock)
    if day is None:
        return 0
    first, second, year = (int(part) for part in day.groups())
    if first > 31:
        first, year = year, first  # the ISO order
    month, number = (first, second) if revision == "1991" else (second, first)
    if month > 12:
        month, number = number, month
    if year < 100:
        year += 1900 if year >= 70 else 2000
    hour, minute, second, fraction = (0, 0, 0, "") if time is None else time.groups()
    try:
        whole = timegm(datetime(year, month, number, int(hour), int(minute)).timetuple())
    except ValueError:
        return 0
    return (whole + int(second)) * SECOND_NS + int(((fraction or "") + "0" * 9)[:9])


def _at(lines: list[str], number: int, error: Exception) -> InputError:
    """The error, with the line in which the package's parser stopped."""
    if number > len(lines):
        return InputError(f"ends after line {len(lines)}: it is cut off")
    text = lines[number - 1].strip()
    shown = text if len(text) <= 60 else text[:57] + "..."
    return InputError(f"cannot be understood: '{shown}' ({error})", key=f"line {number}")
