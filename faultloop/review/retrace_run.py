"""A relay that is run once more, over stretches of a log, and what is kept of what it knew.

While there is nothing to explain just under half a cycle is decided at once: no disturbance, no loss of the
reference, is as short as that.  Where a bit changed in it, or there is something to explain at its end, the
state is put back and the samples are decided one by one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.relay import Relay, RelayInputs
from faultloop.relay.bank import bank_of
from faultloop.relay.chain import decide
from faultloop.relay.explain import SHARED, ZONE, explain
from faultloop.relay.functions.pdis import PDIS
from faultloop.review.far_sets import FarSets

MOST = 1 << 16
"""Samples that are kept of a relay: 14 s at 4800 a second, some 90 MB with four zones."""
FULL_S = 0.5
"""From where something begins, and from where a bit changes, in which every sample is kept."""


class RetraceRun:
    """A relay that decides once more.

    Parameters
    ----------
    relay : as it is when it is switched on; it may then be warmed up.
    far : what comes from the other ends of a line differential.

    Attributes
    ----------
    kept : the samples at which there was something to explain.
    """

    def __init__(self, relay: Relay, far: FarSets | None = None) -> None:
        self.relay, self._far = relay, far
        self._cold = relay.save()
        bank = bank_of([relay], 1)  # its records are the relay's from now on
        self._constants, self._state = bank.constants, bank.state
        self._bytes = self._state.view(np.uint8)
        self._before = np.empty_like(self._bytes)
        zones = max(int(self._constants["count"][PDIS.key][0]), 1)
        sampling_hz = relay.settings.relay.sampling_hz
        self.kept = Kept(zones, round(FULL_S * sampling_hz))
        self._block = max(int(sampling_hz / relay.settings.relay.frequency_hz) // 2 - 1, 1)
        self._shared, self._zones = np.zeros(1, SHARED), np.zeros((1, zones), ZONE)
        self._quiet = False
        self._word = np.zeros(2, np.uint64)

    @property
    def constants(self) -> Any:
        """Record of type `faultloop.relay.layout.CONSTANTS`: the settings in primary values and samples."""
        return self._constants[0]

    def restart(self) -> None:
        """Cold, as after a gap."""
        self.relay.restore(self._cold)
        self._quiet = False

    def take(
        self,
        first: int,
        rows: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
        inputs: NDArray[np.int64],
        t_ns: NDArray[np.int64],
    ) -> NDArray[np.uint64]:
        """The next samples, from number ``first`` on; returns their words (n, 2).

        Parameters
        ----------
        rows : samples (n, 6) or (n, WIDE), phasors (n, 14), loops (n, 12), C-contiguous.
        inputs : (n, 5) rows of `RelayInputs`, what the relay heard.
        t_ns : (n,) their times.
        """
        n = len(inputs)
        words = np.zeros((n, 2), np.uint64)
        heard = [*(np.flatnonzero((inputs[1:] != inputs[:-1]).any(axis=1)) + 1).tolist(), n]
        k, stretch, singly = 0, 0, 0
        while k < n:
            while heard[stretch] <= k:
                stretch += 1
            ahead = self._block if self._quiet else self.kept.passed_over(first + k)
            stop = min(k + ahead, heard[stretch])
            self.relay.sample_count = first + k
            self.relay.set_inputs(RelayInputs(*inputs[k].tolist()))
            if self._far is not None:
                # what is compared is noted at the sample after it
                given = self._far.give(first + k)
                stop = k + 1 if given else min(stop, self._far.next_number(first + k) - first)
            if stop <= k + 1 or k < singly or not self._passes(rows, words, k, stop):
                self._one(first, k, rows, words, t_ns)
                singly, stop = max(singly, stop), k + 1
            k = stop
        return words

    def _passes(self, rows: tuple[Any, ...], words: NDArray[np.uint64], k: int, stop: int) -> bool:
        """Whether nothing happens in these samples, quiet or not; if something does, nothing is done."""
        part = slice(k, stop)
        self._before[:] = self._bytes
        done = decide(self._constants, self._state, *(x[part] for x in rows), words[part])
        if done == stop - k and (words[part] == self._word).all() and self._explained() != self._quiet:
            return True
        self._bytes[:] = self._before
        return False

    def _explained(self) -> bool:
        return bool(explain(self._constants, self._state, self._shared, self._zones))

    def _one(
        self, first: int, k: int, rows: tuple[Any, ...], words: NDArray[np.uint64], t_ns: NDArray[np.int64]
    ) -> None:
        part = slice(k, k + 1)
        decide(self._constants, self._state, *(x[part] for x in rows), words[part])
        changed = bool((words[k] != self._word).any())
        if self._explained():
            self._shared["number"] = first + k
            self.kept.take(int(t_ns[k]), self._shared, self._zones, changed or self._quiet)
            self._quiet = False
        else:
            self._quiet = not changed
        self._word = words[k].copy()


class Kept:
    """At most `MOST` samples: where they are more, all are kept for a while from each change on, and of the
    others one in ``step``, a power of two.

    Parameters
    ----------
    zones : how many a row has.
    full : samples from a change on.
    """

    def __init__(self, zones: int, full: int) -> None:
        kinds = [("t_ns", "i8"), ("marked", "?"), ("shared", SHARED), ("zones", ZONE, (zones,))]
        self._rows: NDArray[np.void] = np.zeros(min(1024, MOST), np.dtype(kinds, align=True))
        self._count = self._marks = 0
        self._full, self._until = full, -1
        self.step = 1

    @property
    def t_ns(self) -> NDArray[np.int64]:
        return self._rows["t_ns"][: self._count]

    @property
    def shared(self) -> NDArray[np.void]:
        return self._rows["shared"][: self._count]

    @property
    def zones(self) -> NDArray[np.void]:
        return self._rows["zones"][: self._count]

    def passed_over(self, number: int) -> int:
        """How many samples from this one on are not to be kept if nothing changes."""
        return 0 if self._is_marked(number) else -number % self.step

    def _is_marked(self, number: int) -> bool:
        """Whether something has just begun; not where that is always so."""
        return number < self._until and self._marks < MOST // 2

    def take(self, t_ns: int, shared: NDArray[np.void], zones: NDArray[np.void], changed: bool) -> None:
        """One more; ``changed``: something begins with it."""
        number = int(shared["number"][0])
        if changed:
            self._until = number + self._full
        marked = self._is_marked(number)
        if not marked and number % self.step:
            return
        if self._count == len(self._rows):
            self._make_room()
        self._rows[self._count] = (t_ns, marked, shared[0], zones[0])
        self._count, self._marks = self._count + 1, self._marks + marked

    def _make_room(self) -> None:
        if self._count < MOST:
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
            return
        while self._count > MOST * 3 // 4:
            self.step *= 2
            rows = self._rows[: self._count]
            stay = rows["marked"] | (rows["shared"]["number"] % self.step == 0)
            self._count = int(stay.sum())
            self._rows[: self._count] = rows[stay]
