"""A run in rerun while it goes on: as a log is shown, with the line, and with the zones as they are.

Of what polarizes a zone a stream of samples and estimates says nothing; so each relay decides once more
beside the run, from what it streams (`faultloop.review.retrace_run`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from faultloop.io.can.authentication import read
from faultloop.io.can.frames import Frame, State
from faultloop.io.can.table import BY_IDENTIFIER, Kind
from faultloop.io.messages import BREAKER_STATUS, CAN_FRAME, FAULT_STATE, POLES, source_of
from faultloop.io.rerun_sink import RerunSink
from faultloop.io.rerun_view import LOCUS_HZ, Characteristics
from faultloop.loop.inputs import Inputs
from faultloop.loop.replay import turn_of
from faultloop.loop.scenario import Scenario
from faultloop.loop.warm import history, measured
from faultloop.relay import Relay, RelaySettings
from faultloop.relay.quantities import WIDE
from faultloop.review.rerun import polygon
from faultloop.review.retrace import RECORD, Heard, one_side, without_user_code
from faultloop.review.retrace_run import RetraceRun

SOON_S = 2.0
"""A fault whose instant is not known before it begins is waited for, where that is no longer than this."""


class LiveRerun(RerunSink):
    """Streams relays to rerun while they run; ``target``, ``start_ns`` and ``title`` as for `RerunSink`.

    ``again``: them once more, by name; ``breakers``: which of them a breaker belongs to, by its name.
    """

    def __init__(
        self,
        target: str,
        start_ns: int,
        title: str,
        again: Mapping[str, _Again],
        breakers: Mapping[str, str],
    ) -> None:
        super().__init__(target, start_ns, title)
        self._again, self._breakers = again, breakers
        self._held: list[Callable[[], None]] | None = None

    @classmethod
    def of_run(cls, target: str, inputs: Inputs) -> LiveRerun:
        """A run's.  Times count from the first fault, too: where it begins at an angle, nothing is shown
        before."""
        scenario = inputs.scenario
        before = measured(scenario, history(scenario)) if scenario.relay else []
        again = {
            place.name: _Again(inputs.settings[place.name], place.name, rows, place.parallel is not None)
            for place, rows in zip(scenario.relay, before, strict=True)
        }
        breakers = {place.breaker: place.name for place in scenario.relay if place.breaker}
        sink = cls(target, scenario.scenario.start_ns, scenario.scenario.name, again, breakers)
        sink._wait_for_the_fault(scenario)
        return sink

    @classmethod
    def of_replay(
        cls, target: str, name: str, settings: RelaySettings, start_ns: int, title: str
    ) -> LiveRerun:
        """A replay's, of one relay that begins cold."""
        return cls(target, start_ns, title, {name: _Again(settings, name)}, {RECORD: name})

    def _wait_for_the_fault(self, scenario: Scenario) -> None:
        starts = [(fault.start_s, fault.after_s) for fault in scenario.fault]
        known = [start for start, _ in starts if start is not None]
        cycle_s = 1 / scenario.system.frequency_hz
        latest = [float(after or 0) + 2 * cycle_s for start, after in starts if start is None]
        if starts and not latest:
            self.zero_ns = round(min(known) * 1e9)
        elif starts and min([*known, *latest]) < SOON_S:
            self._held = []
            self._until_ns = round(min([*known, *latest]) * 1e9)

    def add_relay(
        self, name: str, bits: Sequence[str], characteristics: Characteristics | None = None
    ) -> None:
        """Makes the views of a relay, with its line."""
        super().add_relay(name, bits, characteristics)
        z1 = complex(self._again[name].run.constants["shared"]["z1"])
        if np.isfinite(abs(z1)):
            self.draw_line(name, z1)

    def relay_block(
        self,
        name: str,
        t_ns: np.ndarray,
        sample_count: np.ndarray,
        samples: np.ndarray,
        phasors: np.ndarray,
        loops: np.ndarray,
        pickup: np.ndarray,
        operate: np.ndarray,
        *_: np.ndarray,
    ) -> None:
        """Shows a block, and each zone as it is."""
        if not len(t_ns):
            return
        given = (t_ns, sample_count, samples, phasors, loops, pickup, operate)
        block = tuple(np.array(one) for one in given)
        if self._held is not None and int(t_ns[0]) < self._until_ns:
            self._held.append(lambda: self._show(name, *block))
            return
        self._release()
        self._show(name, *block)

    def _show(self, name: str, *block: np.ndarray) -> None:
        super().relay_block(name, *block)
        for zone, times, polygons in self._again[name].take(*block):
            if zone in self._relays[name].zones:
                self.move_zone(name, zone, times, polygons)

    def message(self, topic: str, t_ns: int, message_name: str, **fields: Any) -> None:
        """Shows a rare message; the first fault's is time zero."""
        if message_name == FAULT_STATE.name and fields.get("on") and self.zero_ns is None:
            self.zero_ns = t_ns if self._held is not None else None
            self._release()
        if message_name == CAN_FRAME.name:
            self._listen(t_ns, fields)
        elif message_name == BREAKER_STATUS.name and source_of(topic) == RECORD:
            poles = sum(bool(fields[f"pole_{pole.lower()}"]) << bit for bit, pole in enumerate(POLES))
            self._again[self._breakers[RECORD]].heard.take(t_ns, poles)
        if self._held is not None:
            self._held.append(lambda: super(LiveRerun, self).message(topic, t_ns, message_name, **fields))
        else:
            super().message(topic, t_ns, message_name, **fields)

    def flush(self) -> None:
        """Sends everything held."""
        self._release()
        super().flush()

    def _release(self) -> None:
        held, self._held = self._held, None
        for show in held or ():
            show()

    def _listen(self, t_ns: int, fields: dict[str, Any]) -> None:
        """To what breakers say of their poles."""
        kind, _ = BY_IDENTIFIER.get(fields.get("id", 0), (None, 0))
        relay = self._breakers.get(fields.get("sender", ""))
        if kind is not Kind.BREAKER_STATUS or relay is None:
            return
        state = read(
            Frame(fields["id"], bytes(fields["data"]), bool(fields.get("extended")), bool(fields.get("fd")))
        )
        if isinstance(state, State):
            self._again[relay].heard.take(t_ns, state.poles)


class _Again:
    """A relay that decides once more, block by block.

    ``before``: what it measured before the run; without that it begins cold, and anew after each gap.
    """

    def __init__(
        self, settings: RelaySettings, name: str, before: np.ndarray | None = None, parallel: bool = False
    ) -> None:
        relay = Relay(without_user_code(settings.model_dump()), name)
        self.run, self.heard = RetraceRun(relay), Heard(relay)
        self._cold, self._next, self._turn = before is None, -1, 1.0 + 0.0j
        if before is not None:
            relay.warm_up(one_side(before) if parallel else np.ascontiguousarray(before[:, :6]))
        self._wide = WIDE if parallel else 6
        self._every = max(1, round(settings.relay.sampling_hz / LOCUS_HZ))
        self._zones = [one for one in relay.instances if one.function.name == "PDIS"]
        self._standing: set[str] = set()
        self._names = tuple(relay.bits)

    def take(
        self,
        t_ns: np.ndarray,
        sample_count: np.ndarray,
        samples: np.ndarray,
        phasors: np.ndarray,
        loops: np.ndarray,
        pickup: np.ndarray,
        *_: np.ndarray,
    ) -> list[tuple[str, np.ndarray, list[np.ndarray]]]:
        """Each zone's polygons of this block, and when they were so."""
        rows = np.full((len(t_ns), self._wide), np.nan)
        rows[:, :6] = samples[:, :6]
        phasors = np.array(phasors, np.float64, order="C")
        first = int(sample_count[0])
        if self._cold:
            if first != self._next:
                self.run.restart()
                self._turn = turn_of(self.run.relay.settings, first).conjugate()
            self._next = first + len(t_ns)
            phasors[:, :12].view(np.complex128)[...] *= self._turn
        given = (rows, phasors, np.ascontiguousarray(loops, np.float64))
        self.run.take(first, given, self.heard.inputs(t_ns, pickup, self._names), t_ns)
        chosen = np.flatnonzero(sample_count % self._every == 0)
        known = self.run.kept
        place = np.searchsorted(known.t_ns, t_ns[chosen])
        found = []
        x = np.ascontiguousarray(phasors[:, :12]).view(np.complex128)
        for one in self._zones:
            times, polygons = [], []
            for at, row in zip(chosen.tolist(), place.tolist(), strict=True):
                points = np.empty((0, 2))
                if row < len(known.t_ns) and known.t_ns[row] == t_ns[at]:
                    points = polygon(self.run.constants, one, known.shared[row], x[at])
                if len(points) or one.name in self._standing:
                    times.append(int(t_ns[at]))
                    polygons.append(points)
                    (self._standing.add if len(points) else self._standing.discard)(one.name)
            if times:
                found.append((one.name, np.array(times, np.int64), polygons))
        return found
