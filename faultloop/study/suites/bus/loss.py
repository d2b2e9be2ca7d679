"""Trips over a bus that loses frames: none is lost, and how much later they come.

A relay node and a breaker node, the relay's frames through `SenderFaults`, all on the simulated bus.  Beside
the delays counted stands their distribution in closed form, from the intervals of repetition alone.
"""

from __future__ import annotations

import math
from random import Random
from typing import NamedTuple

import numpy as np

from faultloop.config.bus_fault import BusFault
from faultloop.io.can.bus import SimulatedBus
from faultloop.io.can.faults import SenderFaults
from faultloop.nodes import FOREVER, BreakerNode, RelayNode
from faultloop.nodes.goose import Repetition
from faultloop.nodes.refusals import unheard
from faultloop.study.diagram import Curve, Diagram
from faultloop.study.report import Check, Report, Table

MS = 1_000_000
TRIALS = {False: 10_000, True: 200}
PATIENCE_NS = 300_000 * MS
HEARTBEAT_S = 1.0
REPETITION = Repetition(heartbeat_ns=round(HEARTBEAT_S * 1e9))


class Loss(NamedTuple):
    """A share of frames lost, one by one or in bursts of so many in the mean."""

    share: float
    burst: float | None = None

    @property
    def title(self) -> str:
        return f"{100 * self.share:g} %" + (f" in bursts of {self.burst:g}" if self.burst else "")

    @property
    def chain(self) -> tuple[float, float]:
        """Probability to be lost after one that was not, and after one that was."""
        if self.burst is None:
            return self.share, self.share
        return self.share / (self.burst * (1 - self.share)), 1 - 1 / self.burst


CASES = (Loss(0.1), Loss(0.3), Loss(0.5), Loss(0.1, 3), Loss(0.3, 3), Loss(0.5, 5))


def report(quick: bool) -> Report:
    """10,000 trips for each loss; quick: 200."""
    trials = TRIALS[quick]
    base_ms = delay_ns(0, None) / MS
    report = Report("loss", f"Trips over a lossy bus, {trials} for each case")
    report.text = [
        "A trip between 0.5 and 2.5 s after the nodes' start, 500 kbit/s, repeated after 2, 4, 8, ... ms, at "
        f"most every {HEARTBEAT_S:g} s. Undisturbed the breaker has it {base_ms:.3f} ms after the relay's "
        "decision; the delays below are added to that. Bursts: Gilbert's chain, a step for each trip frame. "
        f"The relay holds its trip; lost is one that is not received within {PATIENCE_NS // 10**9} s.",
    ]
    rows, counted = [], []
    for loss in CASES:
        sent, lost, got = trips(loss, trials)
        added = np.sort(got)
        share, expected = distribution(loss)
        gap = largest_gap(sent, share)
        limit = math.sqrt(math.log(2 / 1e-3) / (2 * trials))
        rows.append((loss.title, lost, *(quantile(added, q) for q in QUANTILES), float(added.max()),
                     *(steps(share, expected, q) for q in QUANTILES), gap))  # fmt: skip
        report.checks.append(Check(f"{loss.title}: trips lost", float(lost), 0.0))
        what = f"{loss.title}: distance of the distributions (Kolmogorov)"
        report.checks.append(Check(what, gap, limit))
        counted.append((loss, sent))
    names = [f"{100 * q:g} %" for q in QUANTILES]
    columns = ("loss", ">lost", *(f">{n}" for n in names), ">longest", *(f">{n} expected" for n in names),
               ">distance")  # fmt: skip
    note = (
        "Added delay [ms] that so many of the trips do not exceed, counted and in closed form. Distance: "
        "largest difference of the two distributions; the limit is what chance exceeds once in a thousand "
        "(Dvoretzky, Kiefer, Wolfowitz 1956; Massart 1990)."
    )
    report.tables = [Table("Added delay [ms]", columns, rows, note)]
    report.diagrams = [diagram(counted)]
    return report


QUANTILES = (0.5, 0.9, 0.99, 0.999)


def trips(loss: Loss, trials: int) -> tuple[np.ndarray, int, np.ndarray]:
    """Which repetition each trip was received with, how many never were, and the added delays [ms]."""
    fault = BusFault(
        name="loss", kind="loss", message="trip", probability=loss.share, burst_length=loss.burst
    )
    base = delay_ns(0, None)
    delays = [delay_ns(trial, fault) for trial in range(trials)]
    added = np.array([(d - base) / MS for d in delays if d >= 0])
    return np.searchsorted(OFFSETS_MS, added + 0.5, side="right") - 1, trials - len(added), added


def delay_ns(seed: int, fault: BusFault | None) -> int:
    """From a relay's decision to the breaker's command [ns]; -1 where it does not come."""
    trip_ns = Random(f"trip {seed}").randrange(500 * MS, 2500 * MS)
    relay = RelayNode(0, 0, (), HEARTBEAT_S, 0.0)
    breaker = BreakerNode(0, [0], 7, HEARTBEAT_S, unheard)
    stage = SenderFaults(seed, [fault] if fault else [], "R")
    bus = SimulatedBus()
    tripped = False
    while True:
        arrival = bus.next_event_ns()
        now = min(relay.next_ns, breaker.next_ns, FOREVER if arrival is None else arrival)
        if not tripped and now >= trip_ns:
            now, tripped = trip_ns, True
            relay.set(now, 7, 0, 0)
        if now > trip_ns + PATIENCE_NS:
            return -1
        for t_ns, frame, sender in bus.advance(now):
            if sender == "B":
                relay.receive(t_ns, frame)
            elif (command := breaker.receive(t_ns, frame)) is not None:
                return command.t_ns - trip_ns
        for frame in relay.poll(now):
            for at_ns, what in stage.send(now, frame):
                bus.submit(at_ns, what, "R")
        for frame in breaker.poll(now):
            bus.submit(now, frame, "B")


def _offsets_ms(count: int) -> np.ndarray:
    intervals = [REPETITION.interval_ns(k) / MS for k in range(count - 1)]
    return np.concatenate(([0.0], np.cumsum(intervals)))


FRAMES = 320
SELDOM, SOON_MS = 1e-5, 1.0
"""Shares below are not drawn; no delay at all is drawn at this one, as the axis is logarithmic."""
OFFSETS_MS = _offsets_ms(FRAMES)
"""When the frames of a state are sent, after its first."""


def distribution(loss: Loss) -> tuple[np.ndarray, np.ndarray]:
    """Probability that a trip is received with its k-th frame, and that frame's delay [ms].

    A breaker that has heard the relay before acts on the first trip frame that it gets; one that has not, on
    the second.  A trip is due at a time uniform over 0.5 to 2.5 s, so of the frames before it 9 to 11 are
    gone: the chain is followed through both, from its stationary state.
    """
    before = np.searchsorted(OFFSETS_MS, np.linspace(500, 2500, 2001)[:-1], side="right")
    counts, weights = np.unique(before, return_counts=True)
    share = np.zeros(FRAMES)
    for count, weight in zip(counts.tolist(), weights / weights.sum(), strict=True):
        share += weight * _received_with(loss, count)
    return share, OFFSETS_MS


def _received_with(loss: Loss, before: int) -> np.ndarray:
    """With `before` frames ahead of the trip's: a chain over the next frame's fate and the frames needed."""
    after_good, after_bad = loss.chain
    state = {(True, 2): loss.share, (False, 2): 1 - loss.share}  # next frame's fate, and what is needed
    share = np.zeros(FRAMES)
    for k in range(-before, FRAMES):
        following: dict[tuple[bool, int], float] = {}
        for (bad, needed), p in state.items():
            left = needed if bad else (1 if k < 0 else needed - 1)
            if left == 0:
                share[k] += p
                continue
            again = after_bad if bad else after_good
            for next_bad, q in ((True, again), (False, 1 - again)):
                following[next_bad, left] = following.get((next_bad, left), 0.0) + p * q
        state = following
    return share


def largest_gap(sent: np.ndarray, share: np.ndarray) -> float:
    """Kolmogorov's distance of what was counted from what is expected."""
    counted = np.bincount(sent, minlength=FRAMES)[:FRAMES] / len(sent)
    return float(np.abs(np.cumsum(counted) - np.cumsum(share)).max())


def quantile(added: np.ndarray, q: float) -> float:
    """The smallest delay that a share q of all do not exceed."""
    return float(added[math.ceil(q * len(added)) - 1])


def steps(share: np.ndarray, delays: np.ndarray, q: float) -> float:
    """The same of the closed form."""
    return float(delays[np.searchsorted(np.cumsum(share), q - 1e-12)])


def diagram(counted: list[tuple[Loss, np.ndarray]]) -> Diagram:
    """The share of trips that are not there after so long, counted and in closed form."""
    curves = []
    for colour, (loss, sent) in enumerate(counted):
        share, delays = distribution(loss)
        counts = np.bincount(sent, minlength=FRAMES)[:FRAMES] / len(sent)
        for name, shares, dash in ((loss.title, counts, "solid"), ("in closed form", share, "dot")):
            later = 1 - np.cumsum(shares)
            later[later < SELDOM] = np.nan
            own = {"in_legend": dash == "solid", "group": loss.title}
            curves.append(Curve(name, np.maximum(delays, SOON_MS), later, "steps", colour, dash, **own))
    return Diagram(
        "Trips that come later; dotted: in closed form",
        "added delay [ms]",
        "share of the trips",
        curves,
        log_x=True,
        log_y=True,
        wide=True,
    )
