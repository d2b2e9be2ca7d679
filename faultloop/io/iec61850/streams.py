"""Who publishes what: the one table of GOOSE control blocks, their data sets and addresses.

The data sets are lists of attributes (IEC 61850-7-4 names) without time stamps in them: some receivers take
none. Addresses are in the ranges that IEC 61850-8-1 and 9-2, annex "Multicast address selection", recommend.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from faultloop.config.iec61850 import Iec61850
from faultloop.io.can.table import BREAKERS, PLANT_NODE, RELAYS, Kind

MS = 1_000_000
FIRST_NS = 2 * MS
"""From a change to its first repetition; each interval is twice the one before, up to the heartbeat."""
GRACE_NS = 2 * MS
"""For the network, in the time allowed to live."""
CONF_REV = 1
DEVICE = "LD0"
UNIT = "MU01"
"""Logical devices of relays and breakers, and of merging units."""
TRIP_APP_ID = 0x8000
SV_APP_ID = 0x4000


class Member(NamedTuple):
    """An attribute in a data set."""

    node: str
    """Class and instance of its logical node, as in ``PTRC1``."""
    object: str
    """As in ``Tr``, ``PhV.phsA``."""
    attribute: str
    """As in ``general``, ``cVal.mag.f``."""
    type: str
    """``BOOLEAN``, ``Dbpos``, ``Quality``, ``INT32`` or ``FLOAT32``."""
    constraint: str = "ST"

    @property
    def reference(self) -> str:
        return f"{self.node}.{self.object}.{self.attribute}"


PHASES = ("phsA", "phsB", "phsC")


def _activation(node: str, name: str) -> tuple[Member, ...]:
    booleans = [Member(node, name, part, "BOOLEAN") for part in ("general", *PHASES)]
    return (*booleans, Member(node, name, "q", "Quality"))


def _position(node: str) -> tuple[Member, ...]:
    return Member(node, "Pos", "stVal", "Dbpos"), Member(node, "Pos", "q", "Quality")


def _phases(name: str) -> tuple[Member, ...]:
    return tuple(Member("MMXU1", f"{name}.{phase}", "cVal.mag.f", "FLOAT32", "MX") for phase in PHASES)


def _magnitude(node: str, name: str) -> Member:
    return Member(node, name, "mag.f", "FLOAT32", "MX")


class Block(NamedTuple):
    """A kind of GOOSE control block."""

    kind: Kind
    page: int
    """Of measurements, which are three blocks; else 0."""
    name: str
    place: int
    """Of its first address, in the last two bytes."""
    members: tuple[Member, ...]


BLOCKS = (
    Block(Kind.TRIP, 0, "Trip", 0x10, _activation("PTRC1", "Tr")),
    Block(Kind.CLOSE, 0, "Close", 0x20, _activation("RREC1", "OpCls")),
    Block(Kind.PILOT, 0, "Pilot", 0x30, _activation("PSCH1", "TxPrm")),
    Block(Kind.TRANSFER, 0, "Transfer", 0x80, _activation("PSCH1", "TxTr")),
    Block(Kind.BREAKER_FAILURE, 0, "BreakerFailure", 0x90, _activation("RBRF1", "OpEx")),
    Block(
        Kind.BREAKER_STATUS, 0, "Position", 0x40,
        (*_position("XCBR1"), *_position("XCBR2"), *_position("XCBR3")),
    ),
    Block(Kind.MEASUREMENTS, 0, "Voltage", 0x50, _phases("PhV")),
    Block(Kind.MEASUREMENTS, 1, "Current", 0x60, _phases("A")),
    Block(
        Kind.MEASUREMENTS, 2, "Frequency", 0x70,
        (_magnitude("MMXU1", "Hz"), _magnitude("GGIO1", "AnIn1"), _magnitude("GGIO1", "AnIn2")),
    ),
    Block(
        Kind.HEARTBEAT, 0, "Health", 0x100,
        tuple(Member("GGIO1", f"IntIn{n}", "stVal", "INT32") for n in (1, 2, 3, 4)),
    ),
)  # fmt: skip
"""IntIn: state, alarms, frames refused, time since the run's start in 10 us; AnIn: rate of change of
frequency, fault location."""
_BY_KIND = {(block.kind, block.page): block for block in BLOCKS}


class Address(NamedTuple):
    """Where a stream is on an Ethernet."""

    destination: str
    source: str
    app_id: int


class Stream(NamedTuple):
    """A GOOSE stream: whose block it is."""

    block: Block
    number: int
    ied: str
    address: Address

    @property
    def control(self) -> str:
        """gocbRef."""
        return f"{self.ied}{DEVICE}/LLN0$GO$gcb{self.block.name}"

    @property
    def data_set(self) -> str:
        """datSet."""
        return f"{self.ied}{DEVICE}/LLN0$ds{self.block.name}"

    @property
    def id(self) -> str:
        """goID."""
        return f"{self.ied}{self.block.name}"

    @property
    def identifier(self) -> int:
        """Of the CAN frames that carry the same."""
        return self.block.kind + self.number


class Unit(NamedTuple):
    """The merging unit of a relay: a stream of Sampled Values."""

    number: int
    ied: str
    address: Address

    @property
    def id(self) -> str:
        """svID: of the first control block of the unit, as 9-2LE names it."""
        return f"{self.ied}{UNIT}01"


class _Named(Protocol):
    @property
    def name(self) -> str: ...


class _System(Protocol):
    @property
    def sampling_hz(self) -> int: ...
    @property
    def frequency_hz(self) -> int: ...


class _Bus(Protocol):
    @property
    def heartbeat_s(self) -> float: ...
    @property
    def keys(self) -> str | None: ...


class _BusFault(Protocol):
    @property
    def name(self) -> str: ...
    @property
    def kind(self) -> str: ...


class Tables(Protocol):
    """What is read of a scenario."""

    @property
    def relay(self) -> Sequence[_Named]: ...
    @property
    def breaker(self) -> Sequence[_Named]: ...
    @property
    def system(self) -> _System: ...
    @property
    def can(self) -> _Bus: ...
    @property
    def bus_fault(self) -> Sequence[_BusFault]: ...
    @property
    def iec61850(self) -> Iec61850: ...


@dataclass(frozen=True)
class Station:
    """Names, rates and settings of everybody on a process bus.

    Attributes
    ----------
    named : the names are the scenario's; else streams are known by their addresses alone, as by a monitor.
    """

    relays: tuple[str, ...] = tuple(f"R{n}" for n in range(RELAYS))
    breakers: tuple[str, ...] = tuple(f"Q{n}" for n in range(BREAKERS))
    sampling_hz: int = 4800
    frequency_hz: int = 50
    heartbeat_ns: int = 1000 * MS
    options: Iec61850 = field(default_factory=Iec61850)
    named: bool = False

    @classmethod
    def of(cls, scenario: Tables) -> Station:
        """The station of a scenario."""
        return cls(
            tuple(place.name for place in scenario.relay),
            tuple(breaker.name for breaker in scenario.breaker),
            scenario.system.sampling_hz,
            scenario.system.frequency_hz,
            round(scenario.can.heartbeat_s * 1e9),
            scenario.iec61850,
            True,
        )

    def streams(self) -> list[Stream]:
        """Every GOOSE stream of the station."""
        relays, breakers, _, plant = self._names()
        nodes = [*enumerate(relays), *((RELAYS + i, name) for i, name in enumerate(breakers))]
        streams = []
        for block in BLOCKS:
            publishers = list(enumerate(relays))
            if block.kind == Kind.BREAKER_STATUS:
                publishers = list(enumerate(breakers))
            elif block.kind == Kind.HEARTBEAT:
                publishers = [*nodes, (PLANT_NODE, plant)]
            streams += [Stream(block, n, name, _address(block, n)) for n, name in publishers]
        return streams

    def units(self) -> list[Unit]:
        """The merging unit of every relay."""
        return [
            Unit(
                n,
                name,
                Address(f"01:0c:cd:04:00:{n:02x}", f"02:00:00:00:01:{n:02x}", SV_APP_ID + n),
            )
            for n, name in enumerate(self._names()[2])
        ]

    def _names(self) -> tuple[list[str], list[str], list[str], str]:
        """Of relays, breakers, merging units and the plant."""
        everybody = [*self.relays, *self.breakers, *(f"{relay}_MU" for relay in self.relays), "plant"]
        names, n, m = ied_names(everybody), len(self.relays), len(self.breakers)
        return names[:n], names[n : n + m], names[n + m : -1], names[-1]

    def interval_ns(self, sq_num: int) -> int:
        """From the message of that number to the next [ns]."""
        return min(FIRST_NS << min(sq_num, 30), self.heartbeat_ns)

    def allowed_to_live_ms(self, sq_num: int) -> int:
        """timeAllowedtoLive of a state's message of that number [ms]: twice the interval that follows, and a
        grace."""
        return -(-(2 * self.interval_ns(sq_num) + GRACE_NS) // MS)


def block_of(kind: Kind, page: int = 0) -> Block | None:
    """None where GOOSE carries no such message."""
    return _BY_KIND.get((kind, page))


def _address(block: Block, number: int) -> Address:
    place = block.place + number
    node = number if block.kind != Kind.BREAKER_STATUS else RELAYS + number
    app_id = place | (TRIP_APP_ID if block.kind in (Kind.TRIP, Kind.TRANSFER, Kind.BREAKER_FAILURE) else 0)
    return Address(f"01:0c:cd:01:{place >> 8:02x}:{place & 0xFF:02x}", f"02:00:00:00:00:{node:02x}", app_id)


def ied_names(names: Iterable[str]) -> list[str]:
    """Names that SCL takes (letters, digits, underscores, a letter first), each another one."""
    taken: list[str] = []
    for name in names:
        base = re.sub(r"[^A-Za-z0-9_]", "_", name)
        base = base if base[:1].isalpha() else f"N{base}"
        found, count = base, 1
        while found in taken:
            count += 1
            found = f"{base}_{count}"
        taken.append(found)
    return taken
