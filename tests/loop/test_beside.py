"""The process that compiles beside."""

from __future__ import annotations

import os
from typing import Any

import pytest

from faultloop.loop import beside, drive


def test_it_compiles_what_every_loop_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    """From the last kernel to the first, for the types that any scenario has."""
    compiled: list[Any] = []

    class Kernel:
        def __init__(self, name: str) -> None:
            self.name, self.overloads = name, ()

        def compile(self, types: tuple[Any, ...]) -> None:
            compiled.append((self.name, types))

    real = {name: getattr(drive, name) for name in ("measure", "decide", "advance", "serve", "follow")}
    for name in real:
        monkeypatch.setattr(drive, name, Kernel(name))
    beside.main()
    assert [name for name, _ in compiled] == ["follow", "serve", "advance", "decide", "measure"]
    for name, types in compiled:
        real[name].compile(types)
        assert len(real[name].overloads) == 1, name  # those of the loops in this process: no second version


@pytest.mark.parametrize("cold", [True, False])
def test_it_is_begun_once_and_only_where_nothing_is_compiled(
    cold: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[Any] = []
    waited: list[int] = []
    monkeypatch.setattr(beside, "_begun", [])
    monkeypatch.setattr(beside, "is_kept", lambda kernel: not cold)
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 1})
    monkeypatch.setattr(os, "posix_spawn", lambda *args, **more: begun.append(args) or 4711)
    monkeypatch.setattr(os, "waitpid", lambda process, options: waited.append(process))
    beside.compile_beside()
    beside.compile_beside()
    assert len(begun) == cold
    assert waited == [4711] * cold  # at the second: it leaves nothing behind


def test_without_a_second_core_nothing_is_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(beside, "_begun", [])
    monkeypatch.setattr(beside, "is_kept", lambda kernel: False)
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0})
    monkeypatch.setattr(os, "posix_spawn", None)
    beside.compile_beside()
    assert not beside._begun
