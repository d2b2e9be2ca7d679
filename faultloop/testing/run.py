"""A scenario that runs beside a test, and what the test may ask of it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from faultloop.config.expect import Expect
from faultloop.config.tables import validate
from faultloop.errors import InputError, nearest
from faultloop.io.can.authentication import read
from faultloop.io.can.frames import Frame, Message, Rejection, State
from faultloop.io.can.table import BY_IDENTIFIER, Kind
from faultloop.io.mcap_reader import open_log
from faultloop.loop.outcome import TripReport, pole_names
from faultloop.loop.result import Result, Verdict, judge
from faultloop.loop.scenario import Scenario

Progress = Callable[[float], None]
Start = Callable[[Progress], Result]


@dataclass(frozen=True)
class SeenTrip:
    """A trip; times from the fault's start (the run's, where there is no fault) [ms]."""

    relay: str
    function: str
    zone: int
    loop: str
    poles: str
    breaker: str | None
    decided_ms: float
    received_ms: float | None
    """When the breaker received it."""
    opened_ms: float | None
    """When the last of its poles was open."""

    def __str__(self) -> str:
        what = f"{self.relay} {self.function} zone {self.zone} loop {self.loop} poles {self.poles}"
        received = "not received" if self.received_ms is None else f"received {self.received_ms:.2f}"
        opened = "not opened" if self.opened_ms is None else f"opened {self.opened_ms:.2f}"
        return f"{what}: decided {self.decided_ms:.2f}, {received}, {opened} ms"


@dataclass(frozen=True)
class SeenFrame:
    """A frame on the bus; `name` and `number` as in the DBC, ``UNKNOWN`` where it has none."""

    t_ms: float
    """From the run's start."""
    name: str
    number: int
    sender: str
    frame: Frame = field(repr=False)
    message: Message | Rejection

    @property
    def poles(self) -> str:
        """Of a trip, close, pilot or breaker status frame: ``ABC``, or empty."""
        if not isinstance(self.message, State):
            raise AttributeError(f"{self.name} has no poles: {self.message}")
        return pole_names(self.message.poles)


class _Stopped(Exception):
    """The test ended before its run."""


class TestRun:
    """A run in a thread.  Whatever is asked of it waits for its end; so does leaving its `with`."""

    __test__ = False  # no test class, for all its name

    def __init__(self, scenario: Scenario, start: Start, log: Path) -> None:
        self.scenario = scenario
        self.log = log
        self._start = start
        self._result: Result | None = None
        self._error: BaseException | None = None
        self._begun = threading.Event()
        self._stopping = False
        self._thread = threading.Thread(target=self._work, name="faultloop run", daemon=True)

    def begin(self) -> None:
        """Start it, and wait until it runs.  Raises what stands against that."""
        self._thread.start()
        self._begun.wait()
        if self._error is not None:
            raise self._error

    def _work(self) -> None:
        try:
            self._result = self._start(self._progress)
        except BaseException as error:
            self._error = error
        finally:
            self._begun.set()

    def _progress(self, part: float) -> None:
        self._begun.set()
        if self._stopping:
            raise _Stopped

    def stop(self) -> None:
        """End it, where it still runs."""
        self._stopping = True
        self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self.wait()
        else:
            self.stop()

    # -- what happened --------------------------------------------------------------------------------------

    def wait(self) -> Result:
        """Its `Result`, when it has ended.  Raises what went wrong in it."""
        self._thread.join()
        if self._error is not None:
            raise self._error
        assert self._result is not None
        return self._result

    @property
    def result(self) -> Result:
        """As `wait`."""
        return self.wait()

    @property
    def verdicts(self) -> list[Verdict]:
        """One for each `[[expect]]` of the scenario."""
        return self.wait().expectations

    def check(self) -> None:
        """All expectations of the scenario held.  Raises AssertionError with those that did not."""
        __tracebackhide__ = True
        missed = [f"relay {v.expect.relay}: {v.why}" for v in self.verdicts if not v.held]
        if missed:
            raise AssertionError(f"expected otherwise: {'; '.join(missed)}\n{self.told()}")

    @property
    def trips(self) -> list[SeenTrip]:
        """All trips, in order of time."""
        return [self._seen(trip) for trip in self.wait().trips]

    def trip(self, relay: str, **wanted: Any) -> SeenTrip:
        """The first trip of a relay that is as wanted: the keys of an `[[expect]]`, as ``within_ms=30``.

        Raises
        ------
        AssertionError : there is none; it says what tripped instead.
        InputError : no such relay, no such key.
        """
        __tracebackhide__ = True
        expect = self._expect(relay, wanted)
        result = self.wait()
        verdict = judge(expect, result.trips, result.fault_start_ns)
        if not verdict.held:
            told = ", ".join(f"{key}={value!r}" for key, value in wanted.items())
            raise AssertionError(f"relay {relay}, trip({told}): {verdict.why}\n{self.told()}")
        own = [trip for trip in result.trips if trip.relay == relay]
        return next(self._seen(t) for t in own if judge(expect, [t], result.fault_start_ns).held)

    def no_trip(self, relay: str) -> None:
        """The relay did not trip.  Raises AssertionError where it did."""
        __tracebackhide__ = True
        self._expect(relay, {})
        own = [trip for trip in self.trips if trip.relay == relay]
        if own:
            raise AssertionError(f"relay {relay} tripped\n{self.told()}")

    def frames(
        self, name: str | None = None, number: int | None = None, sender: str | None = None
    ) -> list[SeenFrame]:
        """The frames on the bus, in order of time.

        Parameters
        ----------
        name : ``"TRIP"``, ``"BREAKER_STATUS"`` and so on, as in the DBC, or ``"UNKNOWN"``.
        number : of the relay or breaker, from 0.
        sender : name of the node that sent it, or ``"external"``: a device of yours.
        """
        __tracebackhide__ = True
        known = [*(kind.name for kind in Kind), "UNKNOWN"]
        if name is not None and name not in known:
            raise InputError(f"no message is called '{name}': {nearest(name, known)}", key="frames")
        return [
            frame
            for frame in self._frames
            if name in (None, frame.name)
            and number in (None, frame.number)
            and sender in (None, frame.sender)
        ]

    @cached_property
    def _frames(self) -> list[SeenFrame]:
        self.wait()
        return [_seen_frame(entry) for entry in open_log(self.log).can]

    def _expect(self, relay: str, wanted: dict[str, Any]) -> Expect:
        relays = [place.name for place in self.scenario.relay]
        if relay not in relays:
            __tracebackhide__ = True
            raise InputError(f"there is no relay '{relay}': {nearest(relay, relays)}", key="trip")
        return validate(Expect, {"relay": relay, "trip": True, **wanted}, None)

    def _seen(self, trip: TripReport) -> SeenTrip:
        zero = self.wait().fault_start_ns or 0

        def ms(t_ns: int | None) -> float | None:
            return None if t_ns is None else (t_ns - zero) / 1e6

        return SeenTrip(
            trip.relay,
            trip.function,
            trip.zone,
            trip.loop,
            trip.pole_names,
            trip.breaker,
            (trip.t_ns - zero) / 1e6,
            ms(trip.received_ns),
            ms(trip.opened_ns),
        )

    def told(self) -> str:
        """What happened, in some lines: trips, events, where the log is."""
        if self._error is not None:
            return f"ended before its time: {self._error or type(self._error).__name__}"
        if self._result is None:
            return "still running"
        trips = [f"  {trip}" for trip in self.trips] or ["  none"]
        events = [f"  {e.t_ns / 1e6:8.2f} {e.source} {e.text}" for e in self._result.events]
        lines = ["Trips (from the fault's start):", *trips, "Events (ms from the run's start):", *events]
        return "\n".join([*lines, f"log: {self.log}"])


def _seen_frame(entry: Any) -> SeenFrame:
    frame = Frame(entry.id, bytes(entry.data), entry.extended, entry.fd)
    kind, number = BY_IDENTIFIER.get(frame.id, (None, frame.id))
    name = "UNKNOWN" if kind is None or frame.extended else kind.name
    return SeenFrame(entry.t_ns / 1e6, name, number, entry.sender, frame, read(frame))
