"""The channel between two relays: what a frame meets between its own station's bus and the relay far away.

A frame that the receiving relay's node would take at once from the bus goes into a queue and is taken when it
arrives: later by a delay and a jitter, or never.  Nothing overtakes.  Kernels over records: the compiled
loop's exchange steps the same ones as the process of a relay.  Chance is a hash of seed, channel and the
frame's number, so that it does not depend on who asks, nor when.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from faultloop.config.channel import Channel
from faultloop.io.can.frames import Frame
from faultloop.io.can.port import DIFFERENTIAL, NOBODY, PILOT, TRANSFER
from faultloop.io.can.record import FRAME, Record, Records, put, taken
from faultloop.jit import njit
from faultloop.nodes.chance import uniform
from faultloop.nodes.clock import FOREVER

PATHS = 5
ROOM = 128
"""Frames on their way, at most, in one direction."""
POLES_BYTE, POLES_SHIFT = 1, 4
"""Where a state's poles are in its frame."""

CHANNEL = np.dtype(
    [
        ("sender", "i8"),  # number of the relay
        ("seat", "i8"),  # of the node that receives
        ("from_ns", "i8", (PATHS,)),  # when each path is taken
        ("delay_ns", "i8", (PATHS,)),
        ("jitter_ns", "i8"),
        ("loss", "f8"),
        ("reset_ns", "i8"),
        ("out_ns", "i8"),
        ("back_ns", "i8"),
        ("misrouted", "i8"),  # the relay whose frames arrive instead; NOBODY
        ("misrouted_ns", "i8"),
        ("seed", "u8"),
        ("count", "u8"),  # of frames
        ("last_ns", "i8"),  # when the last one arrives
        ("first", "i8"),  # place of the first that is on its way
        ("waiting", "i8"),  # how many are
        ("poles", "i8"),  # that the last pilot frame said
        ("lost", "i8"),
    ],
    align=True,
)
"""One direction."""

TRAVELLER = np.dtype([("due_ns", "i8"), ("objection", "i8"), ("recalled", "i8")])
"""What is known of a frame on its way."""


class Channels(NamedTuple):
    """Those of some nodes."""

    channel: Records
    """(n,) CHANNEL"""
    queue: Records
    """(n, ROOM) TRAVELLER"""
    frames: Records
    """(n, ROOM) FRAME"""


@njit
def _chance(c: Record, draw: int) -> float:
    """Uniform in [0, 1) for the frame that comes."""
    return uniform(c.seed, np.uint64(2) * c.count + np.uint64(draw))


@njit
def channel_of(x: Channels, seat: int, identifier: int, t_ns: int) -> int:
    """The channel by which a node hears frames of that identifier now; NOBODY: it hears them from the bus."""
    kind = identifier & ~0xF
    if kind not in (PILOT, TRANSFER, DIFFERENTIAL):
        return int(np.int64(NOBODY))
    for k in range(x.channel.shape[0]):
        c = x.channel[k]
        if c.seat == seat:
            swapped = c.misrouted != NOBODY and t_ns >= c.misrouted_ns
            if (c.misrouted if swapped else c.sender) == (identifier & 0xF):
                return k
    return int(np.int64(NOBODY))


@njit
def cut_off(x: Channels, seat: int, identifier: int) -> bool:
    """Whether frames of that identifier reach a node by a channel only, and so not from the bus."""
    for k in range(x.channel.shape[0]):
        if x.channel[k].seat == seat and x.channel[k].sender == (identifier & 0xF):
            kind = identifier & ~0xF
            return kind in (PILOT, TRANSFER, DIFFERENTIAL)
    return False


@njit
def enter(x: Channels, k: int, frame: Record, objection: int, t_ns: int) -> None:
    """A frame is at the channel's beginning at ``t_ns``."""
    c = x.channel[k]
    path = 0
    while path + 1 < PATHS and t_ns >= c.from_ns[path + 1]:
        path += 1
    late = _chance(c, 0)
    lost = _chance(c, 1) < c.loss or (c.out_ns <= t_ns < c.back_ns) or c.waiting == ROOM
    c.count += np.uint64(1)
    if lost:
        c.lost += 1
        return
    due_ns = t_ns + c.delay_ns[path] + np.int64(late * c.jitter_ns)
    if (frame.id & ~0xF) == PILOT:
        poles = np.int64(frame.data[POLES_BYTE]) >> POLES_SHIFT & 7
        if c.poles & ~poles:
            due_ns += c.reset_ns
        elif c.reset_ns:
            _recall(x, k, poles)
        c.poles = poles
    due_ns = max(due_ns, c.last_ns)
    c.last_ns = due_ns
    place = (c.first + c.waiting) % ROOM
    traveller = x.queue[k, place]
    traveller.due_ns = due_ns
    traveller.objection = objection
    traveller.recalled = 0
    x.frames[k, place] = frame
    # A swapped cable takes another's frames to where this one's are expected.
    x.frames[k, place].id = (frame.id & ~0xF) + c.sender
    c.waiting += 1


@njit
def _recall(x: Channels, k: int, poles: int) -> None:
    """A signal that is there again before its end has arrived has never ended."""
    c = x.channel[k]
    last_ns = np.int64(0)
    for n in range(c.waiting):
        place = (c.first + n) % ROOM
        traveller, frame = x.queue[k, place], x.frames[k, place]
        pilot = (frame.id & ~0xF) == PILOT
        if pilot and poles & ~(np.int64(frame.data[POLES_BYTE]) >> POLES_SHIFT & 7):
            traveller.recalled = 1
        elif not traveller.recalled:
            last_ns = max(last_ns, traveller.due_ns)
    c.last_ns = last_ns


@njit
def arrival_ns(x: Channels) -> int:
    """When the next frame arrives."""
    t_ns = np.int64(FOREVER)
    for k in range(x.channel.shape[0]):
        c = x.channel[k]
        if c.waiting:
            t_ns = min(t_ns, x.queue[k, c.first].due_ns)
    return int(t_ns)


@njit
def arrived(x: Channels, k: int, t_ns: int) -> int:
    """Place in its queue of the first frame that has arrived by ``t_ns``, which is then out of it; NOBODY."""
    c = x.channel[k]
    while c.waiting and x.queue[k, c.first].due_ns <= t_ns:
        place = c.first
        c.first = (c.first + 1) % ROOM
        c.waiting -= 1
        if not x.queue[k, place].recalled:
            return place
    return int(np.int64(NOBODY))


def new_channels(
    tables: Sequence[Channel], relays: Sequence[str], seed: int, only: str | None = None
) -> Channels:
    """Of a scenario, both directions of each; ``only`` those to that relay, for its process, whose node has
    seat 0."""
    ways = [
        (number, table, sender, receiver, sign)
        for number, table in enumerate(tables)
        for sender, receiver, sign in (
            (table.from_relay, table.to_relay, 1),
            (table.to_relay, table.from_relay, -1),
        )
        if only in (None, receiver)
    ]
    n = len(ways)
    x = Channels(np.zeros(n, CHANNEL), np.zeros((n, ROOM), TRAVELLER), np.zeros((n, ROOM), FRAME))
    for c, (number, table, sender, receiver, sign) in zip(x.channel, ways, strict=True):
        c["sender"], c["seat"] = relays.index(sender), 0 if only else relays.index(receiver)
        c["from_ns"] = FOREVER
        for n, (from_s, delay_ms, asymmetry_ms) in enumerate(table.paths):
            c["from_ns"][n] = round(from_s * 1e9)
            c["delay_ns"][n] = round((delay_ms + sign * asymmetry_ms / 2) * 1e6)
        c["jitter_ns"], c["reset_ns"] = round(table.jitter_ms * 1e6), round(table.reset_ms * 1e6)
        c["loss"] = table.loss
        c["out_ns"] = c["back_ns"] = FOREVER
        if table.out_at_s is not None:
            c["out_ns"] = round(table.out_at_s * 1e9)
        if table.out_at_s is not None and table.out_for_s is not None:
            c["back_ns"] = round((table.out_at_s + table.out_for_s) * 1e9)
        c["misrouted"] = NOBODY
        if table.misrouted is not None and sign > 0:
            c["misrouted"] = relays.index(table.misrouted)
            c["misrouted_ns"] = round(table.misrouted_at_s * 1e9)
        c["seed"] = (seed * 1_000_003 + 2 * number + (sign < 0)) % 2**64
    return x


class Arrivals:
    """The channels to one relay, for whoever is not compiled: frames in, and later out."""

    def __init__(self, channels: Channels) -> None:
        self.channels = channels
        self._frame = np.zeros(1, FRAME)

    @property
    def next_ns(self) -> int:
        """When the next frame arrives."""
        return arrival_ns(self.channels)

    def takes(self, t_ns: int, frame: Frame) -> bool:
        """Whether the frame goes by a channel, or does not reach the relay but by one; then it is out of the
        way."""
        k = channel_of(self.channels, 0, frame.id, t_ns)
        if k == NOBODY:
            return cut_off(self.channels, 0, frame.id)
        put(self._frame, 0, frame)
        enter_first(self.channels, k, self._frame, t_ns)
        return True

    def poll(self, t_ns: int) -> list[tuple[int, Frame]]:
        """What has arrived by `t_ns`, with its time."""
        found: list[tuple[int, Frame]] = []
        for k in range(len(self.channels.channel)):
            while (place := arrived(self.channels, k, t_ns)) != NOBODY:
                due_ns = int(self.channels.queue["due_ns"][k, place])
                found.append((due_ns, Frame(*taken(self.channels.frames[k], place))))
        return sorted(found, key=lambda item: item[0])


@njit
def enter_first(x: Channels, k: int, frames: Records, t_ns: int) -> None:
    """`enter` for whoever is not compiled."""
    enter(x, k, frames[0], 0, t_ns)
