"""Which estimators distance protection may decide by, and why it refuses the others.

An estimator is allowed that was right in every shipped scenario and for every bolted fault in drawn networks,
10 % off the nominal frequency too (``bench/security.py --estimator``).  What was refused by a trial has its
figure here; docs/relay.md has the trials.
"""

from __future__ import annotations

OFFSET = "it has no state for a fault current's decaying offset"
REFUSED = {
    "adaptive-kalman": "off the nominal frequency it starts zones without a fault (2 of 120 relays)",
    "ekf": OFFSET,
    "half-fourier": "its zone 1 takes 51 ms for a three-phase fault close in",
    "m-class": "its window of several cycles is centred in the past",
    "mimic-fourier": "off the nominal frequency it misses faults well inside zone 1 (3 of 75)",
    "mstukf": OFFSET,
    "p-class": "its window of two cycles is centred in the past",
    "quarter-cycle": "it takes everything for the fundamental: it is for filtered records",
    "rls": "9 % off the nominal frequency it operates zone 1 for a fault behind",
    "stf": OFFSET,
    "stukf": OFFSET,
    "taylor-kalman": "its zone 1 takes 72 ms for a three-phase fault close in, and misses faults inside",
    "ukf": OFFSET,
}
"""Why, by method."""


def refusal(method: str) -> str | None:
    """Why protection does not decide by a method; None for one that it may take, or a user's own."""
    return REFUSED.get(method)
