"""Plant and relays, run ahead of the bus.

They are advanced in long blocks, on the assumption that nothing will come from the bus meanwhile: the plant
to its next change, each relay over what the plant has made to its own.  The bus then follows to the first of
these changes.  Where a relay's input changes, that relay's block, and where a breaker is commanded, that of
all is forgotten beyond that instant, and run again with it: the same, bit for bit, as sample by sample, and a
repetition that everybody has heard costs nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from faultloop.nodes.block import RelayBlock
from faultloop.plant import Plant
from faultloop.relay import Event, Relay


class Part(NamedTuple):
    """A relay's share in a piece; it `ends` where the relay's block does, at which its outputs may change."""

    block: RelayBlock
    events: list[Event]
    ends: bool


class Piece(NamedTuple):
    """What `Ahead.take` gives: `length` samples from number `first` on, of the relays that run, by number.

    It `ends` where the plant's block does: then the plant's changes are its own.
    """

    first: int
    length: int
    ends: bool
    relays: dict[int, Part]


class _RelayAhead:
    """A relay and the block that it has run ahead, samples `first` to `end`."""

    def __init__(self, relay: Relay) -> None:
        self.relay = relay
        self.first = self.end = 0
        self._before: Any = None
        self._block: RelayBlock | None = None

    def make(self, samples: Any) -> None:
        """The next block, over samples of the plant from `end` on."""
        self._before = self.relay.save()
        self.first = self.end
        self._run(samples)

    def _run(self, samples: Any) -> None:
        done = self.relay.advance(samples)
        self.end = self.first + done
        self._block = RelayBlock.of(self.relay, samples[:done])

    def part(self, start: int, stop: int) -> Part:
        """Of samples `start` to `stop`."""
        assert self._block is not None
        events = [event for event in self.relay.events if start <= event.sample_count < stop]
        block = self._block.piece(start - self.first, stop - self.first)
        return Part(block, events, stop == self.end)

    def go_back(self, sample: int) -> None:
        """To where it was before that sample."""
        if sample < self.end and self._block is not None:
            self.relay.restore(self._before)
            if sample > self.first:
                self._run(self._block.samples[: sample - self.first])
            self.end = sample

    def skip_to(self, sample: int) -> None:
        """It was away until that sample."""
        self.first = self.end = sample
        self._block = None


class Ahead:
    """Advances plant and relays together.

    Parameters
    ----------
    plant, relays : no longer to be advanced by anybody else.
    """

    def __init__(self, plant: Plant, relays: Sequence[Relay]) -> None:
        self.plant = plant
        self._relays = [_RelayAhead(relay) for relay in relays]
        self._running = tuple(range(len(relays)))
        self._first = self._end = 0  # of the plant's block
        self._before: Any = None
        self.sample_count = 0
        """Number of the next sample that `take` gives."""

    @property
    def left(self) -> int:
        """How many samples are made and not taken."""
        return min([self._end, *(self._relays[i].end for i in self._running)]) - self.sample_count

    def make(self, count: int) -> None:
        """Run ahead where somebody has nothing left; the plant by up to `count` samples."""
        plant, now = self.plant, self.sample_count
        if self._end == now:
            self._before, self._first = plant.save(), now
            self._end = now + plant.advance(count)
        for i in self._running:
            if self._relays[i].end == now:
                self._relays[i].make(plant.samples[now - self._first : self._end - self._first, i])

    def take(self, count: int) -> Piece:
        """The next samples, up to `count` of those that are `left`."""
        start = self.sample_count
        self.sample_count = stop = start + min(count, self.left)
        relays = {i: self._relays[i].part(start, stop) for i in self._running}
        return Piece(start, stop - start, stop == self._end, relays)

    def settle_relay(self, number: int) -> None:
        """Before an input of a relay changes: it is where the last `take` has ended, and not beyond."""
        self._relays[number].go_back(self.sample_count)

    def settle(self) -> None:
        """Before a breaker is commanded: so are plant and relays."""
        now = self.sample_count
        for i in self._running:
            self._relays[i].go_back(now)
        if now < self._end:
            self.plant.restore(self._before)
            if now > self._first:
                self.plant.advance(now - self._first)
            self._end = now

    def run_only(self, running: Sequence[int]) -> None:
        """From here on these relays run; the others' samples are nobody's."""
        self.settle()
        for i in set(running) - set(self._running):
            self._relays[i].skip_to(self.sample_count)
        self._running = tuple(running)
