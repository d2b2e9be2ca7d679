"""The bus of a test: devices of your own on it, and scenarios that run on it."""

from __future__ import annotations

import math
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

import pytest

from faultloop.errors import InputError
from faultloop.io.can.transport import open_bus
from faultloop.loop.runner import run
from faultloop.loop.scenario import AnyScenario, Scenario, load_scenario
from faultloop.testing.run import Start, TestRun

if TYPE_CHECKING:
    from can import BusABC


class FaultloopBus:
    """One CAN bus for one test.

    Parameters
    ----------
    can : ``"INTERFACE:CHANNEL"``.
    folder : where the logs go.
    search : folders that a scenario's path is relative to, the first that has it.
    pace : simulated seconds in one of wall time, where `run` is not told.

    Attributes
    ----------
    interface, channel : for a device of your own that opens the bus itself.
    runs : every run so far.
    """

    def __init__(self, can: str, *, folder: Path, search: Sequence[Path], pace: float) -> None:
        self.can = can
        self.interface, self.channel = _parts(can)
        self.runs: list[TestRun] = []
        self._folder = folder
        self._search = search
        self._pace = pace
        self._ended = threading.Event()
        self._failures: list[Exception] = []
        self._stack = ExitStack()

    def open(self, *, fd: bool = False) -> BusABC:
        """A python-can bus on it, for a device of your own; it is shut down when the test ends."""
        bus = open_bus(self.interface, self.channel, fd=fd)
        self._stack.callback(bus.shutdown)
        return bus

    def serve(self, step: Callable[[], object]) -> None:
        """Call `step` again and again, in a thread, until the test ends: the main loop of a device.

        An exception in it ends the loop, and fails the test when that ends.
        """

        def loop() -> None:
            try:
                while not self._ended.is_set():
                    step()
            except Exception as error:
                self._failures.append(error)

        thread = threading.Thread(target=loop, name="device", daemon=True)
        thread.start()
        self._stack.callback(thread.join)

    def run(
        self,
        scenario: Scenario | Path | str,
        *,
        can: str | None = None,
        pace: float | None = None,
        without: Sequence[str] = (),
        overrides: Sequence[str] = (),
        processes: bool = False,
    ) -> TestRun:
        """Start a scenario on the bus, in a thread; returns when its first samples have been simulated.

        Parameters
        ----------
        scenario : a file, relative to the test's folder, pytest's root or here; or a `Scenario`.
        can : another bus, ``"INTERFACE:CHANNEL"``; the test is skipped where it is not there.
        pace : simulated seconds in one of wall time, ``--faultloop-pace`` (1) where not given; ``math.inf``:
            as fast as it can, waiting for nobody.
        without : breakers (with `processes` also relays) that are yours.
        overrides : ``"fault.F1.at_pu=0.7"`` and the like.
        processes : every node is a process of its own; needs SocketCAN.

        Raises
        ------
        InputError : as `faultloop.run`.
        """
        __tracebackhide__ = True
        checked = (
            scenario if isinstance(scenario, AnyScenario) else load_scenario(self._find(scenario), overrides)
        )
        if can is not None and (reason := objection(can)) is not None:
            pytest.skip(f"needs {can}: {reason}")
        on = can or self.can
        log = self._folder / f"run-{len(self.runs) + 1}.mcap"
        rate = self._pace if pace is None else pace
        if processes:
            if isinstance(scenario, AnyScenario):
                raise InputError("processes read the scenario themselves: give its file", key="scenario")
            start = _processes(self._find(scenario), on, rate, without, overrides, log)
        else:
            start = _in_process(checked, on, rate, without, log)
        started = TestRun(checked, start, log)
        self.runs.append(started)
        started.begin()
        return started

    def _find(self, path: Path | str) -> Path:
        __tracebackhide__ = True
        for folder in self._search:
            if (folder / path).is_file():
                return folder / path
        places = ", ".join(dict.fromkeys(str(folder) for folder in self._search))
        raise InputError(f"no such scenario in {places}", file=path)

    def __enter__(self) -> Self:
        if self.interface == "socketcan":
            self._stack.enter_context(_alone(self.channel))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for started in self.runs:
            started.stop()
        self._ended.set()
        self._stack.close()
        if self._failures and error is None:
            raise self._failures[0]


def objection(can: str) -> str | None:
    """Why there is no such bus; None where there is."""
    try:
        open_bus(*_parts(can)).shutdown()
    except InputError as error:
        return str(error)
    return None


def _parts(can: str) -> tuple[str, str]:
    interface, colon, channel = can.partition(":")
    if not (interface and colon and channel):
        raise InputError(f"'{can}' is not INTERFACE:CHANNEL, as in socketcan:vcan0", key="--faultloop-can")
    return interface, channel


def _in_process(scenario: Scenario, can: str, pace: float, without: Sequence[str], log: Path) -> Start:
    limited = None if pace == math.inf else pace
    return lambda progress: run(scenario, can=can, pace=limited, without=without, log=log, progress=progress)


def _processes(
    file: Path, can: str, pace: float, without: Sequence[str], overrides: Sequence[str], log: Path
) -> Start:
    from faultloop.live.supervisor import run_processes

    return lambda progress: run_processes(
        file, can=can, pace=pace, without=without, overrides=overrides, log=log, progress=progress
    )


@contextmanager
def _alone(channel: str) -> Iterator[None]:
    """One test at a time, of this user's, on an interface that all of the machine's processes share."""
    if sys.platform == "win32":
        yield
        return
    import fcntl
    import os

    with (Path(tempfile.gettempdir()) / f"faultloop-{os.getuid()}-{channel}.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
