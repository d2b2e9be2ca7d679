"""The monitor's counts, checks and texts, without a bus; and its wrong input."""

from __future__ import annotations

from pathlib import Path

import pytest

from faultloop.cli import call
from faultloop.errors import InputError
from faultloop.io.can.authentication import CmacSeal
from faultloop.io.can.bus import SimulatedBus
from faultloop.io.can.dbc import DBC_PATH, load_dbc, sender_name
from faultloop.io.can.frames import (
    Differential,
    Frame,
    Heartbeat,
    Measurements,
    Page,
    Rejection,
    SampledValues,
    State,
)
from faultloop.io.can.table import OPERATIONAL, Kind
from faultloop.nodes.goose import Publisher
from faultloop.nodes.monitor import BusMonitor, lost, rejections, state_of

MS = 1_000_000
DBC = """VERSION ""
BU_: ECU
BO_ 16 Door: 2 ECU
 SG_ open : 0|1@1+ (1,0) [0|1] "" ECU
 SG_ angle : 1|7@1+ (2,0) [0|254] "deg" ECU
"""


def published(monitor: BusMonitor, publisher: Publisher, until_ns: int, lose: int = -1) -> None:
    n = 0
    while publisher.next_ns <= until_ns:
        t_ns = publisher.next_ns
        frame = publisher.poll(t_ns)
        assert frame is not None
        if n != lose:
            monitor.take(t_ns, frame)
        n += 1


def test_it_counts_decodes_and_checks_states() -> None:
    monitor = BusMonitor()
    monitor.begin(0)
    trip = Publisher(Kind.TRIP, 0)
    published(monitor, trip, 100 * MS, lose=3)
    trip.set(7, 150 * MS)
    published(monitor, trip, 160 * MS)
    (row,) = monitor.sorted_rows()
    assert (row.name, row.sender) == ("TRIP_00", "RELAY_00")
    assert row.count == 6 - 1 + 3 and lost(row) == 1
    assert monitor.content(row) == "poles ABC  st 2 sq 2  t 0.15600 s"
    monitor.take(170 * MS, Frame(0x010, bytes(8)))
    monitor.take(170 * MS, Frame(0x010, bytes(3)))
    assert rejections(row) == {Rejection.CRC: 1, Rejection.LENGTH: 1}
    assert monitor.content(row).startswith("poles ABC")  # the newest good one
    assert state_of(row) == "1 wrong CRC, 1 wrong length, 1 lost"
    monitor.lap(10_000 * MS)
    assert state_of(row).endswith("silent")


def test_it_tells_what_a_line_differential_sends() -> None:
    monitor = BusMonitor()
    monitor.begin(0)
    for n, counter in enumerate((0, 1, 3)):
        currents = (100 + 0j, -50j, 3 + 4j)
        monitor.take(n * MS, Differential(1, 1_500_000, currents, counter=counter).encode())
    (row,) = monitor.sorted_rows()
    assert monitor.content(row) == "i 100.0 50.0 5.0 A  t 1.500000 s"
    assert (lost(row), state_of(row)) == (1, "1 lost")


def test_rates_and_load() -> None:
    monitor, model = BusMonitor(), SimulatedBus()
    monitor.begin(0)
    frame = Heartbeat(0, OPERATIONAL, 0, 2, 0).encode()
    for n in range(50):
        monitor.take(n * 10 * MS, frame)
        model.submit(n * 10 * MS, frame)
    model.advance(500 * MS)
    monitor.lap(500 * MS)
    (row,) = monitor.sorted_rows()
    assert row.rate_hz == pytest.approx(100)
    assert monitor.load == pytest.approx(model.load.over(500 * MS), rel=1e-6)
    assert monitor.content(row) == "operational  rejected 2  t 0.00000 s"
    monitor.lap(1000 * MS)
    assert row.rate_hz == monitor.load == 0
    monitor.whole(1000 * MS)
    assert row.rate_hz == pytest.approx(50)
    slow = BusMonitor(pace=0.5)  # the same second of the run, in two of wall time
    slow.begin(0)
    for n in range(50):
        slow.take(n * 20 * MS, frame)
    slow.lap(1000 * MS)
    assert slow.load == pytest.approx(model.load.over(500 * MS), rel=1e-6)


def test_samples_measurements_and_unknown_frames() -> None:
    monitor = BusMonitor()
    for counter in (0, 1, 4):
        values = (1e5, -5e4, -5e4, 1e3, -500.0, -500.0)
        monitor.take(0, SampledValues(1, counter, values, counter).encode())
    monitor.take(0, Measurements(0, Page.VOLTAGE, (127e3, 127e3, 127e3), 7).encode())
    monitor.take(0, Measurements(0, Page.FREQUENCY, (50.0, 0.0, 0.4), 8).encode())
    monitor.take(0, Frame(0x7EE, b"\x01\x02"))
    monitor.take(0, Frame(0x18FF0010, b"\x03", extended=True))
    rows = {row.identifier: row for row in monitor.sorted_rows()}
    assert lost(rows[0x181]) == 2
    assert monitor.content(rows[0x181]).startswith("#4  v 100.00 -50.00 -50.00 kV  i 1000.0")
    assert monitor.content(rows[0x300]) == "v 127.00 127.00 127.00 kV; f 50.000 Hz +0.00 Hz/s fault at 0.400"
    assert state_of(rows[0x300]) == ""
    assert monitor.content(rows[0x7EE]) == "01 02" and rows[0x7EE].name == ""
    assert state_of(rows[0x18FF0010]) == "1 unknown identifier"


def test_an_authenticated_frame_is_read() -> None:
    monitor, trip = BusMonitor(), Publisher(Kind.TRIP, 0)
    frame = trip.poll(0)
    assert frame is not None
    monitor.take(0, CmacSeal({frame.id: bytes(16)}, epoch_ns=0).close(0, frame))
    (row,) = monitor.sorted_rows()
    assert monitor.content(row).startswith("poles none  st 1")
    assert state_of(row) == "tag not checked"


def test_another_dbc(tmp_path: Path) -> None:
    file = tmp_path / "door.dbc"
    file.write_text(DBC, encoding="utf-8")
    monitor = BusMonitor(database=load_dbc(file))
    for frame in (Frame(0x10, b"\x03\x00"), Frame(0x11, b"\x01"), Frame(0x10, b"\x03\x00")):
        monitor.take(0, frame)
    door, other = monitor.sorted_rows()
    assert (door.name, door.sender, door.count) == ("Door", "ECU", 2)
    assert monitor.content(door) == "open=1 angle=2"
    assert monitor.content(other) == "01" and state_of(other) == ""
    monitor.take(0, Frame(0x10, b""))
    assert monitor.content(door) == "(Wrong data size: 0 instead of 2 bytes)"


def test_senders_are_those_of_the_dbc() -> None:
    database = load_dbc(DBC_PATH)
    for kind, number, name in (
        (Kind.TRIP, 3, "TRIP_03"),
        (Kind.BREAKER_STATUS, 1, "BREAKER_STATUS_01"),
        (Kind.SAMPLED_VALUES, 2, "SAMPLED_VALUES_02"),
        (Kind.HEARTBEAT, 17, "HEARTBEAT_17"),
    ):
        assert database.get_message_by_name(name).senders == [sender_name(kind, number)]


@pytest.mark.parametrize(
    ("text", "words"),
    [("BO_ nonsense", "not a CAN database: "), (None, "No such file"), ("\xff\x00", "not a CAN database: ")],
)
def test_a_dbc_that_is_none(tmp_path: Path, text: str | None, words: str) -> None:
    file = tmp_path / "bad.dbc"
    if text is not None:
        file.write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=words) as caught:
        load_dbc(file)
    assert str(file) in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--can", "virtual:x"], "its own process only"),
        (["--can", "vcan0"], "not INTERFACE:CHANNEL"),
        (["--can", "socketcan:nocan7"], "no CAN interface of this name"),
        (["--can", "socketcan:nocan7", "--dbc", "nowhere.dbc"], "nowhere.dbc: cannot be read"),
        (["--can", "socketcan:nocan7", "--bitrate", "0"], "--bitrate: 0 bit/s"),
        (["--can", "socketcan:nocan7", "--pace", "0"], "--pace: must be greater than 0"),
    ],
)
def test_wrong_input(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["monitor", *words]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1


def test_a_state_of_another_run_is_followed_when_the_old_one_is_silent() -> None:
    monitor = BusMonitor()
    monitor.take(0, State(Kind.TRIP, 0, 0, 9, 9, 0, 90_000).encode())
    again = Publisher(Kind.TRIP, 0)
    (row,) = monitor.sorted_rows()
    for n in range(3):
        frame = again.poll(again.next_ns)
        assert frame is not None
        monitor.take(10_000 * MS + n * 2 * MS, frame)
    assert monitor.content(row).startswith("poles none  st 1")
