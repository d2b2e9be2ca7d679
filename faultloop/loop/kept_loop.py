"""A closed loop for one case after the other: what does not change from case to case is made once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from faultloop.io.can.transport import Transport
from faultloop.loop.closed_loop import ClosedLoop
from faultloop.loop.prelude import Parts, Prelude, Stand
from faultloop.loop.recording import Recorder
from faultloop.loop.scenario import Scenario
from faultloop.nodes.tables import BusTables
from faultloop.plant import Plant
from faultloop.relay import Relay


class KeptLoop(ClosedLoop):
    """Parameters beside those of `ClosedLoop`:

    shares : whether a case may go on from where one of the same network stood (`Prelude`): no user's code is
        in the relays.
    """

    def __init__(
        self,
        scenario: Scenario,
        relays: Mapping[str, Relay],
        recorder: Recorder,
        *,
        warm_up: Callable[[Scenario, Sequence[Relay]], None],
        plant_of: Callable[[BusTables], Plant],
        shares: bool,
    ) -> None:
        bus = Transport.alone(scenario.can)
        super().__init__(scenario, relays, recorder, bus, warm_up=warm_up, plant_of=plant_of)
        self._traffic.keep()
        self._prelude = Prelude(self.plant)
        self._shares = shares
        self._stand: Stand | None = None
        self._place = 0  # where it is to be kept

    def begin_again(self, scenario: Scenario, recorder: Recorder, plant: Plant) -> None:
        """As a new one of `scenario`, which has the same bus (`is_same_bus`), for the same relays."""
        seats = self._course.breaker["seat"]
        self._set_up(scenario, recorder, plant)
        self._course.breaker["seat"] = seats
        self._stand, self._place = None, 0
        if self._shares and recorder.counts is not None and not recorder.wants_blocks:
            self._stand, self._place = self._prelude.begin(plant, self.total, recorder.wants_texts)
        self._traffic.begin_again(scenario, recorder, self._stand.traffic if self._stand else None)

    def _warm(self) -> None:
        if self._stand is None:
            super()._warm()
            return
        self._stand.put_back(self._parts)
        self._now["end"] = self.total

    def _start(self) -> None:
        """Goes to where it is to be kept, with nothing made beyond, and keeps it if all was quiet."""
        super()._start()
        if not self._place:
            return
        told, warm = self.recorder.told, [relay.events for relay in self.relays]
        self._now["end"] = self._place
        while self.sample_count < self._place and not self.interrupted:
            self._run_to(min(self.sample_count + self._block, self._place))
        self._now["end"] = self.total
        if not self.interrupted and self.recorder.told == told and self._traffic.is_quiet:
            self._prelude.keep(Stand.of(self._parts, self.recorder.wants_texts, warm))

    @property
    def _parts(self) -> Parts:
        return Parts(self._course, self._traffic, self.plant, self._bank, self.relays)
