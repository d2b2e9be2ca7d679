"""Relays that have been in service when a run begins.

They have run over a second of the steady state of the network as it stands without its faults: so it is the
same one wherever a fault is, and of many cases the relays' states are made once.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from hashlib import blake2b
from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.config.place import more_rows
from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant
from faultloop.relay import Relay
from faultloop.relay.quantities import WIDE

KEPT = 256
"""States that are kept, the newest ones."""
OF_THE_RUN = ("fault", "switching", "bus_fault", "can", "expect")
HEADER = {"name", "duration_s", "start"}
NO_MATTER = {"scenario": HEADER} | dict.fromkeys(OF_THE_RUN, True)
"""What has no part in the state before the run."""


def history(scenario: Scenario) -> NDArray[np.float64]:
    """The samples of a second before sample 0, (n, rows, 6): whole cycles at any nominal frequency."""
    plant = Plant(scenario.model_copy(update={"fault": ()}))
    return plant.history(plant.sampling_hz)


def warm_up(scenario: Scenario, relays: Sequence[Relay]) -> None:
    """Each relay, in the scenario's order, as it is at sample 0."""
    for relay, samples in zip(relays, measured(scenario, history(scenario)), strict=True):
        relay.warm_up(samples)


def measured(scenario: Scenario, samples: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """What each relay measures of the plant's samples (n, rows, 6): (n, 6), or (n, WIDE) of one that also
    does the breaker's other side or the parallel line."""
    found = []
    for i, (across, beside) in enumerate(more_rows(scenario.relay)):
        own = samples[:, i]
        if across >= 0 or beside >= 0:
            more = np.full((len(own), WIDE - 6), np.nan)
            if across >= 0:
                more[:, :3] = samples[:, across, :3]
            if beside >= 0:
                more[:, 3] = samples[:, beside, 3:].sum(axis=1)
            own = np.hstack([own, more])
        found.append(np.ascontiguousarray(own))
    return found


class WarmStates:
    """What warm-ups have led to, by the relay and the bits of its samples."""

    def __init__(self) -> None:
        self._digests: OrderedDict[str, list[bytes]] = OrderedDict()
        """Of the samples of each relay, by what a scenario says of the time before the run."""
        self._states: OrderedDict[tuple[Relay, bytes], Any] = OrderedDict()
        self._last: tuple[Scenario, str] | None = None

    def warm_up(self, scenario: Scenario, relays: Sequence[Relay]) -> None:
        """`warm_up`, or what it led to before."""
        said = self._said(scenario)
        digests = self._digests.get(said)
        if digests is None or not all(key in self._states for key in zip(relays, digests, strict=True)):
            digests = self._digests[said] = self._run(measured(scenario, history(scenario)), relays)
        self._digests.move_to_end(said)
        for key in zip(relays, digests, strict=True):
            self._take(*key)
        for kept in (self._digests, self._states):
            while len(kept) > KEPT:
                kept.popitem(last=False)

    def _said(self, scenario: Scenario) -> str:
        """What it says of the time before the run; mostly it is what the last one said."""
        last = self._last
        if last is None or not _alike(scenario, last[0]):
            said = scenario.model_dump_json(by_alias=True, exclude=NO_MATTER)
            self._last = last = scenario, said
        return last[1]

    def _run(self, before: Sequence[NDArray[np.float64]], relays: Sequence[Relay]) -> list[bytes]:
        """Warms up where that was never done; returns the digests of the relays' samples."""
        digests = []
        for i, (relay, samples) in enumerate(zip(relays, before, strict=True)):
            digests.append(blake2b(samples.tobytes(), digest_size=16).digest())
            if (relay, digests[i]) not in self._states:
                relay.warm_up(samples)
                state = relay.save(), relay.events, relay.phasors[-1:].copy()
                self._states[relay, digests[i]] = state
        return digests

    def _take(self, relay: Relay, digest: bytes) -> None:
        self._states.move_to_end((relay, digest))
        state, relay.events, relay.phasors = self._states[relay, digest]
        relay.restore(state)


def _alike(a: Scenario, b: Scenario) -> bool:
    """Whether they surely say the same of the time before the run."""
    tables = [key for key in type(a).model_fields if key not in OF_THE_RUN and key != "scenario"]
    return all(getattr(a, key) == getattr(b, key) for key in tables) and (
        a.scenario is b.scenario
        or a.scenario.model_copy(update={key: getattr(b.scenario, key) for key in HEADER}) == b.scenario
    )
