"""A station for the tests of the process bus."""

from __future__ import annotations

from typing import Any

from faultloop.config.iec61850 import Iec61850
from faultloop.io.iec61850.streams import Station

MS = 1_000_000
START_NS = 1_577_836_800 * 10**9
"""2020-01-01T00:00:00Z"""


def station(
    sampling_hz: int = 4000, frequency_hz: int = 50, heartbeat_ms: int = 1000, **options: Any
) -> Station:
    return Station(
        ("RA", "RB"), ("QA", "QB"), sampling_hz, frequency_hz, heartbeat_ms * MS, Iec61850(**options), True
    )
