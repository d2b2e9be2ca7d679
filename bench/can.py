"""What a CAN frame costs, and how fast a trip gets from the sample to the breaker in real time.

    python bench/can.py [--reaction N] [--processes N]

Costs in microseconds per frame (the least of some runs), beside cantools and python-can in the same run:
encode and decode, the model of the bus, the whole way encode - send - receive - decode on python-can's
virtual bus and on vcan0.  Then percentiles of the reaction in real time [ms of wall time], over N runs (20)
with two trips each: from the instant at which a trip's sample is there to the instant at which a listener has
its frame; and the same between processes, over N runs (0) at pace 1 and 0.1.  Where this machine has no
vcan0, that part is done in the guest of tests/with-vcan, whose kernel is an ordinary program and slow.
"""

# ruff: noqa: E402
from __future__ import annotations

import sys

del sys.path[0]  # this folder, where this file's name would hide python-can

import argparse
import shutil
import subprocess
import tempfile
import threading
import time
import timeit
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import faultloop
from faultloop.errors import InputError
from faultloop.io.can.bus import SimulatedBus
from faultloop.io.can.dbc import database
from faultloop.io.can.frames import Frame, Measurements, Message, Page, SampledValues, State, decode
from faultloop.io.can.length import wire_length
from faultloop.io.can.table import Kind
from faultloop.io.can.transport import Transport, from_message, open_bus, to_message
from faultloop.loop.scenario import load_scenario
from faultloop.nodes.goose import Publisher, Subscriber

ROOT = Path(__file__).resolve().parents[1]
AG = ROOT / "scenarios" / "ag-zone1.toml"
SHORT = ["scenario.duration_s=0.06", "fault.F1.after_s=0.01"]  # both relays trip within it
NUMBER = 2000
REPEAT = 7
MS = 1_000_000
TRIP = State(Kind.TRIP, 1, 7, 3, 0, 5, 123_456)
SAMPLE = SampledValues(1, 4800, (1e5, -5e4, -5e4, 1e3, -5e2, -5e2))


def cost_us(call: Callable[[], object], number: int = NUMBER) -> float:
    """Time of a call [us]: the least of several runs, which other work on the machine disturbs least."""
    return min(timeit.repeat(call, number=number, repeat=REPEAT)) / number * 1e6


def row(what: str, *values: float) -> None:
    print(f"{what:56}" + "".join(f"{value:9.2f}" for value in values), flush=True)


def codecs() -> None:
    messages: dict[str, Message] = {
        "trip": TRIP,
        "sampled values": SAMPLE,
        "measurements": Measurements(1, Page.VOLTAGE, (63_500.0, 63_400.0, 63_600.0)),
    }
    heading = ("encode", "cantools", "ratio", "decode", "cantools", "ratio")
    print(f"{'us per frame':56}" + "".join(f"{word:>9}" for word in heading))
    for name, message in messages.items():
        frame = message.encode()
        other = database().get_message_by_frame_id(frame.id)
        signals = other.decode(frame.data, decode_choices=False)
        # cantools packs the signals; it does not compute the CRC, which our encode and decode do.
        encode, decoded = cost_us(message.encode), cost_us(lambda frame=frame: decode(frame))
        their_encode = cost_us(lambda other=other, signals=signals: other.encode(signals))
        their_decode = cost_us(lambda other=other, frame=frame: other.decode(frame.data))
        row(name, encode, their_encode, encode / their_encode, decoded, their_decode, decoded / their_decode)


def model() -> None:
    trip, sample = TRIP.encode(), SAMPLE.encode()
    print(f"\n{'us per frame':56}")
    row("exact length, classic 8 bytes", cost_us(lambda: wire_length(trip)))
    row("exact length, FD 32 bytes", cost_us(lambda: wire_length(sample)))
    bus = SimulatedBus()

    def through_the_model() -> None:
        bus.submit(bus.now_ns, trip, "R1")
        bus.advance(bus.now_ns + MS)

    row("model: submit and advance", cost_us(through_the_model))
    listener, transport = open_bus(channel="bench"), Transport(SimulatedBus(), open_bus(channel="bench"))
    with listener, transport:

        def over_python_can() -> None:
            transport.submit(transport.model.now_ns, trip, "R1")
            transport.advance(transport.model.now_ns + MS)
            listener.recv(0)

        row("the same, shown on a virtual bus, and received", cost_us(over_python_can))
    publisher, subscriber = Publisher(Kind.TRIP, 1), Subscriber()

    def repetition() -> None:
        t_ns = publisher.next_ns
        frame = publisher.poll(t_ns)
        message = decode(frame) if frame is not None else None
        if isinstance(message, State):
            subscriber.receive(message, t_ns)

    row("publish, decode and accept a repetition", cost_us(repetition))


def whole_way(interface: str, channel: str) -> None:
    """Encode, send, receive, decode: one frame at a time, one process."""
    print(f"\n{f'us per frame, encode - send - receive - decode, {interface}':56}{'ours':>9}{'cantools':>9}")
    with open_bus(interface, channel, fd=True) as sender, open_bus(interface, channel, fd=True) as receiver:
        for name, message in (("trip", TRIP), ("sampled values", SAMPLE)):
            frame = message.encode()
            other = database().get_message_by_frame_id(frame.id)
            signals = other.decode(frame.data, decode_choices=False)

            def ours(message: Message = message) -> None:
                sender.send(to_message(message.encode(), 0))
                decode(from_message(_received(receiver)))

            def theirs(frame: Frame = frame, other: Any = other, signals: Any = signals) -> None:
                sender.send(to_message(frame._replace(data=other.encode(signals)), 0))
                other.decode(_received(receiver).data)

            row(f"{name}, python-can", cost_us(ours, 500), cost_us(theirs, 500))
    if interface == "socketcan":
        raw_socket(f"{interface}:{channel}")


def _received(bus: Any) -> Any:
    message = bus.recv(1)
    assert message is not None
    return message


def raw_socket(channel: str) -> None:
    """The same by the processes' own socket."""
    from faultloop.io.can.socketcan import open_link

    sender, receiver = open_link(channel, fd=True), open_link(channel, fd=True)
    for name, message in (("trip", TRIP), ("sampled values", SAMPLE)):

        def ours(message: Message = message) -> None:
            sender.send(message.encode())
            decode(receiver.receive(1)[0][1])

        row(f"{name}, the nodes' own socket", cost_us(ours, 500))
    sender.close()
    receiver.close()


class Arrivals:
    """When each relay's newest samples were there, and when a listener had its first trip frame."""

    def __init__(self, relays: list[str]) -> None:
        self.relays = relays
        self.sampled: dict[str, list[tuple[int, int]]] = {name: [] for name in relays}
        self.tripped: dict[str, int] = {}

    # a sink, as `run` takes it
    def add_relay(self, *_: object) -> None: ...
    def message(self, *_: object, **__: object) -> None: ...
    def close(self) -> None: ...
    def abort(self) -> None: ...

    def relay_block(self, name: str, t_ns: np.ndarray, *_: np.ndarray) -> None:
        self.sampled[name].append((int(t_ns[-1]), time.monotonic_ns()))

    def listen(self, bus: Any, ended: threading.Event) -> None:
        while not ended.is_set():
            message = bus.recv(0.05)
            at_ns = time.monotonic_ns()
            state = None if message is None else decode(from_message(message))
            if isinstance(state, State) and state.kind == Kind.TRIP and state.poles:
                self.tripped.setdefault(self.relays[state.number], at_ns)

    def reaction_ns(self, relay: str, decided_ns: int) -> int:
        """From the instant at which the sample of the decision was there."""
        at_ns = next(at for last_ns, at in self.sampled[relay] if last_ns >= decided_ns)
        return self.tripped[relay] - at_ns


def reaction(can: str, runs: int) -> None:
    """In one process: the relay in its thread, the breaker a listener in another."""
    scenario = load_scenario(AG, SHORT)
    faultloop.run(scenario)  # compiles
    found, missed, samples = [], 0, 0
    for _ in range(runs):
        arrivals, ended = Arrivals([place.name for place in scenario.relay]), threading.Event()
        with open_bus(*can.split(":")) as bus:
            listener = threading.Thread(target=arrivals.listen, args=(bus, ended))
            listener.start()
            result = faultloop.run(scenario, can=can, pace=1.0, sinks=[arrivals], keep=False)
            time.sleep(0.02)
            ended.set()
            listener.join()
        found += [arrivals.reaction_ns(trip.relay, trip.t_ns) for trip in result.trips]
        if result.pacing is not None:
            missed, samples = missed + result.pacing.missed, samples + result.pacing.samples
    told = ", ".join(f"p{p} {np.percentile(found, p) / 1e6:.2f}" for p in (50, 90, 99, 100))
    where = f"{can.partition(':')[0]}, one process, {len(found)} trips"
    late = f"; {missed} of {samples} samples came after the next was due" if samples else ""
    print(f"reaction, {where}: {told} ms{late}", flush=True)


def processes(runs: int, pace: float) -> None:
    """Plant, relays and breakers as processes."""
    from faultloop.live.supervisor import run_processes

    with tempfile.TemporaryDirectory() as folder:
        for n in range(runs):
            try:
                log = Path(folder) / f"{n}.mcap"
                result = run_processes(
                    AG, can="socketcan:vcan0", pace=pace, log=log, overrides=["can.fd=true"]
                )
            except InputError as error:
                print(f"processes, pace {pace:g}: {error}")
                return
            assert result.pacing is not None
            late = f"{result.pacing.missed} of {result.pacing.samples} samples came after the next was due"
            print(f"reaction, processes, pace {pace:g}: {result.pacing.reaction}; {late}", flush=True)


def on_vcan(options: argparse.Namespace) -> None:
    whole_way("socketcan", "vcan0")
    reaction("socketcan:vcan0", options.reaction)
    for pace in (1.0, 0.1):
        processes(options.processes, pace)


def main() -> None:
    parser = argparse.ArgumentParser(description="What a CAN frame costs.")
    parser.add_argument("--reaction", type=int, default=20)
    parser.add_argument("--processes", type=int, default=0)
    parser.add_argument("--only-vcan", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.only_vcan:
        on_vcan(options)
        return
    codecs()
    model()
    whole_way("virtual", "bench")
    reaction("virtual:bench", options.reaction)
    if Path("/sys/class/net/vcan0").is_dir():
        on_vcan(options)
    elif shutil.which("linux.uml"):
        print("\nno vcan0 here: in the guest")
        guest = [sys.executable, ROOT / "tests" / "with-vcan", sys.executable, *sys.argv, "--only-vcan"]
        subprocess.run(guest, check=True)
    else:
        print("\nno vcan0, and no guest for one: apt-get install user-mode-linux iproute2")


if __name__ == "__main__":
    main()
