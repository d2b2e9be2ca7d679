"""`run`: a scenario from its file to its result."""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

from faultloop.errors import InputError, nearest
from faultloop.io.can.transport import open_transport
from faultloop.loop.outcome import Cast, Fold
from faultloop.loop.pacing import Pacing
from faultloop.loop.recording import MemorySink, Recorder, Sink, describe, open_streams
from faultloop.loop.result import Result
from faultloop.loop.scenario import AnyScenario, Scenario, load_scenario
from faultloop.loop.simulation import Simulation
from faultloop.relay import Relay, RelaySettings, load_settings
from faultloop.relay.named_code import refuse_user_code


def run(
    scenario: Scenario | Path | str,
    *,
    log: Path | str | None = None,
    rerun: str | None = None,
    can: str | None = None,
    pace: float | None = None,
    without: Sequence[str] = (),
    overrides: Sequence[str] = (),
    keep: bool | None = None,
    user_code: bool = True,
    sinks: Sequence[Sink] = (),
    progress: Callable[[float], None] | None = None,
) -> Result:
    """Run a scenario closed-loop.

    Parameters
    ----------
    scenario : a file, or a `Scenario`.
    log : the MCAP log to write; none if not given.
    rerun : ``"spawn"``, ``"serve"``, a file ``F.rrd`` or the URL of a viewer.
    can : ``"INTERFACE:CHANNEL"`` in place of the scenario's, as in ``"socketcan:vcan0"``.
    pace : simulated seconds per second of wall time; None: as fast as it can.
    without : names of breakers that are not simulated: a device of your own on the bus takes their place.
        The plant follows the position that it publishes; give `pace`, or nobody waits for it.
    overrides : ``"fault.F1.at_pu=0.7"`` and the like; only with a file.
    keep : keep samples and estimates in memory, for `Result.samples`; by default where there is no log.
    user_code : whether the relays' settings may name code; without it one that does is refused.
    sinks : more places to write to.
    progress : called with the part done, 0 to 1.

    Raises
    ------
    InputError : something in the scenario, the settings or the arguments is wrong; nothing has been written.
    """
    if not isinstance(scenario, AnyScenario):
        scenario = load_scenario(scenario, overrides)
    elif overrides:
        raise InputError("overrides need the scenario's file, not a Scenario", key="overrides")
    if pace is not None and not 0 < pace < math.inf:
        raise InputError(f"must be greater than 0 and finite, not {pace:g}", key="--pace")
    settings = {place.name: load_settings(scenario.settings_path(place)) for place in scenario.relay}
    check_settings(scenario, settings, user_code)
    relays = {name: Relay(s, name=name) for name, s in settings.items()}
    check_expectations(scenario, relays)
    memory = MemorySink() if (keep if keep is not None else log is None) else None
    fold = Fold(Cast.of_scenario(scenario, without))
    recorder = Recorder([fold, *sinks, *([memory] if memory else [])])
    with open_transport(scenario.can, can, start_ns=scenario.scenario.start_ns) as bus:
        # Everything that can be wrong is found before the first file is opened.
        simulation = Simulation(scenario, relays, recorder, bus, pace, without)
        started = time.perf_counter()
        metadata, attachments = describe(scenario, settings, overrides, without)
        start_ns = scenario.scenario.start_ns
        streams = open_streams(start_ns, log, rerun, scenario.scenario.name, metadata, attachments)
        recorder.sinks += streams.sinks
        try:
            with interruptible(simulation):
                simulation.run(progress)
        except InputError:  # a user's element or bus: nothing half-made stays behind
            recorder.abort()
            if streams.log is not None:
                streams.log.part.unlink(missing_ok=True)
            raise
        except BaseException:
            recorder.abort()
            raise
        recorder.close()
        wall_s = time.perf_counter() - started
        load = bus.load(simulation.simulated_ns)
    return Result.of(
        scenario,
        fold.outcome(),
        log=None if log is None else Path(log),
        simulated_s=simulation.simulated_ns / 1e9,
        wall_s=wall_s,
        bus_load=load,
        fault_locations={place.name: relays[place.name].fault_location for place in scenario.relay},
        interrupted=simulation.interrupted,
        pacing=None if pace is None else Pacing.of_blocks(pace, simulation.deadlines),
        memory=memory,
        rerun=streams.rerun,
    )


def check_settings(scenario: Scenario, settings: Mapping[str, RelaySettings], user_code: bool = True) -> None:
    """What scenario and settings must agree on, and whether these may name code."""
    for place in scenario.relay:
        if not user_code:
            refuse_user_code(settings[place.name])
        own = settings[place.name].relay
        for key, wanted in (
            ("sampling_hz", scenario.system.sampling_hz),
            ("frequency_hz", scenario.system.frequency_hz),
        ):
            got = getattr(own, key)
            if got != wanted:
                raise InputError(
                    f"is {got} for relay '{place.name}', but the scenario's [system] has {wanted}",
                    file=scenario.settings_path(place),
                    key=f"relay.{key}",
                )


def check_expectations(scenario: Scenario, relays: Mapping[str, Relay]) -> None:
    """The functions that are expected to trip exist."""
    for number, expect in enumerate(scenario.expect):
        functions = [name for name in relays[expect.relay].bits if "." not in name and name != "PTRC1"]
        if expect.function is not None and expect.function not in functions:
            raise InputError(
                f"relay '{expect.relay}' has no function '{expect.function}';"
                f" {nearest(expect.function, functions)}",
                file=scenario.path,
                key=f"expect[{number}].function",
            )


class Interruptible(Protocol):
    """What looks at a flag now and then, and ends when it is set."""

    interrupted: bool


@contextmanager
def interruptible(running: Interruptible) -> Iterator[None]:
    """Ctrl-C and a termination signal end what runs in good order; a second one at once."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(*_: object) -> None:
        if running.interrupted:
            raise KeyboardInterrupt
        running.interrupted = True

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
