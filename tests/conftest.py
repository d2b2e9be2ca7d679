"""Where the tests find what is not in the repository."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.measured import Measured

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def root() -> Path:
    """The repository."""
    return ROOT


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder ``shared`` beside the repository: records, seed papers, data."""
    path = ROOT.parent / "shared"
    if not path.is_dir():
        pytest.skip(f"needs-shared: no folder {path.name} beside the repository")
    return path


@pytest.fixture(scope="session")
def records() -> Path:
    """Real fault records: FAULTLOOP_RECORDS, else ../shared/records."""
    given = os.environ.get("FAULTLOOP_RECORDS")
    path = Path(given) if given else ROOT.parent / "shared" / "records"
    if not path.is_dir():
        pytest.skip("needs-shared: no fault records; set FAULTLOOP_RECORDS to their folder")
    return path


@pytest.fixture
def measured(record_property: Callable[[str, object], None]) -> Iterator[Measured]:
    """Keeps the greatest of what a test measures, for bench/checks.py."""
    most: dict[tuple[str, str], float] = {}

    def keep(what: str, value: float, unit: str = "") -> None:
        most[what, unit] = max(float(value), most.get((what, unit), float(value)))

    yield keep
    for (what, unit), value in most.items():
        record_property("measured", json.dumps([what, value, unit]))


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--renew-golden", action="store_true", help="write tests/golden/*.json anew")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The guest's tests take minutes in one piece: begun by the middle, when what they need is compiled, they
    are not what one worker waits for at the end."""
    long = [item for item in items if item.name.endswith("on_vcan")]
    others = [item for item in items if not item.name.endswith("on_vcan")]
    middle = len(others) // 3
    items[:] = [*others[:middle], *long, *others[middle:]]
