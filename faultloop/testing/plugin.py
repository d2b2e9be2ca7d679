"""What pytest loads at its start: options, a marker, the fixture.  Imports nothing but pytest."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from faultloop.testing.bus import FaultloopBus

_RUNS = pytest.StashKey[list]()


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("faultloop", "tests of CAN nodes against a simulated fault")
    group.addoption(
        "--faultloop-can",
        metavar="INTERFACE:CHANNEL",
        help="the bus of faultloop_bus, as in socketcan:vcan0; else in-process, one for each test",
    )
    group.addoption(
        "--faultloop-pace",
        type=float,
        default=1.0,
        metavar="X",
        help="simulated seconds in one of wall time, where a test does not say it (default 1)",
    )


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers",
        "faultloop_can(bus): the bus of this test, as in 'socketcan:vcan0'; skipped where it is not there",
    )


@pytest.fixture
def faultloop_bus(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[FaultloopBus]:
    """A CAN bus, and scenarios to run on it: `FaultloopBus`."""
    from faultloop.testing.bus import FaultloopBus, objection

    marker = request.node.get_closest_marker("faultloop_can")
    wanted: str | None = request.config.getoption("--faultloop-can")
    if marker is not None:
        wanted = str(marker.args[0])
        if (reason := objection(wanted)) is not None:
            pytest.skip(f"needs {wanted}: {reason}")
    bus = FaultloopBus(
        wanted or f"virtual:{request.node.nodeid}",
        folder=tmp_path,
        search=(request.path.parent, request.config.rootpath, Path.cwd()),
        pace=float(request.config.getoption("--faultloop-pace") or 1.0),
    )
    request.node.stash[_RUNS] = bus.runs
    with bus:
        yield bus


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Below a failure: what happened in the test's runs."""
    report = yield
    if report.failed:
        for run in item.stash.get(_RUNS, []):
            report.sections.append((f"faultloop: {run.scenario.scenario.name}", run.told()))
    return report
