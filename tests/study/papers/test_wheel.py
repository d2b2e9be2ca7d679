"""Seed paper 003 from an installed wheel, outside the repository: its data comes along."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
import zipfile
from importlib.util import find_spec
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(
    find_spec("hatchling") is None, reason="needs hatchling, which builds the wheel"
)
DATA = ("branches.csv", "buses.csv", "generators.csv", "README.md")


def wheel_of(root: Path, folder: Path) -> Path:
    from hatchling.builders.wheel import WheelBuilder

    return Path(next(WheelBuilder(str(root)).build(directory=str(folder))))


def test_the_wheel_has_the_39_bus_system(root: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(wheel_of(root, tmp_path)) as wheel:
        for name in DATA:
            packed = wheel.read(f"faultloop/study/papers/ckmc/data/{name}")
            assert packed == (root / "faultloop/study/papers/ckmc/data" / name).read_bytes()


@pytest.mark.slow
def test_the_suite_runs_from_an_installed_wheel(root: Path, tmp_path: Path) -> None:
    """A fresh environment that holds the wheel and sees these dependencies, but not this repository."""
    wheel = wheel_of(root, tmp_path)
    home, elsewhere = tmp_path / "venv", tmp_path / "elsewhere"
    elsewhere.mkdir()
    subprocess.run([sys.executable, "-m", "venv", str(home)], check=True)
    python = home / ("Scripts" if os.name == "nt" else "bin") / "python"
    install = [str(python), "-m", "pip", "install", "--quiet", "--no-index", "--no-deps", str(wheel)]
    subprocess.run(install, check=True)
    where = subprocess.run(
        [str(python), "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"],
        check=True,
        capture_output=True,
        text=True,
    )
    # A path file within a path file's folder is not read: an editable install of this tree stays unseen.
    (Path(where.stdout.strip()) / "dependencies.pth").write_text(sysconfig.get_path("purelib"))
    hidden = ("PYTHONPATH", "FAULTLOOP_IEEE39")
    alone = {name: value for name, value in os.environ.items() if name not in hidden}

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [str(python), *arguments]
        return subprocess.run(command, cwd=elsewhere, env=alone, capture_output=True, text=True, check=False)

    assert str(home) in run("-c", "import faultloop; print(faultloop.__file__)").stdout
    done = run("-m", "faultloop", "suite", "seeds", "ckmc", "--quick", "--json")
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["held"] is True
    assert told["reports"][0]["failed"] is None and len(told["reports"][0]["tables"]) > 10
    assert list(elsewhere.iterdir()) == []
