"""The one table of CAN messages: identifiers, signals, bits.

The DBC (``dbc.py``) is generated from it, the tests hold the codecs (``frames.py``) against it, and
``docs/can.md`` prints it.  Identifiers order the messages by priority: the lowest wins the arbitration.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import NamedTuple

RELAYS = 16
BREAKERS = 16
PLANT_NODE = RELAYS + BREAKERS  # heartbeat numbers: relays, then breakers, then the plant
NODES = PLANT_NODE + 1
OPERATIONAL = 5  # a heartbeat's state, as CANopen has it

TICK_NS = 10_000  # the unit of every `time` signal: 10 us, so a u32 wraps after 11.9 hours
CURRENT_LSB = 1e-3  # A  and
PHASOR_LSB = 1e-2  # A, of a current phasor
VOLTAGE_LSB = 1e-2  # V: the scale factors of IEC 61850-9-2LE and IEC 61869-9


class Kind(IntEnum):
    """A kind of message; the value is its first identifier."""

    TRIP = 0x010
    CLOSE = 0x020
    PILOT = 0x030
    DIFFERENTIAL = 0x040
    TRANSFER = 0x060
    BREAKER_FAILURE = 0x070
    TIME_SYNC = 0x0F0
    BREAKER_STATUS = 0x100
    SAMPLED_VALUES = 0x180
    MEASUREMENTS = 0x300
    HEARTBEAT = 0x700


STATE_KINDS = (
    Kind.TRIP, Kind.CLOSE, Kind.PILOT, Kind.TRANSFER, Kind.BREAKER_FAILURE, Kind.BREAKER_STATUS,
)  # fmt: skip


class Alarm(IntFlag):
    """Bits of a heartbeat's `alarms`."""

    SILENT = 1  # a publisher that it follows has been silent for too long
    REJECTED = 2  # it has refused frames since its last heartbeat
    BUS = 4


class Signal(NamedTuple):
    """One signal, little endian: first bit, length [bit], and value = raw * scale."""

    name: str
    start: int
    length: int
    signed: bool = False
    scale: float = 1
    unit: str = ""
    comment: str = ""
    page: int | None = None  # multiplexed: present where `page` has this value
    choices: dict[int, str] | None = None
    big_endian: bool = False  # its first bit is then the most significant one


@dataclass(frozen=True, slots=True)
class MessageType:
    """One kind of message: `count` identifiers from `kind` on, sent by the node of the same number."""

    kind: Kind
    count: int
    sender: str
    length: int
    fd: bool
    comment: str
    signals: tuple[Signal, ...]


def _protected(poles: str) -> tuple[Signal, ...]:
    """Head of AUTOSAR E2E profile 1 (CRC, counter), poles, GOOSE's numbers, time: all of 8 bytes."""
    return (
        Signal("crc", 0, 8, comment="CRC-8 (0x1D, start 0, no final XOR): identifier (low, high), bytes 1-7"),
        Signal("counter", 8, 4, comment="0 to 14, one more in each frame of this identifier"),
        Signal("pole_a", 12, 1, comment=poles),
        Signal("pole_b", 13, 1, comment=poles),
        Signal("pole_c", 14, 1, comment=poles),
        Signal("test", 15, 1, comment="1: sent under test; a receiver that is not must not act on it"),
        Signal("st_num", 16, 8, comment="state number: one more with each change of poles that is told"),
        Signal("sq_num", 24, 8, comment="0 in the first frame of a state, then 1 to 255, then 1 again"),
        Signal("time", 32, 32, scale=1e-5, unit="s", comment="time of sending, since the run's start"),
    )


_PAGES = {0: "voltage", 1: "current", 2: "frequency"}

MESSAGES = (
    MessageType(
        Kind.TRIP, RELAYS, "RELAY", 8, False,
        "Opens the poles whose bit is set. Repeated as GOOSE repeats.",
        _protected("1: open this pole"),
    ),
    MessageType(
        Kind.CLOSE, RELAYS, "RELAY", 8, False,
        "Closes the poles whose bit is set. Repeated as GOOSE repeats.",
        _protected("1: close this pole"),
    ),
    MessageType(
        Kind.PILOT, RELAYS, "RELAY", 8, False,
        "Pilot signal to the relay at the line's other end. Repeated as GOOSE repeats.",
        _protected("1: sent for this pole"),
    ),
    MessageType(
        Kind.DIFFERENTIAL, RELAYS, "RELAY", 32, True,
        "Currents of one line end at one instant, for the relays that a [[channel]] links; 8 a cycle.",
        (
            Signal("crc", 0, 16, comment="CRC-16 CCITT-FALSE over bytes 2 to 31 and the identifier"),
            Signal("counter", 16, 8, comment="one more in each frame of this identifier"),
            Signal("valid", 24, 3, comment="bit set of the phases that are valid, A first"),
            Signal(
                "synchronized", 27, 2, comment="the sender's clock",
                choices={0: "none", 1: "channel", 2: "global"},
            ),
            Signal("external", 29, 1, comment="1: the sender sees a fault outside"),
            Signal("transfer", 30, 1, comment="1: the sender trips, and so shall the others"),
            Signal("test", 31, 1, comment="1: sent under test; a receiver that is not must not act on it"),
            Signal("time", 32, 32, scale=1e-6, unit="s", comment="the instant that the currents are of"),
            *(
                Signal(f"i{p}_{part}", 64 + 48 * i + 24 * j, 24, True, PHASOR_LSB, "A")
                for i, p in enumerate("abc") for j, part in enumerate(("re", "im"))
            ),
            Signal("bare", 208, 1, comment="1: charging is not taken off, as this end has no voltage"),
            Signal("whom", 209, 4, comment="number of a relay at another end, in turn ..."),
            Signal("heard", 216, 8, comment="... the counter of its last set ..."),
            Signal("ago", 240, 16, scale=1e-6, unit="s", comment="... heard so long before `time`; 0: none"),
            Signal("agreement", 224, 16, comment="hash of what all ends must have alike"),
        ),
    ),
    MessageType(
        Kind.TRANSFER, RELAYS, "RELAY", 8, False,
        "Direct transfer trip to the relays that a [[channel]] links. Repeated as GOOSE repeats.",
        _protected("1: trip this pole"),
    ),
    MessageType(
        Kind.BREAKER_FAILURE, RELAYS, "RELAY", 8, False,
        "Its own breaker has failed: opens the poles of the breakers around. Repeated as GOOSE repeats.",
        _protected("1: open this pole"),
    ),
    MessageType(
        Kind.TIME_SYNC, 1, "PLANT", 8, False,
        "The time, as AUTOSAR's CanTSyn tells it: SYNC, then its follow-up.",
        (
            Signal("page", 0, 8, choices={0x20: "SYNC", 0x28: "FOLLOW_UP"}, comment="both with CRC"),
            Signal("crc", 8, 8, comment="CRC-8H2F over bytes 2 to 7 and the data id of page and sequence"),
            Signal("sequence", 16, 4, comment="0 to 15; a follow-up has its SYNC's"),
            Signal("domain", 20, 4, comment="of the time base"),
            Signal("overflow", 24, 2, unit="s", page=0x28, comment="OVS: seconds of T1 beyond those of T0"),
            Signal("gateway", 26, 1, page=0x28, comment="SGW: 1: a gateway has lost the master"),
            Signal("seconds", 39, 32, False, 1, "s", "of T0, since the run's start", 0x20, big_endian=True),
            Signal("nanoseconds", 39, 32, False, 1, "ns", "from T0's seconds to T1", 0x28, big_endian=True),
        ),
    ),
    MessageType(
        Kind.BREAKER_STATUS, BREAKERS, "BREAKER", 8, False,
        "Position of the poles. Repeated as GOOSE repeats.",
        _protected("1: this pole is closed"),
    ),
    MessageType(
        Kind.SAMPLED_VALUES, RELAYS, "PLANT", 32, True,
        "One sample of the six channels of a relay, instantaneous primary values.",
        (
            Signal("crc", 0, 16, comment="CRC-16 CCITT-FALSE over bytes 2 to 31 and the identifier"),
            Signal("counter", 16, 8, comment="one more in each frame of this identifier"),
            Signal("invalid", 24, 6, comment="bit set of the channels that are not valid, va first"),
            Signal("synchronized", 30, 2, comment="SmpSynch", choices={0: "none", 1: "local", 2: "global"}),
            Signal("sample_count", 32, 32, comment="number of the sample since the run's start"),
            *(Signal(f"v{p}", 64 + 32 * i, 32, True, VOLTAGE_LSB, "V") for i, p in enumerate("abc")),
            *(Signal(f"i{p}", 160 + 32 * i, 32, True, CURRENT_LSB, "A") for i, p in enumerate("abc")),
        ),
    ),
    MessageType(
        Kind.MEASUREMENTS, RELAYS, "RELAY", 8, False,
        "RMS values and frequency as the relay measures them, one page in each frame.",
        (
            Signal("page", 0, 8, choices=_PAGES),
            Signal("counter", 8, 8, comment="one more in each frame of this identifier"),
            *(Signal(f"v{p}", 16 + 16 * i, 16, scale=10, unit="V", page=0) for i, p in enumerate("abc")),
            *(Signal(f"i{p}", 16 + 16 * i, 16, scale=1, unit="A", page=1) for i, p in enumerate("abc")),
            Signal("frequency", 16, 16, scale=1e-3, unit="Hz", page=2),
            Signal("rocof", 32, 16, True, 1e-2, "Hz/s", page=2),
            Signal("fault_location", 48, 16, True, 1e-3, "pu", "-32768: none", page=2),
        ),
    ),
    MessageType(
        Kind.HEARTBEAT, NODES, "NODE", 8, False,
        "The node is alive. Numbers: relays, then 16 + breaker, then 32 the plant.",
        (
            Signal(
                "state", 0, 8, comment="as CANopen's NMT error control",
                choices={0: "boot-up", 4: "stopped", 5: "operational", 127: "pre-operational"},
            ),
            Signal("alarms", 8, 8, comment="bit set: 1 a publisher is silent, 2 frames rejected, 4 bus"),
            Signal("rejected", 16, 16, comment="frames rejected since the start, at most 65535"),
            Signal("time", 32, 32, scale=1e-5, unit="s", comment="time of sending, since the run's start"),
        ),
    ),
)  # fmt: skip

BY_KIND = {message.kind: message for message in MESSAGES}
BY_IDENTIFIER = {message.kind + n: (message.kind, n) for message in MESSAGES for n in range(message.count)}
