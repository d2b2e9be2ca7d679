"""`run`: a scenario from its file to its result."""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from faultloop.config.override import overridden
from faultloop.errors import InputError
from faultloop.io.can.transport import Transport, open_transport
from faultloop.loop.beside import compile_beside
from faultloop.loop.case import can_be_kept, give_back, take_cases
from faultloop.loop.closed_loop import ClosedLoop
from faultloop.loop.doubts import scenario_doubts
from faultloop.loop.inputs import Given, Inputs, check_expectations, load_inputs
from faultloop.loop.outcome import Cast, Fold
from faultloop.loop.pacing import Pacing
from faultloop.loop.recording import MemorySink, Recorder, Sink, describe, open_sinks, open_streams
from faultloop.loop.result import Result
from faultloop.loop.scenario import Scenario
from faultloop.relay import Relay

if TYPE_CHECKING:
    from faultloop.io.rerun_sink import RerunSink


def run(
    scenario: Scenario | Path | str,
    *,
    settings: Mapping[str, Given] | None = None,
    log: Path | str | None = None,
    rerun: str | Callable[[Inputs], RerunSink] | None = None,
    can: str | None = None,
    pace: float | None = None,
    without: Sequence[str] = (),
    overrides: Sequence[str] = (),
    keep: bool | None = None,
    user_code: bool = True,
    sinks: Sequence[Sink | str] = (),
    progress: Callable[[float], None] | None = None,
    compress: bool = False,
    log_thread: bool = False,
) -> Result:
    """Run a scenario closed-loop.

    Parameters
    ----------
    scenario : a file, or a `Scenario`.
    log : the MCAP log to write; none if not given.
    rerun : ``"spawn"``, ``"serve"``, a file ``F.rrd`` or the URL of a viewer; or what makes the stream.
    can : ``"INTERFACE:CHANNEL"`` in place of the scenario's, as in ``"socketcan:vcan0"``: a bus that others
        may be on.  Where neither names one, the run has a bus of its own.
    pace : simulated seconds per second of wall time; None: as fast as it can.
    without : names of breakers that are not simulated: a device of your own on the bus takes their place.
        The plant follows the position that it publishes; give `pace`, or nobody waits for it.
    settings : by relay, `RelaySettings` or the dict that a file's TOML would be, in place of the files.
    overrides : ``"fault.F1.at_pu=0.7"``, ``"relay.RA.pdis.1.reach_pu=0.9"`` and the like.
    keep : keep samples and estimates in memory, for `Result.samples`; by default where there is no log.
    user_code : whether the relays' settings may name code; without it one that does is refused.
    sinks : more places to write to; a name is that of an entry point (group ``faultloop.sinks``).
    progress : called with the part done, 0 to 1.
    compress : the log's chunks are compressed (zstd): a third to a half of the size, for some time.
    log_thread : a thread of its own writes the log, the same to the byte: sooner done where a second core is
        idle; a run that is killed then loses what waits for it, too.

    Raises
    ------
    InputError : something in the scenario, the settings or the arguments is wrong; nothing has been written.
    Interrupted : a KeyboardInterrupt: Ctrl-C or a termination signal has ended the run; the log is whole.
    """
    what = scenario
    if pace is not None and not 0 < pace < math.inf:
        raise InputError(f"must be greater than 0 and finite, not {pace:g}", key="--pace")

    cases = take_cases()

    def made(chosen: Sequence[str]) -> tuple[Inputs, dict[str, Relay]]:
        inputs = load_inputs(what, settings, chosen, user_code=user_code)
        compile_beside()
        if all(map(can_be_kept, inputs.settings.values())):
            relays = cases.relays(inputs.settings)
        else:
            relays = {name: Relay(own, name=name) for name, own in inputs.settings.items()}
        check_expectations(inputs.scenario, relays)
        return inputs, relays

    (scenario, own), relays = overridden(made, overrides)
    memory = MemorySink() if (keep if keep is not None else log is None) else None
    fold = Fold(Cast.of_scenario(scenario, without))
    more = open_sinks(sinks, scenario.scenario.start_ns, scenario.scenario.name)
    streamed = log is not None or rerun is not None
    with _bus(scenario, can) as bus:
        # Everything that can be wrong is found before the first file is opened.
        alone = bus.bus is None and pace is None and not without
        unseen = alone and not streamed and not more  # nobody wants to know each frame
        sinks_of_run = [fold, *more, *([memory] if memory else [])]
        recorder = Recorder(sinks_of_run, fold.count_frames if unseen else None)
        if alone and all(map(can_be_kept, own.values())):
            loop = cases.loop(scenario, relays, recorder)
        else:
            loop = ClosedLoop(scenario, relays, recorder, bus, pace, without)
        metadata, attachments = describe(scenario, own, overrides, without) if streamed else ({}, {})
        start_ns = scenario.scenario.start_ns
        compression = "zstd" if compress else ""
        name = scenario.scenario.name
        shown = partial(rerun, Inputs(scenario, own)) if callable(rerun) else rerun
        streams = open_streams(start_ns, log, shown, name, metadata, attachments, compression, log_thread)
        recorder.sinks += streams.sinks
        try:
            with interruptible(loop):
                loop.run(progress)
            recorder.close()
        except InputError:  # a user's element or bus: nothing half-made stays behind; a full disk: the part
            recorder.abort()
            if streams.log is not None:
                streams.log.discard()
            raise
        except BaseException:
            recorder.abort()
            raise
        wall_s = time.perf_counter() - loop.began_s
        load = loop.bus_load
    result = Result.of(
        scenario,
        fold.outcome(),
        log=None if log is None else Path(log),
        simulated_s=loop.simulated_ns / 1e9,
        wall_s=wall_s,
        bus_load=load,
        fault_locations={place.name: relays[place.name].fault_location for place in scenario.relay},
        interrupted=loop.interrupted,
        pacing=None if pace is None else Pacing.of_blocks(pace, loop.deadlines),
        memory=memory,
        rerun=streams.rerun,
        warnings=tuple(scenario_doubts(scenario, own, loop.plant)),
    )
    give_back(cases)
    if result.interrupted:
        raise Interrupted(result)
    return result


def _bus(scenario: Scenario, can: str | None) -> Transport:
    """A bus of the run's own, unless one on which others may listen is asked for by its name."""
    if can is None and not scenario.can.named:
        return Transport.alone(scenario.can)
    return open_transport(scenario.can, can, start_ns=scenario.scenario.start_ns, scenario=scenario)


class Interrupted(KeyboardInterrupt):
    """Ctrl-C, or a termination signal, has ended a run before its time.  The log is closed and whole.

    Attributes
    ----------
    result : of the part that was run.
    """

    def __init__(self, result: Result) -> None:
        super().__init__(f"interrupted at {result.simulated_s:g} s")
        self.result = result


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
