"""What a CAN frame costs: encode and decode beside cantools, its length, the model of the bus, python-can.

    python bench/can_frames.py

Prints microseconds per frame (the least of some runs) and, for the codecs, the ratio to cantools' time.
"""

from __future__ import annotations

import timeit
from collections.abc import Callable

from faultloop.io.can.bus import SimulatedBus
from faultloop.io.can.dbc import database
from faultloop.io.can.frames import Measurements, Message, Page, SampledValues, State, decode
from faultloop.io.can.goose import Publisher, Subscriber
from faultloop.io.can.length import wire_length
from faultloop.io.can.table import Kind
from faultloop.io.can.transport import Transport, open_bus

NUMBER = 5000
REPEAT = 7
MS = 1_000_000


def cost_us(call: Callable[[], object]) -> float:
    """Time of a call [us]: the least of several runs, which other work on the machine disturbs least."""
    return min(timeit.repeat(call, number=NUMBER, repeat=REPEAT)) / NUMBER * 1e6


def codecs() -> None:
    messages: dict[str, Message] = {
        "trip": State(Kind.TRIP, 1, 7, 3, 0, 5, 123_456),
        "sampled values": SampledValues(1, 4800, (1e5, -5e4, -5e4, 1e3, -5e2, -5e2)),
        "measurements": Measurements(1, Page.VOLTAGE, (63_500.0, 63_400.0, 63_600.0)),
    }
    heading = ("encode", "cantools", "ratio", "decode", "cantools", "ratio")
    print(f"{'us per frame':24}" + "".join(f"{word:>9}" for word in heading))
    for name, message in messages.items():
        frame = message.encode()
        other = database().get_message_by_frame_id(frame.id)
        signals = other.decode(frame.data, decode_choices=False)
        # cantools packs the signals; it does not compute the CRC, which our encode and decode do.
        encode, decoded = cost_us(message.encode), cost_us(lambda frame=frame: decode(frame))
        their_encode = cost_us(lambda other=other, signals=signals: other.encode(signals))
        their_decode = cost_us(lambda other=other, frame=frame: other.decode(frame.data))
        row = (encode, their_encode, encode / their_encode, decoded, their_decode, decoded / their_decode)
        print(f"{name:24}" + "".join(f"{value:9.2f}" for value in row))


def bus() -> None:
    trip = State(Kind.TRIP, 1, 7, 3, 0, 5, 123_456).encode()
    sample = SampledValues(1, 4800, (1e5, -5e4, -5e4, 1e3, -5e2, -5e2)).encode()
    print(f"\n{'us per frame':48}")
    print(f"{'exact length, classic 8 bytes':48} {cost_us(lambda: wire_length(trip)):8.2f}")
    print(f"{'exact length, FD 32 bytes':48} {cost_us(lambda: wire_length(sample)):8.2f}")
    model = SimulatedBus()

    def through_the_model() -> None:
        model.submit(model.now_ns, trip, "R1")
        model.advance(model.now_ns + MS)

    print(f"{'model: submit and advance':48} {cost_us(through_the_model):8.2f}")
    with (
        open_bus(channel="bench") as listener,
        Transport(SimulatedBus(), open_bus(channel="bench")) as transport,
    ):

        def over_python_can() -> None:
            transport.submit(transport.model.now_ns, trip, "R1")
            transport.advance(transport.model.now_ns + MS)
            listener.recv(0)

        print(f"{'the same, shown on a virtual bus, and received':48} {cost_us(over_python_can):8.2f}")


def repetition() -> None:
    publisher, subscriber = Publisher(Kind.TRIP, 1), Subscriber()

    def one() -> None:
        t_ns = publisher.next_ns
        frame = publisher.poll(t_ns)
        message = decode(frame) if frame is not None else None
        if isinstance(message, State):
            subscriber.receive(message, t_ns)

    print(f"{'publish, decode and accept a repetition':48} {cost_us(one):8.2f}")


if __name__ == "__main__":
    codecs()
    bus()
    repetition()
