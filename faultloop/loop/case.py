"""Many runs without a log: what does not change from case to case is made once.

    cases = Cases()
    outcome = cases.prepare(scenario, settings).run()

A case decides as `faultloop.run` does, to the bit.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from faultloop.loop.beside import compile_beside
from faultloop.loop.closed_loop import ClosedLoop
from faultloop.loop.inputs import Agreement
from faultloop.loop.kept_loop import KeptLoop
from faultloop.loop.outcome import Cast, Fold, Outcome
from faultloop.loop.recording import MemorySink, Recorder, Sink
from faultloop.loop.scenario import Scenario
from faultloop.loop.traffic import is_same_bus
from faultloop.loop.warm import WarmStates
from faultloop.plant import Plants
from faultloop.relay import Relay, RelaySettings, load_settings
from faultloop.relay.estimators import is_own

KEPT = 1000
"""Settings that are known by sight."""
KEPT_LOOPS = 8
KEPT_RELAYS = 200


def can_be_kept(settings: RelaySettings) -> bool:
    """Whether a relay is the same from run to run; code of a user's may have changed in between, and may
    remember."""
    return not settings.element and is_own(settings.estimator.method)


_here = threading.local()


def take_cases() -> Cases:
    """This thread's, for one run, which then gives them back; new ones where another has them, or failed."""
    cases: Cases | None = getattr(_here, "cases", None)
    _here.cases = None
    return Cases() if cases is None or cases.full else cases


def give_back(cases: Cases) -> None:
    """For the next run."""
    _here.cases = cases


@dataclass
class CaseOutcome(Outcome):
    """What happened in a case, and what no message says.

    Attributes
    ----------
    fault_locations : by relay, per unit of its line; NaN where none was found.
    bus_load : part of the time in which the bus was busy, 0 to 1.
    """

    fault_locations: dict[str, float]
    bus_load: float


class Prepared:
    """A case that is ready to run, as often as wanted; one at a time of the `Cases` that prepared it."""

    def __init__(self, scenario: Scenario, relays: Mapping[str, _Kept], loops: _Loops) -> None:
        self.scenario = scenario
        self._relays, self._loops = relays, loops

    def run(self, sinks: Sequence[Sink] = (), *, texts: bool = True) -> CaseOutcome:
        """The whole case; `sinks` (`faultloop.loop.recording.MemorySink`) get its samples and estimates.
        Without ``texts`` the outcome has no `events`, which take a tenth of a case's time."""
        scenario = self.scenario
        relays = {name: kept.as_new() for name, kept in self._relays.items()}
        fold = Fold(Cast.of_scenario(scenario), texts=texts)
        curious = [sink for sink in sinks if not isinstance(sink, MemorySink)]
        recorder = Recorder([fold, *sinks], None if curious else fold.count_frames)
        loop = self._loops.loop(scenario, relays, recorder)
        loop.run()
        return CaseOutcome(
            **vars(fold.outcome()),
            fault_locations={name: relay.fault_location for name, relay in relays.items()},
            bus_load=loop.bus_load,
        )


class Cases:
    """Makes cases ready, and keeps what they share: relays by their settings, and what their warm-ups led to.

    Not to be used by two threads at once; each has its own.
    """

    def __init__(self) -> None:
        self._files: dict[Any, RelaySettings] = {}
        self._relays: dict[tuple[str, str], _Kept] = {}
        self._known: dict[tuple[str, int], tuple[RelaySettings, _Kept]] = {}
        """By the settings' identity: to write them down takes longer than to look here."""
        self._loops = _Loops()
        self._agreement = Agreement()

    def prepare(self, scenario: Scenario, settings: Mapping[str, RelaySettings] | None = None) -> Prepared:
        """A case of `scenario`.

        Parameters
        ----------
        scenario : validated.
        settings : by relay; of the relays that are not there, the file that the scenario names.

        Raises
        ------
        InputError : scenario and settings do not fit.
        """
        given = settings or {}
        own = {
            place.name: given[place.name]
            if place.name in given
            else self._load(scenario.settings_path(place))
            for place in scenario.relay
        }
        self._agreement.check(scenario, own)
        kept = {place.name: self._kept(place.name, own[place.name]) for place in scenario.relay}
        return Prepared(scenario, kept, self._loops)

    def relays(self, settings: Mapping[str, RelaySettings]) -> dict[str, Relay]:
        """New ones, by name."""
        return {name: self._kept(name, own).as_new() for name, own in settings.items()}

    def loop(self, scenario: Scenario, relays: Mapping[str, Relay], recorder: Recorder) -> ClosedLoop:
        """A run of a scenario, on a bus of its own, with some of `relays`."""
        return self._loops.loop(scenario, relays, recorder)

    @property
    def full(self) -> bool:
        """Whether relays of many settings are kept."""
        return len(self._relays) >= KEPT_RELAYS

    def _load(self, path: Any) -> RelaySettings:
        if path not in self._files:
            self._files[path] = load_settings(path)
        return self._files[path]

    def _kept(self, name: str, settings: RelaySettings) -> _Kept:
        same = self._known.get((name, id(settings)))
        if same is not None and same[0] is settings:
            return same[1]
        key = (name, settings.model_dump_json())
        if key not in self._relays:
            compile_beside()
            self._relays[key] = _Kept(Relay(settings, name=name))
        if len(self._known) >= KEPT:
            self._known.clear()
        self._known[name, id(settings)] = settings, self._relays[key]
        return self._relays[key]


class _Loops:
    """Loops for one case after the other: what does not change from case to case is made once."""

    def __init__(self) -> None:
        self._warm, self._plants = WarmStates(), Plants()
        self._kept: list[KeptLoop] = []

    def loop(self, scenario: Scenario, relays: Mapping[str, Relay], recorder: Recorder) -> ClosedLoop:
        """One at the beginning of a scenario; the one that was given before may be the same."""
        wanted = [relays[place.name] for place in scenario.relay]
        for place, loop in enumerate(self._kept):
            if loop.relays == wanted and is_same_bus(loop.scenario, scenario):
                self._kept.insert(0, self._kept.pop(place))
                loop.begin_again(scenario, recorder, self._plants.plant(scenario))
                return loop
        shares = all(can_be_kept(relay.settings) for relay in wanted)
        own = {"warm_up": self._warm.warm_up, "plant_of": self._plants.plant}
        loop = KeptLoop(scenario, relays, recorder, shares=shares, **own)
        self._kept = [loop, *self._kept[: KEPT_LOOPS - 1]]
        return loop


class _Kept:
    """A relay, and how it was when it was new."""

    def __init__(self, relay: Relay) -> None:
        self._relay = relay
        self._new = relay.save()

    def as_new(self) -> Relay:
        self._relay.restore(self._new)
        self._relay.events = []
        return self._relay
