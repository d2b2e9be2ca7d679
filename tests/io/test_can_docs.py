"""The page on CAN says what the table of messages says, and its example runs."""

from __future__ import annotations

import re

from faultloop.io.can.frames import State
from faultloop.io.can.table import MESSAGES


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
