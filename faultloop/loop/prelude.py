"""What cases of one network have in common: the time before the first fault or planned switching.

A loop that is used again goes on from where it stood then, where nothing was told until then, Python had no
part in it, and nobody wants the samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from numpy.typing import NDArray

from faultloop.loop.drive import Course
from faultloop.loop.traffic import Traffic
from faultloop.plant import Plant, PlantState
from faultloop.relay import Event, Relay
from faultloop.relay.bank import Bank

EVERY = 48
"""Samples between the places at which a loop is kept: of random inceptions a case makes half of them."""
KEPT = 16


class Parts(NamedTuple):
    """Of a loop."""

    course: Course
    traffic: Traffic
    plant: Plant
    bank: Bank
    relays: Sequence[Relay]


class Stand(NamedTuple):
    """A loop before a sample, with nothing to tell.

    Attributes
    ----------
    texts : whether the lines that a person reads were wanted.
    loop : what is in the records of the clock, of the breakers and of the relays in their bank.
    relays : what each saves, and what it had to tell of its warm-up.
    """

    sample: int
    texts: bool
    loop: Sequence[NDArray[Any]]
    traffic: Sequence[NDArray[Any]]
    plant: PlantState
    relays: Sequence[tuple[Any, Sequence[Event]]]

    @classmethod
    def of(cls, parts: Parts, texts: bool, warm: Sequence[Sequence[Event]]) -> Stand:
        """A copy of everything that changes."""
        return cls(
            sample=int(parts.course.clock["sample"][0]),
            texts=texts,
            loop=[array.copy() for array in _records(parts)],
            traffic=parts.traffic.save(),
            plant=parts.plant.save(),
            relays=[(relay.save(), told) for relay, told in zip(parts.relays, warm, strict=True)],
        )

    def put_back(self, parts: Parts) -> None:
        """The loop stands there, but for its traffic (`Traffic.begin_again`)."""
        for array, kept in zip(_records(parts), self.loop, strict=True):
            array[:] = kept
        parts.plant.go_on_from(self.plant)
        for relay, (state, told) in zip(parts.relays, self.relays, strict=True):
            relay.restore(state)
            relay.events = list(told)


def _records(parts: Parts) -> tuple[NDArray[Any], ...]:
    return parts.course.clock, parts.course.breaker, parts.bank.relay


class Prelude:
    """Where a loop stood with its plant, at several samples."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._stands: list[Stand] = []

    def begin(self, plant: Plant, total: int, texts: bool) -> tuple[Stand | None, int]:
        """Where a run of so many samples can begin (None: before sample 0), and the sample before which it is
        to be kept (0: nowhere; a plant that comes for the first time may come for the last one)."""
        if plant is not self._plant:
            self._plant, self._stands = plant, []
            return None, 0
        place = min(plant.samples_before_actions, total) // EVERY * EVERY
        found = [stand for stand in self._stands if stand.texts == texts and stand.sample <= place]
        best = max(found, key=lambda stand: stand.sample, default=None)
        return best, 0 if best is not None and best.sample == place else place

    def keep(self, stand: Stand) -> None:
        """For the runs to come."""
        self._stands = [stand, *self._stands[: KEPT - 1]]
