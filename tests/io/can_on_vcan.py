"""Frames over the kernel's own CAN: run by test_can_socketcan.py where vcan0 and vcan1 are."""

from __future__ import annotations

import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import can
import pytest

import faultloop
from faultloop.errors import InputError
from faultloop.io.can.bus import SimulatedBus
from faultloop.io.can.frames import Frame, SampledValues, State, decode
from faultloop.io.can.table import Kind
from faultloop.io.can.transport import open_bus, open_transport

SETTINGS = SimpleNamespace(
    interface="socketcan", channel="vcan0", bitrate=500_000, data_bitrate=2_000_000, fd=True
)
TRIP = State(Kind.TRIP, 3, 7, 1, 0, 0, 1000)
SAMPLE = SampledValues(3, 17, (1.0, -2.0, 3.0, 4.0, -5.0, 6.0))


def ip_link(*words: str) -> None:
    subprocess.run(["ip", "link", "set", "dev", *words], check=True)


@pytest.fixture
def second_interface() -> Iterator[str]:
    """vcan1, put back as it was."""
    yield "vcan1"
    ip_link("vcan1", "down")
    ip_link("vcan1", "mtu", "72", "up")


def test_frames_travel_over_the_kernel():
    with open_transport(SETTINGS) as bus, open_bus("socketcan", "vcan0", fd=True) as listener:
        bus.submit(0, SAMPLE.encode(), "plant")
        bus.submit(0, TRIP.encode(), "R3")
        delivered = bus.advance(10**7)
        messages = [listener.recv(2), listener.recv(2)]
        assert listener.recv(0) is None
    alone = SimulatedBus(500_000)
    alone.submit(0, SAMPLE.encode(), "plant")
    alone.submit(0, TRIP.encode(), "R3")
    assert delivered == alone.advance(10**7)  # the same times as without a kernel
    for message, sent in zip(messages, (TRIP, SAMPLE), strict=True):  # in order of priority
        assert message is not None
        frame = Frame(
            message.arbitration_id, bytes(message.data), False, message.is_fd, message.bitrate_switch
        )
        assert frame == sent.encode()
        assert decode(frame) == sent


def test_a_thousand_frames_and_none_lost():
    with open_transport(SETTINGS) as bus, open_bus("socketcan", "vcan0", fd=True) as listener:
        got = []
        for n in range(1000):
            bus.submit(n * 300_000, Frame(0x100, n.to_bytes(8, "little")), "B")
            bus.advance((n + 1) * 300_000)
            if n % 50 == 49:
                got += [int.from_bytes(listener.recv(2).data, "little") for _ in range(50)]
        assert got == list(range(1000))


def test_a_closed_loop_over_the_kernel():
    """The same decisions, at the same times, as on the in-process bus; and the frames are on vcan0."""
    scenario = Path(__file__).resolve().parents[2] / "scenarios" / "ag-zone1.toml"
    with open_bus("socketcan", "vcan0") as listener:
        real = faultloop.run(scenario, can="socketcan:vcan0")
        states = []
        while (message := listener.recv(0)) is not None:
            frame = Frame(message.arbitration_id, bytes(message.data))
            decoded = decode(frame)
            states += [decoded] if isinstance(decoded, State) else []
    simulated = faultloop.run(scenario)
    assert real.trips == simulated.trips
    assert real.held
    tripped = {s.number for s in states if s.kind == Kind.TRIP and s.poles == 7}
    opened = {s.number for s in states if s.kind == Kind.BREAKER_STATUS and s.poles == 0}
    assert tripped == opened == {0, 1}


@pytest.mark.skipif(shutil.which("cansend") is None, reason="no can-utils")
def test_can_utils_on_the_same_bus(tmp_path):
    log = tmp_path / "candump.log"
    with log.open("wb") as file:
        dump = subprocess.Popen(["candump", "-L", "vcan0"], stdout=file)
        try:
            with open_transport(SETTINGS) as bus:
                deliveries = []
                for _ in range(100):  # until candump is there and listens
                    subprocess.run(["cansend", "vcan0", "7FF#0102"], check=True)
                    deliveries += bus.advance(bus.model.now_ns + 10**6)
                    if b"7FF#0102" in log.read_bytes():
                        break
                deliveries += bus.advance(bus.model.now_ns + 10**6)  # a frame comes after it is found
                assert deliveries and {d.frame for d in deliveries} == {Frame(0x7FF, b"\x01\x02")}
                assert {d.sender for d in deliveries} == {"external"}
                bus.submit(bus.model.now_ns, TRIP.encode(), "R3")
                bus.advance(bus.model.now_ns + 10**6)
                expected = f"013#{TRIP.encode().data.hex().upper()}".encode()
                for _ in range(100):
                    if expected in log.read_bytes():
                        break
                    subprocess.run(["sleep", "0.02"], check=True)
                assert expected in log.read_bytes()
        finally:
            dump.terminate()
            dump.wait()


def test_an_interface_that_is_down(second_interface):
    ip_link(second_interface, "down")
    with pytest.raises(InputError, match="is down: ip link set vcan1 up"):
        open_bus("socketcan", second_interface)


def test_an_interface_that_goes_down(second_interface):
    with open_transport(SETTINGS, f"socketcan:{second_interface}") as bus:
        ip_link(second_interface, "down")
        bus.submit(0, TRIP.encode(), "R3")
        with pytest.raises(InputError, match="is down"):
            bus.advance(10**7)


def test_an_interface_without_fd(second_interface):
    ip_link(second_interface, "down")
    ip_link(second_interface, "mtu", "16", "up")
    with pytest.raises(InputError, match="carries no CAN FD: ip link set vcan1 mtu 72"):
        open_bus("socketcan", second_interface, fd=True)
    open_bus("socketcan", second_interface).shutdown()


def test_a_wrong_channel():
    with pytest.raises(InputError, match=r"vcan00: no CAN interface of this name: did you mean 'vcan0'\?"):
        open_bus("socketcan", "vcan00")
    assert not Path("/sys/class/net/vcan00").exists()


def test_remote_frames_are_ignored():
    with open_transport(SETTINGS) as bus, open_bus("socketcan", "vcan0") as other:
        other.send(can.Message(arbitration_id=0x20, is_remote_frame=True, is_extended_id=False))
        for _ in range(200):  # the kernel delivers when it does
            assert bus.advance(10**7) == []
            if bus.ignored:
                break
            time.sleep(0.01)
        assert bus.ignored == 1
