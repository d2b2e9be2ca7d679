"""The relays of a run side by side, as records that the compiled loop steps without Python."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.relay.estimators import ROW
from faultloop.relay.layout import CONSTANTS, STATE
from faultloop.relay.loops import MEASURE_CONSTANTS, MEASURE_STATE
from faultloop.relay.quantities import LOOPS, WIDE
from faultloop.relay.relay import Relay

NOTICES = 16
"""Room for samples at which relays have something to tell."""

RELAY = np.dtype(
    [
        (name, "i8")
        for name in (
            "step",  # address of the estimator's step; 0: it is plain Python
            "away",  # 1: it is restarting
            "made",  # estimates are made up to this sample
            "last",  # number of the last sample that it has decided on; -1: none yet
            "changed",  # samples at which a bit changed, since they were told
            "apart",  # 1: a function of the user's tells from a state that is its own, so at once
            "across",  # row of the samples in which the voltages of its breaker's other side are; -1: none
            "beside",  # and of the parallel line's relay
        )
    ]
)

Floats = NDArray[np.float64]
Records = Any


class Bank(NamedTuple):
    """R relays, and what they made of up to N samples."""

    relay: Records
    """(R,) RELAY"""
    constants: Records
    """(R,) CONSTANTS"""
    state: Records
    """(R,) STATE"""
    measure_constants: Records
    """(R,) MEASURE_CONSTANTS"""
    measure_state: Records
    """(R,) MEASURE_STATE"""
    estimator: Floats
    """the estimators' states, one after the other"""
    pointer: NDArray[np.int64]
    """(R + 1,) where each begins"""
    phasors: Floats
    """(R, N, 14)"""
    loops: Floats
    """(R, N, 12)"""
    words: NDArray[np.uint64]
    """(R, N, 2)"""
    notice: NDArray[np.int64]
    """(NOTICES, 2) relay and sample"""
    told: Records
    """(NOTICES,) STATE of the relay at that sample"""
    notices: NDArray[np.int64]
    """(1,) how many there are"""
    wide: Floats
    """(R, WIDE) the present sample of those that measure more than six channels"""


def bank_of(relays: Sequence[Relay], rows: int) -> Bank:
    """The relays as they are; what is in their arrays is theirs in the bank from now on.  Those that were in
    one before stay there."""
    again = _same_bank(relays, rows)
    if again is not None:
        return again
    count = len(relays)
    sizes = [relay.estimator.state.size for relay in relays]
    bank = Bank(
        relay=np.zeros(count, RELAY),
        constants=np.zeros(count, CONSTANTS),
        state=np.zeros(count, STATE),
        measure_constants=np.zeros(count, MEASURE_CONSTANTS),
        measure_state=np.zeros(count, MEASURE_STATE),
        estimator=np.zeros(sum(sizes)),
        pointer=np.cumsum([0, *sizes]).astype(np.int64),
        phasors=np.zeros((count, rows, ROW)),
        loops=np.zeros((count, rows, 2 * len(LOOPS))),
        words=np.zeros((count, rows, 2), np.uint64),
        notice=np.zeros((NOTICES, 2), np.int64),
        told=np.zeros(NOTICES, STATE),
        notices=np.zeros(1, np.int64),
        wide=np.zeros((count, WIDE)),
    )
    for i, relay in enumerate(relays):
        part = slice(i, i + 1)
        relay.settle_in(
            bank.constants[part],
            bank.state[part],
            bank.measure_constants[part],
            bank.measure_state[part],
            bank.estimator[bank.pointer[i] : bank.pointer[i + 1]],
        )
        relay.bank, relay.place = bank, i
        bank.relay[i] = (relay.step_address, 0, 0, -1, 0, relay.tells_apart, -1, -1)
    return bank


def _same_bank(relays: Sequence[Relay], rows: int) -> Bank | None:
    """The one that they are in, if it is theirs alone, as they are to be."""
    bank: Bank | None = relays[0].bank if relays else None
    if bank is None or bank.phasors.shape[:2] != (len(relays), rows):
        return None
    for i, relay in enumerate(relays):
        if relay.bank is not bank or relay.place != i:
            return None
        bank.relay[i] = (relay.step_address, 0, 0, -1, 0, relay.tells_apart, -1, -1)
    bank.notices[0] = 0
    return bank
