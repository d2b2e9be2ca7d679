"""What befalls frames between their sender and the bus: loss, corruption, delay, duplication, reordering.

A pure stage, the same for the simulated and for a real bus.  Each fault has random streams of its own for
each sender, so that a sender's frames meet the same fate whatever else is on the bus.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from random import Random
from typing import Protocol

from faultloop.io.can.frames import Frame
from faultloop.io.can.table import BY_IDENTIFIER

MS = 1_000_000

Timed = tuple[int, Frame]
"""When a frame comes to the bus [ns], and the frame."""


class Fault(Protocol):
    """What is read of a scenario's ``[[bus_fault]]``."""

    @property
    def name(self) -> str: ...
    @property
    def kind(self) -> str: ...
    @property
    def node(self) -> str | None: ...
    @property
    def message(self) -> str | None: ...
    @property
    def start_ns(self) -> int: ...
    @property
    def end_ns(self) -> int | None: ...
    @property
    def probability(self) -> float | None: ...
    @property
    def pattern(self) -> str | None: ...
    @property
    def burst_length(self) -> float | None: ...
    @property
    def bits(self) -> int: ...
    @property
    def delay_ms(self) -> float: ...
    @property
    def jitter_ms(self) -> float: ...
    @property
    def copies(self) -> int: ...


class SenderFaults:
    """The faults that one sender's frames meet, in the order of the scenario.

    Parameters
    ----------
    seed : of the run.
    faults : all of the run's; those of other senders are passed over.
    sender : name of the node.
    """

    def __init__(self, seed: int, faults: Iterable[Fault], sender: str) -> None:
        numbered = [(i, fault) for i, fault in enumerate(faults) if fault.node in (None, sender)]
        self._stages = [
            _STAGES[fault.kind](fault, Hits(fault, f"{seed}/{i}/{sender}"))
            for i, fault in numbered
            if fault.kind in _STAGES
        ]
        self._off = [fault for _, fault in numbered if fault.kind in ("bus_off", "restart")]

    def send(self, t_ns: int, frame: Frame) -> list[Timed]:
        """What comes to the bus of a frame sent at `t_ns`, and when: nothing, it, or several.

        Frames held back by an earlier call come along.  None is earlier than `t_ns`.
        """
        frames = [(t_ns, frame)]
        for stage in self._stages:
            frames = [out for t, f in frames for out in stage.send(t, f)]
        return frames

    def silent(self, t_ns: int) -> bool:
        """The sender is off the bus: it neither sends nor receives."""
        return any(active(fault, t_ns) for fault in self._off)

    @property
    def hits(self) -> Counter[str]:
        """How many frames each fault has hit so far, by its name."""
        return Counter({stage.fault.name: stage.count for stage in self._stages})


class WireErrors:
    """Errors on the wire (``kind = "bit_error"``): the bus model's `ErrorSource`.

    A transmission that is hit is hit at one bit, of which none is likelier than another; where two faults hit
    the same one, the first bit counts.
    """

    def __init__(self, seed: int, faults: Iterable[Fault]) -> None:
        self._seed = seed
        self._faults = [(i, fault) for i, fault in enumerate(faults) if fault.kind == "bit_error"]
        self._hits: dict[tuple[int, object], Hits] = {}
        self.hits: Counter[str] = Counter()

    def hit(self, t_ns: int, frame: Frame, sender: object, bits: int) -> int | None:
        """Place of the bit that is disturbed, or None; asked once for each transmission."""
        places = []
        for i, fault in self._faults:
            if fault.node not in (None, sender):
                continue
            hits = self._hits.setdefault((i, sender), Hits(fault, f"{self._seed}/{i}/{sender}"))
            if hits.hit(t_ns, frame):
                self.hits[fault.name] += 1
                places.append(hits.content.randrange(bits))
        return min(places, default=None)


def active(fault: Fault, t_ns: int) -> bool:
    """From its start on, until it is over; a restart without a duration is over at once."""
    end_ns = fault.end_ns
    if end_ns is None:
        end_ns = fault.start_ns if fault.kind == "restart" else math.inf
    return fault.start_ns <= t_ns < end_ns


class Hits:
    """Which frames a fault hits: by a pattern, independently, in bursts, or each.

    In bursts: the chain of Gilbert (1960), "Capacity of a burst-noise channel", Bell Syst. Tech. J. 39, whose
    bad state hits every frame.  It leaves the bad state with 1 / L for bursts of L frames in the mean, and
    enters it with p / (L (1 - p)) for a share p of frames hit; it begins in its stationary distribution.
    """

    def __init__(self, fault: Fault, stream: str) -> None:
        self.content = Random(f"{stream}/content")
        """For what is done to a frame that is hit."""
        self._fault = fault
        self._chance = Random(stream)
        self._frames = 0
        p, burst = fault.probability, fault.burst_length
        self._probability = 1.0 if p is None else p
        self._leave = None if burst is None else 1 / burst
        self._enter = 0.0 if burst is None or p is None else p / (burst * (1 - p))
        self._bad = self._leave is not None and self._chance.random() < self._probability

    def hit(self, t_ns: int, frame: Frame) -> bool:
        """Does the fault hit this one?  To be asked once for each frame."""
        fault = self._fault
        if not active(fault, t_ns) or fault.message not in (None, message_name(frame)):
            return False
        self._frames += 1
        if fault.pattern is not None:
            return fault.pattern[(self._frames - 1) % len(fault.pattern)] == "1"
        draw = self._chance.random()
        if self._leave is None:
            return draw < self._probability
        was_bad = self._bad
        self._bad = draw >= self._leave if was_bad else draw < self._enter
        return was_bad


def message_name(frame: Frame) -> str | None:
    """``trip``, ``heartbeat``, ...; None where it is none of ours."""
    found = BY_IDENTIFIER.get(frame.id)
    return None if found is None or frame.extended else found[0].name.lower()


class _Stage:
    """A fault on its way to the frames: `send` asks whether it hits, `_strike` does it."""

    def __init__(self, fault: Fault, hits: Hits) -> None:
        self.fault = fault
        self.count = 0
        self._hits = hits
        self._random = hits.content

    def send(self, t_ns: int, frame: Frame) -> Sequence[Timed]:
        if not self._hits.hit(t_ns, frame):
            return ((t_ns, frame),)
        self.count += 1
        return self._strike(t_ns, frame)

    def _strike(self, t_ns: int, frame: Frame) -> Sequence[Timed]:
        raise NotImplementedError


class _Loss(_Stage):
    def _strike(self, t_ns: int, frame: Frame) -> Sequence[Timed]:
        return ()


class _Corruption(_Stage):
    """Bits of the payload turn over before the controller adds its CRC: only E2E protection can see it."""

    def _strike(self, t_ns: int, frame: Frame) -> Sequence[Timed]:
        size = 8 * len(frame.data)
        value = int.from_bytes(frame.data, "big")
        for bit in self._random.sample(range(size), min(self.fault.bits, size)):
            value ^= 1 << bit
        return ((t_ns, frame._replace(data=value.to_bytes(len(frame.data), "big"))),)


class _Delay(_Stage):
    def _strike(self, t_ns: int, frame: Frame) -> Sequence[Timed]:
        late_ns = self.fault.delay_ms * MS + self._random.random() * self.fault.jitter_ms * MS
        return ((t_ns + round(late_ns), frame),)


class _Duplication(_Stage):
    def _strike(self, t_ns: int, frame: Frame) -> Sequence[Timed]:
        return ((t_ns, frame),) * (1 + self.fault.copies)


class _Reordering(_Stage):
    """A frame that is hit goes right after the sender's next one."""

    _held: Frame | None = None

    def send(self, t_ns: int, frame: Frame) -> Sequence[Timed]:
        hit = self._hits.hit(t_ns, frame)
        if self._held is not None:
            held, self._held = self._held, None
            return ((t_ns, frame), (t_ns, held))
        if hit:
            self.count += 1
            self._held = frame
            return ()
        return ((t_ns, frame),)


_STAGES: dict[str, Callable[[Fault, Hits], _Stage]] = {
    "loss": _Loss,
    "corruption": _Corruption,
    "delay": _Delay,
    "duplication": _Duplication,
    "reordering": _Reordering,
}
