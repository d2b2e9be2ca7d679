"""Where compiled kernels are kept, and what is said where they cannot be."""

from __future__ import annotations

import dis
import fcntl
import importlib
import os
import pkgutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher
from numba.core.errors import TypingError

import faultloop
from faultloop.jit import CALLS, _SharedCache, njit

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="users and modes of POSIX")

KERNEL = """
import sys
from faultloop import jit
jit.on_first_compilation(lambda: print("compiles"))
from faultloop.jit import njit
sys.modules["faultloop.relay.own"] = sys.modules["__main__"]
{change}
def double(x):
    return 2 * x
double.__module__ = "faultloop.relay.own"
kernel = njit(double)
print(kernel(21), jit.cache_root(), jit.cache_note())
"""


def told(tmp_path: Path, change: str = "", **environment: str | None) -> list[str]:
    script = tmp_path / "script.py"
    script.write_text(KERNEL.format(change=change), encoding="utf-8")
    env = {key: value for key, value in (os.environ | environment).items() if value is not None}
    done = subprocess.run([sys.executable, str(script)], env=env, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return done.stdout.splitlines()


def test_compilation_is_told_when_it_happens(tmp_path: Path) -> None:
    """Not where the cache has the kernel; again where it is empty, or another kernel is wanted."""
    cache = tmp_path / "cache"
    line = f"42 {cache} None"
    assert told(tmp_path, FAULTLOOP_CACHE=str(cache)) == ["compiles", line]
    assert told(tmp_path, FAULTLOOP_CACHE=str(cache)) == [line]
    for file in cache.rglob("*.nb?"):
        file.unlink()
    assert told(tmp_path, FAULTLOOP_CACHE=str(cache)) == ["compiles", line]
    for file in cache.rglob("*.nbi"):
        file.write_bytes(b"damaged")
    assert told(tmp_path, FAULTLOOP_CACHE=str(cache)) == ["compiles", line]
    assert told(tmp_path, FAULTLOOP_CACHE=str(cache)) == [line]  # and mended


def test_the_same_source_elsewhere_is_not_compiled_again(tmp_path: Path) -> None:
    """Another checkout, another installation, a file that was touched."""
    cache, other = tmp_path / "cache", tmp_path / "other"
    other.mkdir()
    line = f"42 {cache} None"
    assert told(tmp_path, FAULTLOOP_CACHE=str(cache)) == ["compiles", line]
    assert told(other, FAULTLOOP_CACHE=str(cache)) == [line]


def test_what_has_changed_is_compiled_again(tmp_path: Path) -> None:
    """A callee in another file, a constant in one without kernels; and nothing else of the package."""
    package, cache = tmp_path / "faultloop", str(tmp_path / "cache")
    files = {
        "__init__.py": "",
        "jit.py": (Path(faultloop.__file__).parent / "jit.py").read_text(encoding="utf-8"),
        "linking.py": (Path(faultloop.__file__).parent / "linking.py").read_text(encoding="utf-8"),
        "relay/__init__.py": "",
        "relay/constants.py": "FACTOR = 2",
        "relay/callee.py": "from faultloop.jit import njit\n@njit\ndef more(x):\n    return x + 1\n",
        "relay/own.py": "from faultloop.jit import njit\nfrom faultloop.relay.callee import more\n"
        "from faultloop.relay.constants import FACTOR\n@njit\ndef kernel(x):\n    return FACTOR * more(x)\n",
        "plant/other.py": "A = 1",
    }
    for name, text in files.items():
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_text(text, encoding="utf-8")
    script = tmp_path / "script.py"
    script.write_text(
        "from faultloop import jit\njit.on_first_compilation(lambda: print('compiles'))\n"
        "from faultloop.relay.own import kernel\nprint(kernel(20))\n",
        encoding="utf-8",
    )

    def said() -> list[str]:
        env = os.environ | {"FAULTLOOP_CACHE": cache, "PYTHONPATH": str(tmp_path)}
        done = subprocess.run([sys.executable, script], env=env, capture_output=True, text=True, check=True)
        return done.stdout.split()

    assert said() == ["compiles", "42"]
    (package / "plant" / "other.py").write_text("A = 2", encoding="utf-8")
    assert said() == ["42"]
    (package / "relay" / "constants.py").write_text("FACTOR = 3", encoding="utf-8")
    assert said() == ["compiles", "63"]
    callee = package / "relay" / "callee.py"
    callee.write_text(callee.read_text(encoding="utf-8").replace("x + 1", "x + 2"), encoding="utf-8")
    assert said() == ["compiles", "66"]


def test_of_several_processes_one_compiles(tmp_path: Path) -> None:
    cache = str(tmp_path / "cache")
    with ThreadPoolExecutor(4) as pool:
        folders = [tmp_path / str(i) for i in range(4)]
        for folder in folders:
            folder.mkdir()
        said = list(pool.map(lambda folder: told(folder, FAULTLOOP_CACHE=cache), folders))
    assert sorted(len(lines) for lines in said) == [1, 1, 1, 2]


def test_a_lock_is_no_older_than_its_process(tmp_path: Path) -> None:
    """One that was killed while it compiled leaves the file behind, and nobody waits for it."""
    cache = tmp_path / "cache"
    line = f"42 {cache} None"
    assert told(tmp_path, FAULTLOOP_CACHE=str(cache)) == ["compiles", line]
    assert list(cache.rglob("*.lock"))
    for file in cache.rglob("*.nb?"):
        file.unlink()
    assert told(tmp_path, FAULTLOOP_CACHE=str(cache)) == ["compiles", line]


def test_a_kernel_that_does_not_compile_keeps_nobody_waiting(tmp_path: Path) -> None:
    """Its lock is given back, or the next process, and this one when it tries again, would wait for ever."""

    def wrong(x: Any) -> Any:
        return x.nothing

    kernel = njit(cache=False)(wrong)
    kernel._cache = _SharedCache(wrong, tmp_path)
    with pytest.raises(TypingError, match="nothing"):
        kernel(1.0)
    (lock,) = tmp_path.rglob("*.lock")
    with lock.open() as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def test_a_kernel_that_lends_out_what_it_was_lent_is_refused() -> None:
    """Its callers would give back a reference that nobody took."""

    def part(x: np.ndarray) -> np.ndarray:
        return x[1:]

    part.__module__ = "faultloop.plant.part"
    with pytest.raises((TypingError, AssertionError), match="array"):
        njit(cache=False)(part)(np.zeros(3))
    assert njit(cache=False, heap=True)(part)(np.arange(3.0)).tolist() == [1.0, 2.0]


@pytest.mark.parametrize("area", CALLS)
def test_a_kernel_calls_only_what_its_caches_key_covers(area: str) -> None:
    """Or it would keep the machine code of what has changed since."""
    folder, found = Path(faultloop.__file__).parent / area, 0
    for info in pkgutil.walk_packages([str(folder)], f"faultloop.{area}."):
        if info.name.rpartition(".")[2] == "__main__":
            continue
        module = importlib.import_module(info.name)
        for kernel in vars(module).values():
            if isinstance(kernel, Dispatcher) and kernel.__module__ == info.name:
                for used in _globals_of(kernel.py_func):
                    if isinstance(used, Dispatcher) and used.__module__.startswith("faultloop."):
                        found += 1
                        assert used.__module__.split(".")[1] in CALLS[area], (kernel, used)
    assert found > 5


def _globals_of(function: Any) -> list[object]:
    space = function.__globals__
    loads = [i.argval for i in dis.get_instructions(function) if i.opname == "LOAD_GLOBAL"]
    return [space[name] for name in loads if name in space]


def test_a_cache_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    place = tmp_path / "file" / "cache"
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    line = told(tmp_path, FAULTLOOP_CACHE=str(place), TMPDIR=str(temporary))[-1]
    own = temporary / f"faultloop-{os.getuid()}"
    assert line.startswith(f"42 {own} {place} cannot be written: compiled kernels are kept in {own}")
    assert "\n" not in line


@pytest.mark.parametrize("mode", ["others may write", "a link", "a file"])
def test_nobody_elses_folder_is_taken(tmp_path: Path, mode: str) -> None:
    """What lies in it is run as code."""
    (tmp_path / "file").write_text("", encoding="utf-8")
    own = tmp_path / f"faultloop-{os.getuid()}"
    if mode == "others may write":
        own.mkdir()
        own.chmod(0o777)
    elif mode == "a link":
        (tmp_path / "elsewhere").mkdir()
        own.symlink_to(tmp_path / "elsewhere")
    else:
        own.write_text("", encoding="utf-8")
    line = told(tmp_path, FAULTLOOP_CACHE=str(tmp_path / "file" / "cache"), TMPDIR=str(tmp_path))
    assert line[0] == "compiles"
    assert line[1].startswith("42 None ")
    assert "are not kept" in line[1]


def test_no_home_at_all(tmp_path: Path) -> None:
    change = "import pathlib\ndef none(): raise RuntimeError\npathlib.Path.home = none\n"
    nowhere = dict.fromkeys(("HOME", "XDG_CACHE_HOME", "FAULTLOOP_CACHE"))
    line = told(tmp_path, change, TMPDIR=str(tmp_path), **nowhere)[-1]
    assert line.startswith(f"42 {tmp_path}/faultloop-{os.getuid()} there is no home folder: ")
