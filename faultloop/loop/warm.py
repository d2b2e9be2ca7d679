"""Relays that have been in service: a state that the very same samples have made is taken again."""

from __future__ import annotations

from collections import OrderedDict
from hashlib import blake2b
from typing import Any

import numpy as np

from faultloop.relay import Relay

KEPT = 256
"""States that are kept, the newest ones."""


class WarmStates:
    """What warm-ups have led to, by the relay and the bits of its samples."""

    def __init__(self) -> None:
        self._states: OrderedDict[tuple[Relay, bytes], Any] = OrderedDict()

    def warm_up(self, relay: Relay, samples: np.ndarray) -> None:
        """`Relay.warm_up`, or what it led to before."""
        key = (relay, blake2b(samples.tobytes(), digest_size=16).digest())
        known = self._states.get(key)
        if known is None:
            relay.warm_up(samples)
            self._states[key] = relay.save(), relay.events, relay.phasors[-1:].copy()
            if len(self._states) > KEPT:
                self._states.popitem(last=False)
            return
        self._states.move_to_end(key)
        state, relay.events, relay.phasors = known
        relay.restore(state)
