"""Plant and relays, run ahead of the bus.

They are advanced in long blocks, on the assumption that nothing will come from the bus meanwhile; a block
ends with the first sample at which a relay's output, a pole or a fault changed. The bus then follows; where a
relay's input changes or a breaker is commanded, what was run beyond that instant is forgotten, and run again
with it: the same, bit for bit, as sample by sample, and a repetition that everybody has heard costs nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from faultloop.nodes.block import RelayBlock
from faultloop.plant import Plant
from faultloop.relay import Event, Relay


class Piece(NamedTuple):
    """What `Ahead.take` gives: `length` samples from number `first` on, of the relays that run, by number.

    It `ends` where the block does: then the block's changes are its own.
    """

    first: int
    length: int
    ends: bool
    relays: dict[int, tuple[RelayBlock, list[Event]]]


class Ahead:
    """Advances plant and relays together.

    Parameters
    ----------
    plant, relays : no longer to be advanced by anybody else.
    """

    def __init__(self, plant: Plant, relays: Sequence[Relay]) -> None:
        self.plant = plant
        self.relays = relays
        self._running: tuple[int, ...] = tuple(range(len(relays)))
        self._first = 0
        self._made = self._taken = 0
        self._before: tuple[Any, list[Any]] | None = None
        self._blocks: dict[int, tuple[RelayBlock, list[Event]]] = {}

    @property
    def sample_count(self) -> int:
        """Number of the next sample that `take` gives."""
        return self._first + self._taken

    @property
    def left(self) -> int:
        """How many samples are made and not taken."""
        return self._made - self._taken

    def take(self, count: int) -> Piece:
        """The next samples, up to `count` of those that are `left`."""
        start = self._taken
        self._taken = stop = min(start + count, self._made)
        first, last = self._first + start, self._first + stop
        relays = {
            i: (block.piece(start, stop), [e for e in events if first <= e.sample_count < last])
            for i, (block, events) in self._blocks.items()
        }
        return Piece(first, stop - start, stop == self._made, relays)

    def make(self, count: int) -> None:
        """Run ahead up to `count` samples, where none is `left`."""
        plant, relays = self.plant, [(i, self.relays[i]) for i in self._running]
        self._first, self._taken = self._first + self._made, 0
        self._before = plant.save(), [relay.save() for _, relay in relays]
        produced = done = plant.advance(count)
        reached = []
        for i, relay in relays:
            done = relay.advance(plant.samples[:done, i])
            reached.append(done)
        # Whoever ran past the first change goes back and stops with it.
        for (i, relay), before, m in zip(relays, self._before[1], reached, strict=True):
            if m > done:
                relay.restore(before)
                relay.advance(plant.samples[:done, i])
        if produced > done:
            plant.restore(self._before[0])
            plant.advance(done)
        self._made = done
        self._blocks = {
            i: (RelayBlock.of(relay, plant.samples[:done, i]), relay.events) for i, relay in relays
        }

    def settle(self) -> None:
        """Before an input changes: plant and relays are where the last `take` has ended, and not beyond."""
        if self._taken < self._made and self._before is not None:
            self.plant.restore(self._before[0])
            for i, before in zip(self._running, self._before[1], strict=True):
                self.relays[i].restore(before)
            if self._taken:
                self.plant.advance(self._taken)
                for i in self._running:
                    self.relays[i].advance(self.plant.samples[: self._taken, i])
        self._made = self._taken

    def run_only(self, running: Sequence[int]) -> None:
        """From here on these relays run; the others' samples are nobody's."""
        self.settle()
        self._running = tuple(running)
