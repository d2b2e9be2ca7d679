"""``faultloop.dbc``, made by cantools from the table of messages.

``python -m faultloop.io.can.dbc`` writes it anew; a test holds the committed file against `dbc_text`.
"""

from __future__ import annotations

from collections import OrderedDict
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from faultloop.errors import InputError
from faultloop.io.can.table import BREAKERS, BY_KIND, MESSAGES, PLANT_NODE, RELAYS, Kind, MessageType
from faultloop.io.can.table import Signal as SignalRow

if TYPE_CHECKING:
    from cantools.database.can import Database, Message, Signal

DBC_PATH = Path(__file__).parent.parent / "faultloop.dbc"

_NODE_NAMES = [
    *(f"RELAY_{n:02}" for n in range(RELAYS)),
    *(f"BREAKER_{n:02}" for n in range(BREAKERS)),
    "PLANT",
]

# What makes cantools write which messages are CAN FD.
_CAN_FD = """VERSION "1"
BU_:
BA_DEF_ "BusType" STRING ;
BA_DEF_DEF_ "BusType" "CAN FD";
BA_ "BusType" "CAN FD";
"""


@cache
def database() -> Database:
    """The shipped DBC, loaded by cantools."""
    from cantools.database.can import Database

    loaded = Database()
    loaded.add_dbc_file(DBC_PATH, encoding="utf-8")
    return loaded


def message_name(kind: Kind, number: int) -> str:
    """Name of a message in the DBC, such as TRIP_03."""
    return f"{kind.name}_{number:02}"


def sender_name(kind: Kind, number: int) -> str:
    """Name of a message's sender in the DBC, such as BREAKER_01."""
    sender = BY_KIND[kind].sender
    return _NODE_NAMES[
        {"RELAY": number, "BREAKER": RELAYS + number, "PLANT": PLANT_NODE, "NODE": number}[sender]
    ]


def load_dbc(path: Path | str) -> Database:
    """A user's DBC (or another format that cantools reads).

    Raises
    ------
    InputError : no such file, or it is not a CAN database.
    """
    import cantools
    from cantools.errors import Error

    try:
        loaded = cantools.database.load_file(path)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from error
    except (Error, UnicodeError, ValueError, KeyError, IndexError) as error:
        why = str(error).partition("\n")[0] or type(error).__name__
        raise InputError(f"not a CAN database: {why}", file=path) from error
    if not isinstance(loaded, cantools.database.can.Database):
        raise InputError("a diagnostics database, not one of CAN messages", file=path)
    return loaded


def dbc_text() -> str:
    """The DBC that belongs to the table of messages."""
    from cantools.database.can import Database, Node

    can_fd = Database()
    can_fd.add_dbc_string(_CAN_FD)
    comments = {"PLANT": "The primary system: sampled values from the merging units of all relays."}
    built = Database(
        messages=[_message(kind, number) for kind in MESSAGES for number in range(kind.count)],
        nodes=[Node(name, comment=comments.get(name)) for name in _NODE_NAMES],
        version="1",
        dbc_specifics=can_fd.dbc,
    )
    return built.as_dbc_string(sort_signals=None, sort_attribute_signals=None).replace("\r\n", "\n")


def _message(row: MessageType, number: int) -> Message:
    from cantools.database.can import Message

    return Message(
        frame_id=row.kind + number,
        name=message_name(row.kind, number),
        length=row.length,
        signals=[_signal(signal, number) for signal in row.signals],
        senders=[sender_name(row.kind, number)],
        comment=row.comment if number == 0 else None,  # once for each kind keeps the file readable
        is_fd=row.fd,
    )


def _signal(row: SignalRow, number: int) -> Signal:
    from cantools.database.can import Signal
    from cantools.database.conversion import BaseConversion
    from cantools.database.namedsignalvalue import NamedSignalValue

    choices: OrderedDict[int, str | NamedSignalValue] = OrderedDict(
        (raw, NamedSignalValue(raw, name)) for raw, name in (row.choices or {}).items()
    )
    low, high = (
        (-(1 << row.length - 1), (1 << row.length - 1) - 1) if row.signed else (0, (1 << row.length) - 1)
    )
    return Signal(
        row.name,
        row.start,
        row.length,
        is_signed=row.signed,
        conversion=BaseConversion.factory(scale=row.scale, choices=choices or None),
        minimum=low * row.scale,
        maximum=high * row.scale,
        unit=row.unit or None,
        comment=(row.comment or None) if number == 0 else None,
        is_multiplexer=row.name == "page",
        multiplexer_ids=None if row.page is None else [row.page],
        multiplexer_signal=None if row.page is None else "page",
        byte_order="big_endian" if row.big_endian else "little_endian",
    )


if __name__ == "__main__":
    DBC_PATH.write_text(dbc_text(), encoding="utf-8", newline="\n")
    print(f"{DBC_PATH.name}: {sum(kind.count for kind in MESSAGES)} messages")
