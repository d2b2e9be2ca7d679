"""What a wheel carries, and that it works in an environment of its own, outside the repository."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.skipif(
    find_spec("hatchling") is None, reason="needs hatchling, which builds the wheel"
)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from hatchling.builders.wheel import WheelBuilder

    return Path(next(WheelBuilder(str(ROOT)).build(directory=str(tmp_path_factory.mktemp("wheel")))))


def test_it_carries_all_that_is_read_at_run_time(wheel: Path) -> None:
    """Everything of the package that is under version control, and what `new` gives; nothing else."""
    names = set(zipfile.ZipFile(wheel).namelist())
    kept = subprocess.run(
        ["git", "ls-files", "faultloop"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert set(kept.stdout.split()) <= names
    started = {f"faultloop/starter/{name}" for name in names_of_starter()}
    assert started <= names
    beside = {name for name in names if not name.startswith("faultloop/")}
    assert beside and all(".dist-info/" in name for name in beside)
    assert not [name for name in names if name.endswith((".pyc", ".mcap")) or "__pycache__" in name]


def names_of_starter() -> list[str]:
    from faultloop.cli.starter import starter_files

    return list(starter_files())


def test_it_says_what_it_needs(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        told = {
            Path(name).name: archive.read(name).decode() for name in archive.namelist() if "dist-info" in name
        }
    assert "faultloop = faultloop.cli:main" in told["entry_points.txt"]
    assert "faultloop = faultloop.testing.plugin" in told["entry_points.txt"]
    assert "Requires-Python: >=3.11" in told["METADATA"]
    assert "Provides-Extra: iec61850" in told["METADATA"]


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., str]:
    """Runs the command of an environment that has the wheel, and the packages that it needs from here."""
    folder = tmp_path_factory.mktemp("newcomer")
    venv.create(folder / "env", with_pip=True)
    scripts = folder / "env" / ("Scripts" if os.name == "nt" else "bin")
    python = scripts / Path(sys.executable).name
    code = "import sysconfig; print(sysconfig.get_path('purelib'))"
    site = subprocess.run([python, "-c", code], capture_output=True, text=True, check=True).stdout.strip()
    # A path of that file is looked up after the environment's own, and the .pth files there are not read: of
    # faultloop only the wheel is seen.
    (Path(site) / "packages.pth").write_text(sysconfig.get_path("purelib"), encoding="utf-8")
    subprocess.run(
        [python, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps", str(wheel)], check=True
    )
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    place = folder / "place"
    place.mkdir()

    def command(*arguments: str, program: str = "faultloop", status: int = 0) -> str:
        done = subprocess.run(
            [scripts / program, *arguments],
            cwd=place,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == status, (arguments, done.stdout, done.stderr)
        assert "Traceback" not in done.stderr
        return done.stdout

    where = command("-c", "import faultloop; print(faultloop.__file__)", program=python.name)
    assert where.startswith(str(folder))
    return command


@pytest.mark.slow
def test_a_newcomer(installed: Callable[..., str]) -> None:
    """What docs/index.md says, outside the repository."""
    assert "faultloop 0" in installed("--version")
    assert "start/scenarios/ag-zone1.toml" in installed("new", "start").replace(os.sep, "/")
    out = installed("run", "start/scenarios/ag-zone1.toml", "--log", "first.mcap")
    assert "PDIS1" in out
    assert "wrote p.html" in installed("review", "first.mcap", "--html", "p.html", "--png", "p.png")
    assert "PDIS1: A-G" in installed("why", "first.mcap")
    assert "no difference" in installed("diff", "first.mcap", "--again")
    assert json.loads(installed("schema", "scenario"))["properties"]
    for path in ("scenarios/settings/ab-mho.toml", "campaigns/position-and-sir.toml"):
        installed("check", f"start/{path}")
    installed("run", "start/scenarios/none.toml", status=2)
