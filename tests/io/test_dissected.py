"""What Wireshark's dissectors say to our messages, field for field."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from faultloop.io.can.frames import Heartbeat, Measurements, Page, SampledValues, State, ticks
from faultloop.io.can.table import Kind
from faultloop.io.iec61850.gateway import Gateway
from faultloop.io.iec61850.pcap import write_pcap
from tests.io.process_bus import MS, START_NS, station

pytest.importorskip("open61850")

pytestmark = pytest.mark.skipif(shutil.which("tshark") is None, reason="needs-tshark: apt-get install tshark")


def dissected(path: Path, *fields: str) -> list[list[str]]:
    """The values of each frame, several of one field joined by commas."""
    chosen = [part for field in fields for part in ("-e", field)]
    done = subprocess.run(
        ["tshark", "-r", path, "-o", "sv.decode_data_as_phsmeas:TRUE",
         "-T", "fields", "-E", "separator=|", *chosen],
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    return [line.split("|") for line in done.stdout.splitlines()]


def written(path: Path, messages: list[tuple[int, Any]], **options: Any) -> Path:
    gateway = Gateway(station(**options), start_ns=START_NS)
    frames = [(START_NS + t, data) for t, message in messages for data in gateway.encode(message.encode(), t)]
    return write_pcap(path / "bus.pcap", frames)


ETHERNET = ("eth.dst", "eth.src", "vlan.priority", "vlan.id", "_ws.malformed", "_ws.expert.message")
PDU = (
    "goose.appid", "goose.gocbRef", "goose.timeAllowedtoLive", "goose.datSet", "goose.goID", "goose.t",
    "goose.stNum", "goose.sqNum", "goose.simulation", "goose.confRev", "goose.ndsCom",
    "goose.numDatSetEntries", "goose.boolean", "goose.bit_string", "goose.integer", "goose.floating_point",
    "goose.reserve1.s_bit",
)  # fmt: skip


def test_goose_is_dissected_field_for_field(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        [
            (0, State(Kind.TRIP, 0, 0, 1, 0, 0, 0)),
            (7 * MS, State(Kind.TRIP, 0, 5, 2, 0, 1, ticks(7 * MS))),
            (9 * MS, State(Kind.TRIP, 0, 5, 2, 1, 2, ticks(9 * MS))),
            (9 * MS, State(Kind.BREAKER_STATUS, 1, 3, 1, 0, 0, ticks(9 * MS), test=True)),
            (10 * MS, State(Kind.PILOT, 1, 7, 1, 0, 0, ticks(10 * MS))),
            (11 * MS, State(Kind.CLOSE, 1, 2, 1, 0, 0, ticks(11 * MS))),
            (12 * MS, Heartbeat(32, 5, 2, 70_000, 1200)),
            (13 * MS, Measurements(0, Page.FREQUENCY, (50.0, -0.5, 0.25), 0)),
        ],
        vlan_id=5,
    )
    ether = dissected(path, *ETHERNET)
    no = ["", ""]
    assert ether[0] == ["01:0c:cd:01:00:10", "02:00:00:00:00:00", "4", "5", *no]
    assert ether[3] == ["01:0c:cd:01:00:41", "02:00:00:00:00:11", "4", "5", *no]
    assert ether[6] == ["01:0c:cd:01:01:20", "02:00:00:00:00:20", "4", "5", *no]
    assert all(row[4:] == no for row in ether)
    time = "Jan  1, 2020 00:00:00.{:09d} UTC".format
    trip = ["0x8010", "RALD0/LLN0$GO$gcbTrip"]
    names = ["RALD0/LLN0$dsTrip", "RATrip"]
    head = ["0", "1", "0"]
    good, test = "0000", "0010"
    rows = dissected(path, *PDU)
    exact, dated = time(0), "Jan  1, 2020 00:00:00.00"
    assert rows[0] == [*trip, "6", *names, exact, "1", "0", *head, "5", "0,0,0,0", good, "", "", "0"]
    assert rows[1][:5] == [*trip, "6", *names]
    assert rows[1][5].startswith(dated) and float(rows[1][5].split(":")[2][:12]) == pytest.approx(
        0.007, abs=1e-6
    )
    assert rows[1][6:] == ["2", "0", *head, "5", "1,1,0,1", good, "", "", "0"]
    assert rows[2] == [*rows[1][:2], "10", *rows[1][3:7], "1", *rows[1][8:]]
    assert rows[3][1:5] == ["QBLD0/LLN0$GO$gcbPosition", "6", "QBLD0/LLN0$dsPosition", "QBPosition"]
    assert rows[3][11:14] == ["6", "", f"80,{test},80,{test},40,{test}"]
    assert rows[4][1] == "RBLD0/LLN0$GO$gcbPilot" and rows[4][12:14] == ["1,1,1,1", good]
    assert rows[5][1] == "RBLD0/LLN0$GO$gcbClose" and rows[5][12:14] == ["1,0,1,0", good]
    assert rows[6][1] == "plantLD0/LLN0$GO$gcbHealth" and rows[6][11:15] == ["4", "", "", "5,2,65535,1200"]
    assert rows[6][2] == "2000"
    assert rows[7][1] == "RALD0/LLN0$GO$gcbFrequency"
    assert rows[7][15] == "0842480000,08bf000000,083e800000"  # 8 bits of exponent; 50, -0.5, 0.25


def test_simulated_goose_has_the_flag_in_frame_and_message(tmp_path: Path) -> None:
    path = written(tmp_path, [(0, State(Kind.TRIP, 0, 0, 1, 0, 0, 0))], simulation=True)
    assert dissected(path, "goose.simulation", "goose.reserve1.s_bit", "_ws.expert.message") == [
        ["1", "1", ""]
    ]


SV = (
    "sv.appid",
    "sv.noASDU",
    "sv.svID",
    "sv.smpCnt",
    "sv.confRev",
    "sv.smpSynch",
    "sv.meas_value",
    "sv.meas_quality",
)


@pytest.mark.parametrize(("rate", "asdus"), [(4000, 1), (12800, 8), (4800, 2)])
def test_sampled_values_are_dissected_field_for_field(tmp_path: Path, rate: int, asdus: int) -> None:
    sent = [
        (n * 10**9 // rate, SampledValues(1, n, (n + 0.01, -n, 2.5, 0.001 * n, float("nan"), -1.0)))
        for n in range(16)
    ]
    path = written(tmp_path, sent, sampling_hz=rate)
    ether = dissected(path, *ETHERNET)
    assert ether == [["01:0c:cd:04:00:01", "02:00:00:00:01:01", "4", "0", "", ""]] * (16 // asdus)
    rows = dissected(path, *SV)
    for place, row in enumerate(rows):
        own = range(place * asdus, (place + 1) * asdus)
        many = ",".join
        assert row[:6] == [
            "0x4001", str(asdus), many(["RB_MUMU0101"] * asdus), many(map(str, own)), many(["1"] * asdus),
            many(["2"] * asdus),
        ]  # fmt: skip
        values = [[n, 0, -1000, n - 1000, 100 * n + 1, -100 * n, 250, 251] for n in own]
        assert row[6] == many(str(value) for sample in values for value in sample)
        qualities = [0, 2, 0, 0x2002, 0, 0, 0, 0x2000]
        assert [int(q, 16) for q in row[7].split(",")] == qualities * asdus
    validity = dissected(path, "sv.meas_quality.validity")[0][0].split(",")[:8]
    assert validity == ["0x00000000", "0x00000002", "0x00000000", "0x00000002", *["0x00000000"] * 4]


def test_the_same_messages_are_the_same_bytes_at_their_times(tmp_path: Path) -> None:
    messages = [(1_234_567, State(Kind.TRIP, 0, 0, 1, 0, 0, ticks(1_234_567)))]
    first = written(tmp_path, messages)
    content = first.read_bytes()
    assert written(tmp_path, messages).read_bytes() == content
    assert dissected(first, "frame.time_epoch") == [["1577836800.001234567"]]
