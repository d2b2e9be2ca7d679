"""Tests that need a pair of virtual Ethernet interfaces."""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import pytest


@contextmanager
def veth_pair() -> Iterator[tuple[str, str]]:
    """Two interfaces, each of which gets what the other one sends; gone afterwards.  One pair at a time on a
    machine: a packet socket hears every interface until it is bound."""
    here, there = names = f"fg{os.getpid()}a", f"fg{os.getpid()}b"
    with (Path(tempfile.gettempdir()) / "faultloop-veth.lock").open("w") as turn:
        fcntl.flock(turn, fcntl.LOCK_EX)  # until it is closed
        _ip("add", "dev", here, "type", "veth", "peer", "name", there)
        try:
            for name in names:
                _ip("set", "dev", name, "up")
            yield names
        finally:
            _ip("del", "dev", here)


def _ip(*arguments: str) -> None:
    subprocess.run(["ip", "link", *arguments], check=True, capture_output=True)


@cache
def may_make_pairs() -> bool:
    """Linux, root (CAP_NET_ADMIN, CAP_NET_RAW), and a kernel that has them."""
    if shutil.which("ip") is None:
        return False
    try:
        with veth_pair():
            return True
    except subprocess.CalledProcessError:
        return False


needs_veth = pytest.mark.skipif(not may_make_pairs(), reason="needs-veth: Linux, root")
