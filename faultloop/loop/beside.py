"""The first compilation on two cores: another process begins at the loop's other end.

Where the cache has no machine code yet, this process compiles the relays and what they decide with, and one
beside it, ``python -m faultloop.loop.beside``, the loop, the exchange and the plant; each then takes from the
cache what the other has made (numba compiles in one thread of a process at a time).  It is detached: if it
cannot begin, or is killed, this process compiles the rest.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import Any

from faultloop.io.can.transport import Transport
from faultloop.jit import PACKAGE, cache_root, is_kept
from faultloop.loop import drive
from faultloop.loop.closed_loop import ClosedLoop
from faultloop.loop.recording import Recorder
from faultloop.loop.scenario import Scenario
from faultloop.relay import Relay, RelaySettings

IMPEDANCE = {"z1_ohm": [1.0, 10.0], "z0_ohm": [2.0, 20.0]}
PER_KM = {"r1_ohm_per_km": 0.1, "x1_ohm_per_km": 0.4, "r0_ohm_per_km": 0.3, "x0_ohm_per_km": 1.2}
SCENARIO = {
    "scenario": {"name": "compilation", "duration_s": 0.1},
    "system": {"frequency_hz": 50, "base_kv": 110},
    "source": [{"name": "S", "bus": "A"} | IMPEDANCE],
    "line": [{"name": "L", "from": "A", "to": "B", "model": "rl", "length_km": 10.0} | PER_KM],
    "relay": [{"name": "R", "line": "L", "end": "from", "settings": "none.toml"}],
}
SETTINGS = {
    "relay": {"frequency_hz": 50},
    "line": IMPEDANCE,
    "estimator": {"method": "fourier"},
    "pdis": [{"zone": 1, "direction": "forward", "characteristic": "mho", "reach_pu": 0.8}],
}
"""Any would do: the loop is compiled for the same types whatever it runs."""

_begun: list[int] = []
"""The process, once it was asked for."""


def compile_beside() -> None:
    """Have another process compile too: once, where there is a first compilation, a cache and a core."""
    for process in _begun:  # ended since: no entry in the table of processes is left of it
        with suppress(ChildProcessError):
            os.waitpid(process, os.WNOHANG)
    wanted = not is_kept(drive.follow) and cache_root() is not None
    if _begun or not wanted or not hasattr(os, "sched_getaffinity") or len(os.sched_getaffinity(0)) < 2:
        return
    path = os.pathsep.join([str(PACKAGE.parent), *filter(None, [os.environ.get("PYTHONPATH")])])
    nowhere: Any = [(os.POSIX_SPAWN_OPEN, stream, os.devnull, os.O_RDWR, 0) for stream in range(3)]
    with suppress(OSError):
        command = [sys.executable, "-m", __name__]
        _begun.append(
            os.posix_spawn(sys.executable, command, os.environ | {"PYTHONPATH": path}, file_actions=nowhere)
        )


def main() -> None:
    """Compiles, from the last to the first."""
    scenario = Scenario.from_dict(SCENARIO)
    relays = {"R": Relay(RelaySettings.from_dict(SETTINGS), name="R")}
    loop = ClosedLoop(scenario, relays, Recorder([]), Transport.alone(scenario.can))
    loop.compile(backwards=True)


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        main()
