"""The two time lines of a .cfg: when the first sample and the trigger were, and what a time stamp counts."""

from __future__ import annotations

import re
from calendar import timegm
from datetime import datetime

from faultloop.io.comtrade.record import SECOND_NS

_DATE = re.compile(r"\s*(\d{1,4})\s*[/.-]\s*(\d{1,2})\s*[/.-]\s*(\d{1,4})\s*$")
_TIME = re.compile(r"\s*(\d{1,2}):(\d{1,2}):(\d{1,2})(?:[.,](\d*))?\s*$")
_LATEST_NS = 2**63 - 1 - 2**60  # a log's times are int64 nanoseconds; 36 years are left for the record


def stamp_base_ns(lines: tuple[str, str], revision: str) -> int:
    """What one count of a time stamp is [ns], before the multiplication factor.

    Microseconds; nanoseconds only in 2013, and there only where the seconds have nine digits after the point
    (IEC 60255-24:2013, 7.4.8).  Devices write seven digits and still count in microseconds.
    """
    return 1 if revision == "2013" and any(_fraction_digits(line) == 9 for line in lines) else 1000


def epoch_ns(line: str, revision: str) -> int | None:
    """A time line as nanoseconds since 1970, taken as UTC; None where it is no time, or none that fits.

    1991 has the month first and two digits of the year, and not all devices that claim it do: what cannot be
    a month is the day.
    """
    date, _, clock = line.partition(",")
    day, time = _DATE.match(date), _TIME.match(clock.rstrip(" ,"))
    if day is None or time is None:
        return None
    first, second, year = (int(part) for part in day.groups())
    if first > 31:
        first, year = year, first  # the ISO order
    month, number = (first, second) if revision == "1991" else (second, first)
    if month > 12:
        month, number = number, month
    if year < 100:
        year += 1900 if year >= 70 else 2000
    hour, minute, second, fraction = time.groups()
    if int(second) > 60:  # 60 is a leap second
        return None
    try:
        whole = timegm(datetime(year, month, number, int(hour), int(minute)).timetuple())
    except ValueError:
        return None
    found = (whole + int(second)) * SECOND_NS + int(((fraction or "") + "0" * 9)[:9])
    return found if abs(found) <= _LATEST_NS else None


def _fraction_digits(line: str) -> int:
    """Digits after the point of the seconds; a date with points has none of them."""
    time = _TIME.match(line.partition(",")[2].rstrip(" ,"))
    return len(time[4] or "") if time is not None else 0
