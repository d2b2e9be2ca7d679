"""Lines for a person: which bits changed, and what the functions tell."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from faultloop.relay import layout
from faultloop.relay.events import Event, Names
from faultloop.relay.layout import Instance

if TYPE_CHECKING:
    from faultloop.relay.settings import RelaySettings

Words = NDArray[np.uint64]
"""Pickup and operate bits, (n, 2)."""


class Teller:
    """What a relay tells, each time against what it had told before.

    Parameters
    ----------
    settings, instances, bits : of the relay.
    state : its state at the beginning.
    """

    def __init__(
        self,
        settings: RelaySettings,
        instances: tuple[Instance, ...],
        bits: tuple[str, ...],
        state: NDArray[np.void],
    ) -> None:
        self._settings, self._instances, self._bits = settings, instances, bits
        self._sources = {i.bit: (i.name, getattr(i.table, "zone", 0)) for i in instances}
        self._told = [
            (place, i, _said(name))
            for i in instances
            if i.function.told
            for place, name in enumerate(i.bits, i.bit)
        ]
        self._of_told = sum(1 << place for place, _, _ in self._told)
        self._telling = [i for i in instances if i.function.tell is not None]
        self._of_trips = [n for n, i in enumerate(self._telling) if i.function.trips or i.user]
        self._last = [layout.record_of(state, i).copy() for i in self._telling]
        self._last_words = (0, 0)

    def save(self) -> Any:
        """What it has told."""
        return self._last_words, self._last.copy()

    def restore(self, told: Any) -> None:
        """Go back to what `save` gave."""
        self._last_words, last = told
        self._last = last.copy()

    def changes(self, first: int, words: Words) -> list[Event]:
        """Lines for the bits that change in rows of words, of samples from number ``first`` on."""
        events = []
        different = np.ones(len(words), np.bool_)  # the first one is looked at in any case
        different[1:] = np.any(words[1:] != words[:-1], axis=1)
        rows = np.flatnonzero(different)
        for n, now in zip(rows.tolist(), map(tuple, words[rows].tolist()), strict=True):
            events += [Event(first + n, "info", text) for text in self._texts(now)]
            self._last_words = now
        return events

    def _texts(self, now: tuple[int, int]) -> list[str]:
        """Of the functions whose start or operate changed.  (Direction and phase selection are in the bits,
        and in a start's line.)"""
        lines, before = [], self._last_words
        changed = [(before[kind] ^ now[kind]) & self._of_told for kind in range(2)]
        if not any(changed):
            return lines
        on = frozenset(name for place, name in enumerate(self._bits) if now[0] >> place & 1)
        for place, instance, said in self._told:
            for kind in range(2):
                if changed[kind] >> place & 1:
                    detail = instance.function.detail(on) if now[kind] >> place & 1 else "reset"
                    lines.append(f"{said[kind]} {detail}".strip())
        return lines

    def notices(self, sample: int, state: NDArray[np.void], *, texts: bool = True) -> list[Event]:
        """What the functions have to tell of a state, at that sample; without ``texts`` only trips."""
        names, events = Names(sample, self._settings, self._sources), []
        for n in range(len(self._telling)) if texts else self._of_trips:
            instance = self._telling[n]
            tell, now = instance.function.tell, layout.record_of(state, instance)
            assert tell is not None
            events += tell(names, self._last[n], now)
            self._last[n] = now.copy()
        return events


def _said(name: str) -> tuple[str, str]:
    """Of a bit: its start and its operation.  A name with a dot is whole: a signal is there, which is no
    start."""
    return name.replace(".", " ") if "." in name else f"{name} Str", f"{name} Op"
