"""A breaker of your own in thirty lines, with faultloop's frames and rules.

    faultloop run scenarios/ag-zone1.toml --can socketcan:vcan0 --pace 0.25 --without QA &
    python examples/breaker_in_30_lines.py socketcan vcan0 0.25

my_breaker.py is one without faultloop's code.
"""

import sys
import time

import can

from faultloop.io.can.frames import State, decode
from faultloop.io.can.table import TICK_NS, Kind
from faultloop.io.can.transport import from_message, to_message
from faultloop.nodes.goose import Publisher, Subscriber


class Breaker:
    def __init__(self, bus, number=0, relay=0, operate_ms=30, pace=1.0):
        self.bus, self.relay, self.operate_ns, self.pace = bus, relay, operate_ms * 1_000_000, pace
        self.trip = Subscriber(max_age_ns=None)  # no common clock: it goes by the frames' own time
        self.status = Publisher(Kind.BREAKER_STATUS, number, poles=7)
        self.zero, self.opens = None, None

    def step(self):
        message = self.bus.recv(0.001)
        state = None if message is None else decode(from_message(message))
        now = time.monotonic_ns() * self.pace
        if isinstance(state, State) and (state.kind, state.number) == (Kind.TRIP, self.relay):
            taken = self.trip.receive(state, state.time * TICK_NS)
            if taken is True or taken is False:  # else it is a Rejection
                self.zero = now - state.time * TICK_NS
            if taken is True and state.poles:
                self.opens = (now + self.operate_ns, state.poles)
        if self.opens is not None and now >= self.opens[0]:
            self.status.set(self.status.poles & ~self.opens[1], int(now - self.zero))
            self.opens = None
        if self.zero is not None and (frame := self.status.poll(int(now - self.zero))):
            self.bus.send(to_message(frame, 0))


if __name__ == "__main__":
    with can.Bus(sys.argv[2], interface=sys.argv[1]) as bus:
        breaker = Breaker(bus, pace=float(sys.argv[3]))
        while True:
            breaker.step()
