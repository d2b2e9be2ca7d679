"""A breaker of your own on faultloop's bus, with python-can, cantools, autosar-e2e and the shipped DBC.

    faultloop run scenarios/ag-zone1.toml --can socketcan:vcan0 --pace 0.25 --without QA &
    python examples/my_breaker.py socketcan vcan0 --pace 0.25

It opens 30 ms after the first good trip frame of relay 0, and publishes its position, repeated as GOOSE does.
"""

import argparse
import time

import can
import cantools
from e2e import p01

from faultloop.io.can.dbc import DBC_PATH  # where the DBC is: nothing else of faultloop


class MyBreaker:
    """Breaker `number`, tripped by `relay`; `pace` is the run's: its seconds in one of wall time."""

    def __init__(self, bus, number=0, relay=0, operate_s=0.03, pace=1.0):
        dbc = cantools.database.load_file(DBC_PATH)
        self.trip = dbc.get_message_by_name(f"TRIP_{relay:02}")
        self.status = dbc.get_message_by_name(f"BREAKER_STATUS_{number:02}")
        self.bus, self.operate_s, self.pace = bus, operate_s, pace
        self.closed, self.st_num, self.sq_num, self.counter = {"a", "b", "c"}, 1, 0, 0
        self.last = self.opens = None  # the trip frame accepted last; when which poles open
        self.heard_at = self.due = self.clock = 0.0  # when that was; when the next status is due

    def now(self):
        """The run's time, as last heard on the bus and gone on since; never back."""
        since = (time.monotonic() - self.heard_at) * self.pace
        self.clock = max(self.clock, self.last["time"] + since)
        return self.clock

    def receive(self, message):
        """Take a frame: only a good and new one of the relay's counts; act on each state once."""
        data, last = bytearray(message.data), self.last
        if (message.arbitration_id, message.is_extended_id, len(data)) != (self.trip.frame_id, False, 8):
            return
        frame = self.trip.decode(data)
        order = ("time", "st_num", "sq_num")
        late = last and [frame[k] for k in order] <= [last[k] for k in order]
        repeated = last and frame["counter"] == last["counter"]
        if not p01.e2e_p01_check(data, self.trip.frame_id) or frame["test"] or late or repeated:
            return
        self.last, self.heard_at = frame, time.monotonic()
        poles = {pole for pole in "abc" if frame[f"pole_{pole}"]}
        if poles and (last is None or frame["st_num"] != last["st_num"]):
            self.opens = (self.now() + self.operate_s, poles)

    def poll(self):
        """Open when it is time, and publish what is due."""
        if self.last is None:
            return
        if self.opens and self.now() >= self.opens[0]:
            self.closed, self.opens = self.closed - self.opens[1], None
            self.st_num, self.sq_num, self.due = (self.st_num + 1) % 256, 0, self.clock
        if self.now() >= self.due:
            poles = {f"pole_{pole}": pole in self.closed for pole in "abc"}
            numbers = {"st_num": self.st_num, "sq_num": self.sq_num, "counter": self.counter}
            fields = {"crc": 0, "test": 0, "time": self.now()} | numbers | poles
            data = bytearray(self.status.encode(fields))
            p01.e2e_p01_protect(data, self.status.frame_id)  # the next counter, and the CRC
            self.bus.send(can.Message(arbitration_id=self.status.frame_id, data=data, is_extended_id=False))
            self.due = self.now() + min(0.002 * 2**self.sq_num, 1.0)
            self.sq_num, self.counter = self.sq_num % 255 + 1, (self.counter + 1) % 15

    def step(self):
        """Wait for a frame, a millisecond at most."""
        message = self.bus.recv(0.001)
        if message is not None:
            self.receive(message)
        self.poll()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="A breaker on faultloop's bus.")
    parser.add_argument("interface")
    parser.add_argument("channel")
    parser.add_argument("--pace", type=float, default=1.0)
    arguments = parser.parse_args()
    with can.Bus(arguments.channel, interface=arguments.interface) as bus:
        breaker = MyBreaker(bus, pace=arguments.pace)
        print("my breaker is on the bus", flush=True)
        while True:
            breaker.step()
