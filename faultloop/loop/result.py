"""What a run ends with."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from faultloop.config.expect import Expect
from faultloop.io import notebook
from faultloop.io.messages import bit_names
from faultloop.loop.outcome import EventText, FaultChange, Outcome, TripReport
from faultloop.loop.pacing import Pacing
from faultloop.loop.recording import MemorySink
from faultloop.loop.scenario import Scenario

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from faultloop.io.rerun_sink import RerunSink


@dataclass(frozen=True)
class Verdict:
    """An `[[expect]]` of the scenario, and whether it held."""

    expect: Expect
    held: bool
    why: str
    """What happened, in words."""


@dataclass
class Result:
    """What happened in a run.

    Attributes
    ----------
    scenario : what was run, with its overrides.
    trips, faults, events : in order of time.
    expectations : one verdict for each `[[expect]]`.
    log : path of the MCAP log, None if none was written.
    simulated_s, wall_s : how much time was simulated, and how long it took, without compilation and warm-up.
    can_frames : how many were on the bus.
    bus_load : part of the time in which the bus was busy, 0 to 1; None on a real bus.
    fault_locations : by relay, per unit of the line, NaN where none was found.
    memory : what a log would have, kept where none was written.
    rerun : the stream to rerun, if there is one; `serve` goes on until its `wait` ends.
    interrupted : ended by Ctrl-C before its time; the log is whole.
    pacing : how well time was kept, None in a run that was not paced.
    died : of a run as processes, the nodes that ended before it did.
    warnings : what the relays are set to do that nobody may have meant: file, key, what would be right.
    """

    scenario: Scenario
    trips: list[TripReport]
    faults: list[FaultChange]
    events: list[EventText]
    expectations: list[Verdict]
    log: Path | None
    simulated_s: float
    wall_s: float
    can_frames: int
    bus_load: float | None
    fault_locations: dict[str, float]
    interrupted: bool = False
    pacing: Pacing | None = None
    died: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    memory: MemorySink | None = field(default=None, repr=False)
    rerun: RerunSink | None = field(default=None, repr=False)

    @classmethod
    def of(cls, scenario: Scenario, outcome: Outcome, **rest: Any) -> Result:
        """What the messages came to, judged by the scenario; `rest` is what they do not say."""
        return cls(
            scenario=scenario,
            trips=outcome.trips,
            faults=outcome.faults,
            events=outcome.events,
            expectations=[judge(e, outcome.trips, outcome.fault_start_ns) for e in scenario.expect],
            can_frames=sum(outcome.can_frames.values()),
            **rest,
        )

    @property
    def held(self) -> bool:
        """All expectations held."""
        return all(verdict.held for verdict in self.expectations)

    @property
    def fault_start_ns(self) -> int | None:
        """When the first fault was applied."""
        return next((change.t_ns for change in self.faults if change.on), None)

    def samples(self, relay: str | None = None) -> np.ndarray:
        """Sampled values (n,) of a relay, the first by default: va .. vc [V], ia .. ic [A]."""
        return self._array("samples", relay)

    def phasors(self, relay: str | None = None) -> np.ndarray:
        """Phasors (n,): t_ns, va_re ... ic_im [V, A RMS], frequency_hz, rocof_hz_per_s."""
        return self._array("phasors", relay)

    def loops(self, relay: str | None = None) -> np.ndarray:
        """Loop impedances (n,): t_ns, ag_r ... ca_x [ohm, primary]."""
        return self._array("loops", relay)

    def elements(self, relay: str | None = None) -> np.ndarray:
        """Element bit sets (n,): t_ns, pickup, operate."""
        return self._array("elements", relay)

    def __repr__(self) -> str:
        name = self.scenario.scenario.name
        told = ", ".join(f"{t.relay} {_told(t, self.fault_start_ns)}" for t in self.trips) or "no trip"
        kept = "in memory" if self.log is None else str(self.log)
        return f"<Result {name}: {self.simulated_s:g} s, {told}; {kept}>"

    def _repr_html_(self) -> str:
        """Trips, expectations and events, for a notebook."""
        start = self.fault_start_ns
        trips = [
            (t.relay, t.function, t.zone, t.loop, t.pole_names, _ms(delay_ms(t, start))) for t in self.trips
        ]
        shown = notebook.table(
            repr(self).strip("<>"), ("relay", "function", "zone", "loop", "poles", "trip ms"), trips
        )
        held = [(v.expect.relay, "held" if v.held else "NOT HELD", v.why) for v in self.expectations]
        shown += notebook.table("Expectations", ("relay", "", "what happened"), held)
        events = [(f"{(e.t_ns - (start or 0)) / 1e6:.2f}", e.source, e.text) for e in self.events]
        return shown + notebook.table("Events", ("ms", "from", "what"), events)

    def plot(self, relay: str | None = None) -> Figure:
        """Voltages and currents of a relay, or of all side by side, with fault and trips: a Figure."""
        names = [place.name for place in self.scenario.relay] if relay is None else [relay]
        marks = [(change.t_ns, "fault") for change in self.faults if change.on]
        marks += [(trip.t_ns, f"{trip.relay} {trip.function}") for trip in self.trips if trip.relay in names]
        return notebook.figure({name: self.samples(name) for name in names}, marks)

    def to_pandas(self, relay: str | None = None) -> Any:
        """A DataFrame of a relay, the first by default, a row a sample (`faultloop.io.notebook.frame`).

        Raises InputError without pandas.
        """
        if self.memory is None and self.log is not None:
            from faultloop.io.mcap_reader import open_log

            return open_log(self.log).to_pandas(relay)
        kinds = ("samples", "phasors", "loops", "elements")
        name = relay if relay is not None else self.scenario.relay[0].name
        bits = {} if self.memory is None else bit_names(self.memory.bits[name])
        return notebook.frame({what: self._array(what, relay) for what in kinds}, bits)

    def _array(self, what: str, relay: str | None) -> np.ndarray:
        names = [place.name for place in self.scenario.relay]
        name = names[0] if relay is None and names else relay
        if name not in names or name is None:
            raise KeyError(f"no relay {name!r}; relays: {', '.join(names) or 'none'}")
        if self.memory is not None:
            return self.memory.array(name, what)
        if self.log is None:
            raise ValueError("nothing was kept: run with log=PATH or keep=True")
        from faultloop.io.mcap_reader import open_log

        return getattr(open_log(self.log), what)(name)


def judge(expect: Expect, trips: list[TripReport], fault_ns: int | None) -> Verdict:
    """Whether an expectation held.  A trip's time is when the breaker received it, from the fault's start."""
    own = [trip for trip in trips if trip.relay == expect.relay]
    if not expect.trip:
        if not own:
            return Verdict(expect, True, "no trip")
        return Verdict(expect, False, f"tripped: {_told(own[0], fault_ns)}")
    if not own:
        return Verdict(expect, False, "no trip")
    objections = []
    for trip in own:
        objection = _objection(expect, trip, fault_ns)
        if objection is None:
            return Verdict(expect, True, _told(trip, fault_ns))
        objections.append(f"{objection} ({_told(trip, fault_ns)})")
    return Verdict(expect, False, "; ".join(objections))


def _objection(expect: Expect, trip: TripReport, fault_ns: int | None) -> str | None:
    for key in ("function", "zone", "loop"):
        wanted, got = getattr(expect, key), getattr(trip, key)
        if wanted is not None and wanted != got:
            return f"{key} {got or 'none'}, not {wanted}"
    if expect.poles is not None and expect.poles != trip.pole_names:
        return f"poles {trip.pole_names}, not {expect.poles}"
    after = delay_ms(trip, fault_ns)
    if after is None:
        timed = expect.within_ms is not None or expect.after_ms is not None
        return "its breaker did not receive it" if timed else None
    if expect.within_ms is not None and after < 0:
        return f"{-after:.1f} ms before the fault"
    if expect.within_ms is not None and after > expect.within_ms:
        return f"after {after:.1f} ms, not within {expect.within_ms:g} ms"
    if expect.after_ms is not None and after < expect.after_ms:
        return f"after {after:.1f} ms, before {expect.after_ms:g} ms"
    return None


def delay_ms(trip: TripReport, fault_ns: int | None) -> float | None:
    """From the fault's start (the run's, if there is none) to the breaker's receiving the trip."""
    return None if trip.received_ns is None else (trip.received_ns - (fault_ns or 0)) / 1e6


def _ms(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def _told(trip: TripReport, fault_ns: int | None) -> str:
    after = delay_ms(trip, fault_ns)
    when = "not received by a breaker" if after is None else f"{after:.1f} ms"
    return f"{trip.function} {trip.loop} poles {trip.pole_names} {when}"
