"""python-can's in-process bus beside the model, errors, and logs that python-can reads back."""

from __future__ import annotations

from types import SimpleNamespace

import can
import pytest

from faultloop.errors import InputError
from faultloop.io.can import transport
from faultloop.io.can.bus import SimulatedBus
from faultloop.io.can.frames import Frame, State
from faultloop.io.can.log import LoggedFrame, write_can_log
from faultloop.io.can.table import Kind
from faultloop.io.can.transport import Transport, open_bus, open_transport, to_message

EPOCH_NS = 1_577_836_800_000_000_000  # 2020-01-01
TRIP = State(Kind.TRIP, 0, 7, 1, 0, 0, 1000).encode()


def settings(**changes) -> SimpleNamespace:
    table = {
        "interface": "virtual", "channel": "faultloop", "fd": False,
        "bitrate": 500_000, "data_bitrate": 2_000_000,
    }  # fmt: skip
    return SimpleNamespace(**(table | changes))


@pytest.fixture
def channel(request) -> str:
    return request.node.name


def test_others_see_every_frame_with_its_simulated_time(channel):
    with (
        open_transport(settings(channel=channel), start_ns=EPOCH_NS) as bus,
        open_bus(channel=channel) as listener,
    ):
        bus.submit(10_000_000, TRIP, "R1")
        assert bus.pending() == [TRIP]
        assert bus.advance(10_000_000) == []
        due = bus.next_event_ns()
        assert due is not None
        assert bus.advance(due) == [(due, TRIP, "R1")]
        message = listener.recv(0)
        assert message is not None and message.arbitration_id == TRIP.id and bytes(message.data) == TRIP.data
        assert message.timestamp == pytest.approx((EPOCH_NS + due) / 1e9, abs=1e-6)
        assert listener.recv(0) is None
        assert bus.load(due) > 0.9 * (due - 10_000_000) / due
        assert bus.statistics.frames == {TRIP.id: 1}


def test_frames_of_others_go_through_the_model(channel):
    with open_transport(settings(channel=channel)) as bus, open_bus(channel=channel) as other:
        other.send(can.Message(arbitration_id=0x20, data=b"\x01\x02", is_extended_id=False))
        other.send(can.Message(arbitration_id=0x20, is_remote_frame=True, is_extended_id=False))
        other.send(can.Message(arbitration_id=0x20, is_fd=True, data=bytes(12), is_extended_id=False))
        assert bus.advance(5_000_000) == []  # what is found now cannot have arrived before now
        (delivery,) = bus.advance(10_000_000)
        assert delivery.frame == Frame(0x20, b"\x01\x02") and delivery.sender == "external"
        model = SimulatedBus()
        model.submit(5_000_000, delivery.frame)
        assert delivery.t_ns == model.next_event_ns()
        assert bus.ignored == 2
        assert other.recv(0) is None  # it is not shown its own frame again


def test_same_times_with_and_without_a_python_can_bus(channel):
    alone = Transport(SimulatedBus(500_000))
    with open_transport(settings(channel=channel)) as shown, open_bus(channel=channel):
        for bus in (alone, shown):
            for n in range(20):
                bus.submit(0, Frame(0x700 - n, bytes([n] * 8)), n)
        assert alone.advance(10**8) == shown.advance(10**8)


def test_fd_frames(channel):
    frame = Frame(0x180, bytes(range(32)), fd=True, brs=True)
    with (
        open_transport(settings(channel=channel, fd=True)) as bus,
        open_bus(channel=channel, fd=True) as listener,
    ):
        bus.submit(0, frame)
        bus.advance(10**9)
        message = listener.recv(0)
        assert message is not None and message.is_fd and message.bitrate_switch and message.dlc == 32
    with (
        open_transport(settings(channel=channel)) as classic,
        pytest.raises(InputError, match="set fd = true"),
    ):
        classic.submit(0, frame)


@pytest.mark.parametrize(
    ("interface", "name", "words"),
    [
        ("virtul", "x", "did you mean 'virtual'"),
        ("socketcan", "nosuchcan9", "nosuchcan9"),
        ("slcan", "/dev/nosuchport", "cannot open"),
        ("serial", "/dev/nosuchport", "cannot open"),
    ],
)
def test_wrong_interface_or_channel(interface, name, words):
    with pytest.raises(InputError, match=words) as caught:
        open_bus(interface, name)
    assert "\n" not in str(caught.value)


def test_wrong_channel_argument():
    for text in ("vcan0", "socketcan:", ":vcan0"):
        with pytest.raises(InputError, match="INTERFACE:CHANNEL"):
            open_transport(settings(), text)


FRAMES = [
    LoggedFrame(EPOCH_NS + 5_004_000_000, TRIP, True),
    LoggedFrame(EPOCH_NS + 5_004_250_000, Frame(0x1ABCDEF0, b"\x01\x02\x03", extended=True), False),
    LoggedFrame(EPOCH_NS + 5_005_000_000, Frame(0x180, bytes(range(32)), fd=True, brs=True), True),
    LoggedFrame(EPOCH_NS + 6_005_000_000, Frame(0x181, bytes(range(64)), fd=True), False),
    LoggedFrame(EPOCH_NS + 7_005_000_000, Frame(0x7FF, b""), False),
]


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log"])
def test_logs_are_read_back(tmp_path, suffix):
    path = write_can_log(tmp_path / f"frames{suffix}", FRAMES)
    with can.LogReader(path, relative_timestamp=False) as reader:
        messages = list(reader)
    assert len(messages) == len(FRAMES)
    for message, logged in zip(messages, FRAMES, strict=True):
        expected = to_message(logged.frame, logged.t_ns, is_rx=not logged.sent, channel=message.channel)
        assert expected.equals(message, timestamp_delta=2e-6, check_channel=False, check_direction=True)
    again = write_can_log(tmp_path / f"again{suffix}", FRAMES)
    assert again.read_bytes() == path.read_bytes()
    assert {p.name for p in tmp_path.iterdir()} == {path.name, again.name}


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log"])
def test_an_empty_log(tmp_path, suffix):
    with can.LogReader(write_can_log(tmp_path / f"none{suffix}", [])) as reader:
        assert list(reader) == []


def test_logs_that_cannot_be_written(tmp_path):
    with pytest.raises(InputError, match=r"\.blf, \.asc, \.log"):
        write_can_log(tmp_path / "frames.txt", FRAMES)
    with pytest.raises(InputError, match="cannot be written"):
        write_can_log(tmp_path / "nowhere" / "frames.blf", FRAMES)

    def breaks():
        yield FRAMES[0]
        raise RuntimeError("interrupted")

    with pytest.raises(RuntimeError):
        write_can_log(tmp_path / "frames.blf", breaks())
    assert list(tmp_path.iterdir()) == []


CONTROLLER = """[{"ifname":"can0","linkinfo":{"info_kind":"can","info_data":{"state":"ERROR-ACTIVE",
"bittiming":{"bitrate":250000,"sample_point":"0.875"},"data_bittiming":{"bitrate":2000000}}}}]"""


def test_a_controller_at_another_bit_rate(monkeypatch, tmp_path):
    """What iproute2 prints of a controller; a virtual interface has neither a device nor a bit rate."""
    assert transport.bit_rates(CONTROLLER) == (250_000, 2_000_000)
    assert transport.bit_rates('[{"linkinfo":{"info_kind":"vcan"}}]') == (None, None)
    assert transport.bit_rates("") == (None, None)
    transport.check_bit_rates("vcan0", 500_000)
    monkeypatch.setattr(transport, "_told_by_ip", lambda channel: CONTROLLER)
    monkeypatch.setattr(transport, "Path", lambda *_: tmp_path)
    (tmp_path / "can0" / "device").mkdir(parents=True)
    transport.check_bit_rates("can0", 250_000, 2_000_000)
    with pytest.raises(InputError, match=r"can0: runs at 250000 bit/s, and \[can\] bitrate is 500000"):
        transport.check_bit_rates("can0", 500_000)
    with pytest.raises(InputError, match="dbitrate 4000000"):
        transport.check_bit_rates("can0", 250_000, 4_000_000)
