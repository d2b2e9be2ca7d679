"""A stretch of a relay's samples and what it made of them, as it goes into a log."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.relay import Relay
from faultloop.relay.bank import Bank

Array = NDArray[np.float64]


class RelayBlock(NamedTuple):
    """Of n samples: (n, 6), phasors (n, 14), loops (n, 12), bits of pickup and of operate (n,)."""

    samples: Array
    phasors: Array
    loops: Array
    pickup: NDArray[np.uint64]
    operate: NDArray[np.uint64]

    @classmethod
    def of(cls, relay: Relay, samples: Array) -> RelayBlock:
        """The relay's last `advance`, over `samples`; the relay's next one overwrites it."""
        return cls(samples, relay.phasors, relay.loops, relay.pickup, relay.operate)

    @classmethod
    def of_bank(cls, bank: Bank, samples: Array, relay: int, count: int) -> RelayBlock:
        """The first ``count`` rows of one relay in a bank, which are overwritten when it goes on."""
        words = bank.words[relay, :count]
        phasors, loops = bank.phasors[relay, :count], bank.loops[relay, :count]
        return cls(samples[:count, relay], phasors, loops, words[:, 0], words[:, 1])
