"""RREC: sequences by the kernel alone: who starts it, dead times, shots, lockout, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from faultloop.errors import InputError
from faultloop.relay import Relay, RelaySettings
from faultloop.relay.functions import rrec
from faultloop.relay.functions.rrec import RREC
from tests.relay.functions.kernel import GIVEN, Kernel

MS = 4.8
ZONES = [{"zone": 1, "reach_pu": 0.8}, {"zone": 2, "reach_pu": 1.3, "delay_ms": 300.0}]
TABLE = {"dead_one_pole_ms": 500.0, "dead_three_pole_ms": [300.0, 400.0], "reclaim_ms": 1000.0}
ONE_POLE = {"pdis": ZONES, "ptrc": {"mode": "single-pole"}}
FAST, SLOW = 0, 1
"""Bits of the functions that trip in these tests: only the first is reclosed after."""


class Sequence:
    """A relay's reclosing, beside a breaker and a fault that this plays."""

    def __init__(self, **table: Any) -> None:
        self.k = Kernel(RREC, TABLE | table, **ONE_POLE)
        self.k.c["bit"], self.k.c["starts"] = 10, 1 << FAST

    def run(self, ms: float, trip: int = 0, by: int = FAST, **published: Any) -> Sequence:
        """So long, while these poles are tripped for and that is published."""
        q = self.k.q
        for n in range(round(ms * MS)):
            q["poles"] = trip
            q["request"]["bit"] = by
            request = q["request"].copy()
            request["made"] = trip != 0 and n == 0
            self.k.step(request=request, **published)
        return self

    def open(self, poles: int, after_ms: float = 50.0, by: int = FAST) -> Sequence:
        """A trip; the breaker opens."""
        self.run(after_ms, poles, by)
        self.k.q["closed"] &= ~poles
        return self.run(40.0, poles, by)

    def closes(self, within_ms: float) -> float:
        """When the command to close comes, from now [ms]; the breaker obeys."""
        q = self.k.q
        for n in range(round(within_ms * MS)):
            if q["close_poles"]:
                q["closed"] |= q["close_poles"]
                self.run(1.0)
                return n / MS
            self.run(1 / MS)
        return np.nan

    @property
    def state(self) -> int:
        return int(self.k.w["state"])


def test_a_pole_is_closed_after_its_dead_time_and_the_relay_is_ready_after_the_reclaim_time() -> None:
    s = Sequence().open(0b001)
    assert s.state == rrec.DEAD
    assert s.k.q["three_pole"] == 1, "a fault now takes three poles"
    assert s.closes(600.0) == pytest.approx(460.0, abs=1.0), "500 ms from open, 40 are over"
    assert s.state == rrec.RECLAIM
    assert s.k.q["close_poles"] == 0
    assert s.run(990.0).state == rrec.RECLAIM
    assert s.run(20.0).state == rrec.READY
    assert s.k.q["three_pole"] == 0


def test_a_fault_that_stays_has_its_shots_and_then_lockout() -> None:
    s = Sequence().open(0b001)
    s.closes(600.0)
    s.run(100.0).open(0b111)
    assert s.closes(600.0) == pytest.approx(360.0, abs=1.0), "the second shot is three-pole, of 400 ms"
    s.run(100.0).open(0b111)
    assert (s.state, int(s.k.w["cause"])) == (rrec.LOCKOUT, rrec.LAST)
    assert np.isnan(s.closes(3000.0))
    s.k.q["closed"] = 7  # by hand
    assert s.run(990.0).state == rrec.LOCKOUT
    assert s.run(20.0).state == rrec.READY


def test_a_fault_that_grows_in_the_dead_time_becomes_a_three_pole_shot() -> None:
    s = Sequence().open(0b001).run(100.0)
    s.open(0b111)
    assert s.state == rrec.DEAD
    assert s.closes(600.0) == pytest.approx(260.0, abs=1.0)
    s = Sequence(dead_three_pole_ms=[]).open(0b001).run(100.0).open(0b111)
    assert (s.state, int(s.k.w["cause"])) == (rrec.LOCKOUT, rrec.GREW)


@pytest.mark.parametrize(
    ("does", "cause"),
    [
        (lambda s: s.open(0b111, by=SLOW), rrec.DELAYED),
        (lambda s: s.run(400.0, 0b111), rrec.STAYS),
        (lambda s: s.open(0b001).run(10.0, back_trip=7), rrec.FAILED),
        (lambda s: (s.k.q.__setitem__("closed", 0b110), s.run(10.0))[1], rrec.OPENED),
        (lambda s: (s.open(0b001), s.k.q.__setitem__("closed", 7), s.run(10.0))[2], rrec.MOVED),
        (lambda s: s.open(0b001).run(800.0), rrec.STILL_OPEN),
    ],
    ids=["delayed", "stays closed", "breaker failure", "opened by hand", "closed by hand", "does not close"],
)
def test_what_ends_in_lockout(does: Any, cause: int) -> None:
    s = does(Sequence())
    assert (s.state, int(s.k.w["cause"])) == (rrec.LOCKOUT, cause)
    assert np.isnan(s.closes(1000.0))


@pytest.mark.parametrize(("release", "cause"), [(0, rrec.NO_RELEASE), (-1, rrec.NO_VOLTAGE)])
def test_three_poles_wait_for_the_release_and_one_does_not(release: int, cause: int) -> None:
    s = Sequence()
    s.k.c["asks"] = 1
    s.k.q["release"] = release
    assert s.open(0b001).closes(600.0) > 0
    s = Sequence()
    s.k.c["asks"] = 1
    s.k.q["release"] = release
    s.open(0b111).run(1000.0)
    assert s.state == rrec.WAIT
    s.k.q["release"] = 1
    assert s.closes(10.0) < 1.0
    s = Sequence()
    s.k.c["asks"], s.k.q["release"] = 1, release
    assert s.open(0b111).run(2400.0).state == rrec.LOCKOUT
    assert int(s.k.w["cause"]) == cause


def test_zone_extension_is_there_while_the_relay_is_ready() -> None:
    s = Sequence()
    s.k.c["extended"] = 0b10
    assert s.run(10.0).k.q["rests"] == 0
    assert s.open(0b111).k.q["rests"] == 0b10
    s.closes(600.0)
    assert s.run(500.0).k.q["rests"] == 0b10
    assert s.run(600.0).k.q["rests"] == 0


def test_by_default_the_zones_without_delay_start_it() -> None:
    relay = Relay(RelaySettings.from_dict(GIVEN | ONE_POLE | {"rrec": TABLE}))
    bit = relay.bits.index("PDIS1")
    assert int(relay._constants["rrec"]["starts"][0, 0]) == 1 << bit


@pytest.mark.parametrize(
    ("data", "key", "what"),
    [
        (
            {"rrec": {}, "ptrc": {"mode": "single-pole"}},
            "rrec.dead_one_pole_ms",
            'missing: ptrc.mode = "single-pole" opens one pole, which must be closed again; such as 800',
        ),
        (
            {"rrec": {"dead_one_pole_ms": 500.0}},
            "rrec.dead_one_pole_ms",
            'no pole is tripped alone; leave it out, or say ptrc.mode = "single-pole"',
        ),
        (
            {"rrec": {"dead_three_pole_ms": []}},
            "rrec.dead_three_pole_ms",
            "there is no shot; give at least one dead time, such as [300]",
        ),
        (
            {"rrec": {"extension_zone": 5}, "pdis": ZONES},
            "rrec.extension_zone",
            "there is no zone 5; zones: 1, 2",
        ),
        (
            {"rrec": {"extension_zone": 2}, "pdis": ZONES},
            "rrec.extension_zone",
            "no reclosing follows a trip of PDIS2; name it in rrec.starts, or give it no delay",
        ),
        (
            {"rrec": {"reclaim_ms": 0.0}, "pdis": ZONES},
            "rrec.reclaim_ms",
            "is 0: a fault that is still there would be a new one, and reclosed after without end; at least "
            "100, some seconds as a rule",
        ),
        (
            {"rrec": {"reclaim_ms": 300.0, "starts": ["PDIS1", "PDIS2"]}, "pdis": ZONES},
            "rrec.reclaim_ms",
            "is 300: a fault that is still there would be a new one, and reclosed after without end; at "
            "least 400, some seconds as a rule",
        ),
    ],
)
def test_what_is_wrong_is_named(data: dict[str, Any], key: str, what: str) -> None:
    with pytest.raises(InputError) as error:
        RelaySettings.from_dict(GIVEN | data)
    assert (error.value.key, error.value.what) == (key, what)


def test_a_starter_that_is_not_there_is_named() -> None:
    data = GIVEN | {"pdis": ZONES, "rrec": {"starts": ["PDIS9"]}}
    with pytest.raises(InputError) as error:
        Relay(RelaySettings.from_dict(data))
    assert error.value.key == "rrec.starts"
    assert error.value.what == "there is no function 'PDIS9'; did you mean 'PDIS2'?"
