"""Response times, loss and babbling on the bus: the analysis by hand, and the suite's parts."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.study.suites import run_suite
from faultloop.study.suites.bus import babbling as bus_babbling
from faultloop.study.suites.bus import loss as bus_loss
from faultloop.study.suites.bus import response as bus_response
from faultloop.study.suites.bus.response_times import (
    Errors,
    Message,
    first_response_ns,
    longest_bits,
    response_ns,
)

US = 1_000


def test_longest_frames_of_the_standard():
    # Davis et al. (2007): 55 to 135 bits for 11-bit identifiers, 80 to 160 for 29-bit ones
    assert [longest_bits(0), longest_bits(8), longest_bits(0, True), longest_bits(8, True)] == [
        55,
        135,
        80,
        160,
    ]
    assert longest_bits(7) == 125  # 1 ms at 125 kbit/s


def test_a_jitter_by_hand():
    """Two messages of 100 us; the higher comes each 300 us, up to 250 us late, so two may be 50 us apart.

    The lower waits for both of them and is received after 300 us.  The higher is blocked for 100 us, and its
    own jitter counts: 250 + 100 + 100.
    """
    pair = [Message("a", 100 * US, 300 * US, 250 * US), Message("b", 100 * US, 1000 * US)]
    assert response_ns(pair, 0, US) == 450 * US
    assert response_ns(pair, 1, US) == 300 * US


def test_errors_by_hand():
    """Each costs 31 bits and the frame again: for one of 100 us at 1 Mbit/s 100 + 131 us, two 131 more."""
    alone = [Message("a", 100 * US, 1000 * US)]
    assert response_ns(alone, 0, US, Errors(1, 10_000 * US)) == 231 * US
    assert response_ns(alone, 0, US, Errors(2, 10_000 * US)) == 362 * US
    # Where the next comes within the response, it costs as well: 231 us are longer than 200.
    assert response_ns(alone, 0, US, Errors(1, 200 * US)) == 362 * US
    # An error each 131 us is a bus with nothing else on it.
    assert response_ns(alone, 0, US, Errors(1, 131 * US)) is None
    # Below a short message of higher priority the longer own frame counts: 100 + 131 + one of 50.
    pair = [Message("b", 50 * US, 1000 * US), *alone]
    assert response_ns(pair, 1, US, Errors(1, 10_000 * US)) == 281 * US


def test_no_bound_where_the_bus_is_full():
    full = [Message("a", 100, 100), Message("b", 100, 10_000)]
    assert response_ns(full, 0, 1) is None
    assert response_ns(full, 1, 1) is None
    assert first_response_ns(full, 1, 1) is None


def test_the_analysis_of_1994_is_too_short_for_c():
    messages = [stream.message(bus_response.EXAMPLE_BITRATE) for stream in bus_response.EXAMPLE]
    assert [m.time_ns for m in messages] == [1_000_000] * 3
    assert first_response_ns(messages, 2, 10 * US) == 3_000_000
    assert response_ns(messages, 2, 10 * US) == 3_500_000
    assert bus_response.critical_ns(bus_response.EXAMPLE, 2, bus_response.EXAMPLE_BITRATE) == 3_500_000


@pytest.mark.parametrize("loss", bus_loss.CASES, ids=lambda c: c.title)
def test_closed_form_of_the_delay(loss):
    share, delays = bus_loss.distribution(loss)
    assert share.sum() == pytest.approx(1.0, abs=1e-6)
    assert delays[:6].tolist() == [0, 2, 6, 14, 30, 62]
    if loss.burst is None:  # geometric, but for the few who had not heard the relay before
        expected = (1 - loss.share) * loss.share ** np.arange(8)
        np.testing.assert_allclose(share[:8], expected, atol=loss.share**9 + 1e-12)


@pytest.mark.parametrize("part", ["loss", "response-times"])
def test_the_parts_hold(part):
    (report,) = run_suite("bus", [part], quick=True)
    assert report.held, [check for check in report.checks if not check.held]


def test_the_limits_of_loss_are_missed_by_another_distribution():
    sent, _, _ = bus_loss.trips(bus_loss.Loss(0.3), 200)
    share, _ = bus_loss.distribution(bus_loss.Loss(0.5))
    assert bus_loss.largest_gap(sent, share) > 0.138  # the limit for 200


def test_babblers_at_their_worst():
    """The lowest priority costs a frame's time; the highest, from where it fills the bus on, the trip."""
    low, load = bus_babbling.trip_times_ms(bus_babbling.LOWEST, 100, 5)
    assert load > 0.8
    assert low.max() <= (bus_babbling.bound_ms(bus_babbling.LOWEST, 100) or 0)
    high, _ = bus_babbling.trip_times_ms(bus_babbling.HIGHEST, 50, 5)
    assert high.max() <= (bus_babbling.bound_ms(bus_babbling.HIGHEST, 50) or 0)
    assert bus_babbling.bound_ms(bus_babbling.HIGHEST, 100) is None
    drowned, load = bus_babbling.trip_times_ms(bus_babbling.HIGHEST, 200, 2)
    assert not np.isfinite(drowned).any()
    assert load > 0.99
