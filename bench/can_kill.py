"""kill -9 of any node at any time.

    python bench/can_kill.py [--trials 200] [--pace 0.1] [--fault-s 24] [--can socketcan:vcan0] [--seed 1]

A healthy line, its plant, two relays and two breakers as processes.  At random times a random one of them is
killed, now and then once more while it starts again.  After each trial it must take part again: heartbeat,
and samples (plant), valid measurements (relay), position (breaker).  Meanwhile nothing may trip, and nobody
else may end.  Each killed process's log is recovered, a relay's up to half a second before.  Every run ends
with a fault (at --fault-s of its own time), which both ends must clear.  Where this machine has no vcan0, it
runs in the guest of tests/with-vcan.  Exit status 1 where a trial failed.
"""

# ruff: noqa: E402
from __future__ import annotations

import argparse
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[0] = str(ROOT)  # and not this folder, whose can.py is not python-can

import numpy as np

from faultloop.io.can.frames import Frame, Measurements, Page, State, decode
from faultloop.io.can.table import PLANT_NODE, RELAYS, Kind
from faultloop.io.mcap_reader import open_log
from faultloop.live.merge import merge
from faultloop.live.supervisor import PLANT, Supervisor
from faultloop.loop.outcome import Cast, outcome_of
from faultloop.loop.scenario import Scenario, load_scenario

SETTLED_S = 1.5
"""Of run time between the last trial and the fault."""
KEPT_UP_TO_S = 0.5
"""A killed relay's log is there up to so long before its end: the writer writes every 0.25 s of run time."""
REJOIN_WITHIN_S = 60.0  # of wall time


def write_scenario(folder: Path, fault_s: float) -> Path:
    """scenarios/ag-zone1.toml with a long healthy time before its fault, and quick heartbeats."""
    text = (ROOT / "scenarios" / "ag-zone1.toml").read_text(encoding="utf-8")
    text = text.replace("duration_s = 0.4", f"duration_s = {fault_s + 0.3:g}")
    text = text.replace("after_s = 0.1", f"after_s = {fault_s:g}")
    settings = (ROOT / "scenarios" / "settings").as_posix()
    text = text.replace('"settings/', f'"{settings}/') + "\n[can]\nheartbeat_s = 0.1\n"
    path = folder / "healthy.toml"
    path.write_text(text, encoding="utf-8")
    return path


class Watch:
    """What is heard on the bus."""

    def __init__(self, scenario: Scenario) -> None:
        self.nominal_v = scenario.system.base_kv * 1e3 / 3**0.5
        self.trips = 0
        self.openings = 0
        self.heard: set[tuple[str, int]] = set()
        """Kind of sign of life, and whose, since `forget`."""

    def forget(self) -> None:
        self.heard.clear()

    def take(self, frame: Frame) -> None:
        kind, number = frame.id & ~0xF, frame.id & 0xF
        if frame.id >= Kind.HEARTBEAT:
            self.heard.add(("heartbeat", frame.id - Kind.HEARTBEAT))
            return
        if kind == Kind.SAMPLED_VALUES:
            self.heard.add(("samples", number))
            return
        message = decode(frame)
        if isinstance(message, Measurements):
            healthy = all(abs(v / self.nominal_v - 1) < 0.1 for v in message.values)
            if message.page is Page.VOLTAGE and healthy:
                self.heard.add(("measured", number))
        elif isinstance(message, State):
            self.trips += kind == Kind.TRIP and message.poles != 0
            if kind == Kind.BREAKER_STATUS:
                self.openings += message.poles != 7
                self.heard.add(("position", number))


def signs(scenario: Scenario, name: str) -> set[tuple[str, int]]:
    """By which signs a node is known to take part."""
    relays = [place.name for place in scenario.relay]
    breakers = [breaker.name for breaker in scenario.breaker]
    if name == PLANT:
        numbers = range(len(relays))
        return {("heartbeat", PLANT_NODE)} | {(k, i) for i in numbers for k in ("samples", "measured")}
    if name in relays:
        i = relays.index(name)
        return {("heartbeat", i), ("measured", i)}
    i = breakers.index(name)
    return {("heartbeat", RELAYS + i), ("position", i)}


class Trials:
    """One run, with as many kills as its time allows."""

    def __init__(self, path: Path, folder: Path, can: str, pace: float, source: random.Random) -> None:
        self.scenario = load_scenario(path)
        self.fault_s = self.scenario.fault[0].after_s
        self.supervisor = Supervisor(self.scenario, can, pace, (), folder)
        self.watch = Watch(self.scenario)
        self.random = source
        self.rejoined_s: dict[str, list[float]] = defaultdict(list)
        self.failures: list[str] = []
        self.again = 0
        """Kills of a node that was starting."""
        self.kills: list[tuple[str, int]] = []
        """Of nodes that took part, with the run time [ns]."""
        self.reaction_ms: list[float] = []

    def listen_until(self, done: Callable[[], bool], within_s: float) -> bool:
        until = time.monotonic() + within_s
        while not done():
            for _, frame in self.supervisor.listen(0.02):
                self.watch.take(frame)
            if time.monotonic() > until:
                return False
        return True

    def all_take_part(self) -> bool:
        wanted = {sign for name in self.supervisor.names for sign in signs(self.scenario, name)}
        return self.listen_until(lambda: wanted <= self.watch.heard, REJOIN_WITHIN_S)

    def now_s(self) -> float:
        clock = self.supervisor.clock
        assert clock is not None
        return clock.now_ns() / 1e9

    def trial(self) -> None:
        name = self.random.choice(self.supervisor.names)
        self.listen_until(lambda: False, self.random.uniform(0.0, 0.5))
        self.kills.append((name, round(self.now_s() * 1e9)))
        self._kill(name)
        if self.random.random() < 0.1:  # and once more, while it starts
            self.listen_until(lambda: False, self.random.uniform(0.0, 2.0))
            self._kill(name)
            self.again += 1
        began = self.now_s()
        self.watch.forget()
        wanted = signs(self.scenario, name)
        if not self.listen_until(lambda: wanted <= self.watch.heard, REJOIN_WITHIN_S):
            self.failures.append(f"{name}: not back: {sorted(wanted - self.watch.heard)}")
        self.rejoined_s[name].append(self.now_s() - began)
        gone = [other for other in self.supervisor.names if self.supervisor.ended(other)]
        if gone:
            self.failures.append(f"{name} killed: {gone} ended, too")
        # On a starved machine a trial can last until the fault, whose trips are as they should be.
        before_fault = self.now_s() < self.fault_s
        if before_fault and (self.watch.trips or self.watch.openings):
            self.failures.append(f"{name} killed: {self.watch.trips} trip frames, {self.watch.openings} open")
            self.watch.trips = self.watch.openings = 0

    def _kill(self, name: str) -> None:
        self.supervisor.kill(name)
        self.supervisor.restart(name)

    def run(self, trials: int) -> int:
        """Up to `trials` kills, then the fault; how many there were."""
        done = 0
        supervisor = self.supervisor
        try:
            supervisor.begin()
            if not self.all_take_part():
                self.failures.append("not all nodes took part at the beginning")
            while done < trials and self.now_s() < self.fault_s - SETTLED_S:
                self.trial()
                done += 1
            supervisor.run()
            supervisor.finish()
        finally:
            supervisor.close()
        self.check_logs()
        return done

    def check_logs(self) -> None:
        """The killed processes' logs are recovered; both ends tripped the fault, and nothing before it."""
        supervisor = self.supervisor
        assert supervisor.clock is not None
        out = supervisor.folder / "merged.mcap"
        for note in merge(supervisor.logs, out, supervisor.clock.start_ns, {}, {}):
            if "recovered" not in note and "left no log" not in note:
                self.failures.append(note)
        result = outcome_of(open_log(out), Cast.of_scenario(self.scenario))
        for place in self.scenario.relay:
            own = [trip for trip in result.trips if trip.relay == place.name]
            if not any(trip.function == "PDIS1" and trip.opened_ns is not None for trip in own):
                self.failures.append(f"{place.name} did not clear the fault")
        self.reaction_ms += [
            (trip.received_ns - trip.t_ns) / 1e6 for trip in result.trips if trip.received_ns is not None
        ]
        early = [trip for trip in result.trips if trip.t_ns < self.fault_s * 1e9]
        self.failures += [f"tripped without a fault: {trip}" for trip in early]
        log = open_log(out)
        told = [entry for entry in log.events if "ended before" in entry.message]
        self.failures += [entry.message for entry in told]
        for name, t_ns in self.kills:
            if name in log.relays:
                known = log.samples(name)["t_ns"]
                last_ns = int(known[np.searchsorted(known, t_ns) - 1])
                if t_ns - last_ns > KEPT_UP_TO_S * 1e9:
                    self.failures.append(f"{name} killed: its log ends {(t_ns - last_ns) / 1e9:.2f} s before")


def report(trials: list[Trials], count: int) -> None:
    kills = sum(len(t.kills) + t.again for t in trials)
    print(f"\n{count} trials, {kills} kills in {len(trials)} runs")
    for name in trials[0].supervisor.names:
        times = sorted(s for t in trials for s in t.rejoined_s[name])
        if times:
            print(
                f"  {name:6} {len(times):4} times; takes part again after"
                f" {times[len(times) // 2]:.2f} s of run time (median), {times[-1]:.2f} s (greatest)"
            )
    reactions = [f"{ms:.1f}" for t in trials for ms in t.reaction_ms]
    print(
        f"  decided to received by the breaker, at each run's fault [ms of run time]: {' '.join(reactions)}"
    )
    failures = [failure for t in trials for failure in t.failures]
    print(f"  {len(failures)} failures")
    for failure in failures:
        print(f"    {failure}")


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--pace", type=float, default=0.1)
    parser.add_argument("--fault-s", type=float, default=24.0)
    parser.add_argument("--can", default="socketcan:vcan0")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    if args.can == "socketcan:vcan0" and not Path("/sys/class/net/vcan0").is_dir():
        guest = [sys.executable, ROOT / "tests" / "with-vcan", sys.executable, *sys.argv]
        return subprocess.run(guest, check=False).returncode
    source = random.Random(args.seed)
    done, all_trials = 0, []
    with tempfile.TemporaryDirectory() as name:
        path = write_scenario(Path(name), args.fault_s)
        while done < args.trials:
            folder = Path(name) / f"run-{len(all_trials)}"
            trials = Trials(path, folder, args.can, args.pace, source)
            done += trials.run(args.trials - done)
            all_trials.append(trials)
            shutil.rmtree(folder)
            print(f"{done} trials, {len(trials.failures)} failures in this run", *trials.failures, flush=True)
    report(all_trials, done)
    return 1 if any(t.failures for t in all_trials) else 0


if __name__ == "__main__":
    sys.exit(main())
