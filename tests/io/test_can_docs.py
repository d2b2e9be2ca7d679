"""The page on CAN says what the table of messages says, and its example runs."""

from __future__ import annotations

import re
from math import nan

import cantools
from e2e import p01, p05

from faultloop.io.can.dbc import DBC_PATH
from faultloop.io.can.frames import (
    Differential,
    Heartbeat,
    Measurements,
    Page,
    SampledValues,
    State,
    TimeSync,
    decode,
)
from faultloop.io.can.table import MESSAGES, STATE_KINDS, Kind


def test_every_message_and_signal_is_on_the_page(root):
    page = (root / "docs" / "can.md").read_text(encoding="utf-8")
    for message in MESSAGES:
        row = next(line for line in page.splitlines() if line.startswith(f"| {message.kind.name} "))
        assert f"{message.kind.value:#05x} + " in row
        assert f"| {message.length}{', CAN FD' if message.fd else ''} |" in row
        for signal in message.signals:
            assert f"`{signal.name}`" in page


def test_the_example_on_the_page_runs(root):
    page = (root / "docs" / "can.md").read_text(encoding="utf-8")
    section = page.split("## A frame of your own")[1].split("\n## ")[0]
    code = "\n".join(re.findall(r"^    (.*)$", section, re.MULTILINE))
    names: dict = {}
    exec(compile(code, "docs/can.md", "exec"), names)
    assert isinstance(names["message"], State) and names["message"].poles == 7
    assert names["subscriber"].poles == 7


def test_the_vectors_on_the_page(root):
    """Made and read by faultloop; the CRC by another E2E library, the signals by cantools."""
    page = (root / "docs" / "can.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+\(.*\))` \| (0x\w+) \| `([0-9a-f ]+)` \|$", page, re.MULTILINE)
    names = {
        c.__name__: c
        for c in (Differential, Heartbeat, Kind, Measurements, Page, SampledValues, State, TimeSync)
    } | {"nan": nan}
    database = cantools.database.load_file(DBC_PATH)
    seen = set()
    for text, identifier, data in rows:
        message, number, content = eval(text, names), int(identifier, 16), bytes.fromhex(data)
        frame = message.encode()
        assert (frame.id, frame.data) == (number, content)
        assert repr(decode(frame)) == repr(message)  # a NaN equals its text
        kind = next(m.kind for m in MESSAGES if m.kind <= number < m.kind + m.count)
        seen.add(kind)
        if kind in STATE_KINDS:
            assert p01.e2e_p01_check(bytearray(content), number)
        if kind in (Kind.SAMPLED_VALUES, Kind.DIFFERENTIAL):
            assert p05.e2e_p05_check(bytearray(content), number)
        signals = database.decode_message(number, content, decode_choices=False)
        if kind in STATE_KINDS:
            poles = signals["pole_a"] | signals["pole_b"] << 1 | signals["pole_c"] << 2
            assert (poles, signals["st_num"]) == (message.poles, message.st_num)
    assert seen == {message.kind for message in MESSAGES}
