"""What channels prints with ``--json``."""

from __future__ import annotations

from typing_extensions import TypedDict

from faultloop.cli.printed.told import told


@told
class RelayOfLog(TypedDict):
    """A relay whose samples can be replayed."""

    name: str
    """As in the log."""
    map: str
    """What `--map` takes it by."""


@told
class LogChannels(TypedDict):
    """`faultloop channels LOG.mcap --json`."""

    record: str
    """The file."""
    relays: list[RelayOfLog]
    """Whose samples it has."""


@told
class Rate(TypedDict):
    """A stretch of one sampling rate."""

    hz: float
    """The rate."""
    last_sample: int
    """The stretch's end, counted from the record's start."""


@told
class AnalogChannel(TypedDict):
    """An analog channel of a record."""

    index: int
    """Its place, from 0."""
    name: str
    """As the record has it."""
    unit: str
    """As the record has it."""
    phase: str
    """As the record has it."""
    circuit: str
    """As the record has it."""
    bay: str
    """The bay that it seems to belong to; empty where none is told."""
    scale: str
    """`P` primary, `S` secondary, empty: not said."""
    ratio: list[float] | None
    """Primary and secondary of its transformer; null where not said."""
    slot: str | None
    """What a replay could take it as, `va` ... `ic`; null: nothing."""
    why: str
    """Why so."""


@told
class DigitalChannel(TypedDict):
    """A digital channel of a record."""

    index: int
    """Its place, from 0."""
    name: str
    """As the record has it."""
    normal: int
    """Its normal state, as the record has it."""
    at_start: bool | None
    """Its state at first; null without samples."""
    changes: int
    """How often it changes."""
    first_change_s: float | None
    """When first; null: never."""


@told
class Bay(TypedDict):
    """Channels that belong together."""

    name: str
    """As told by their names."""
    channels: dict[str, int]
    """By `va` ... `ic`: places of its analog channels."""
    voltages: str
    """Where its voltages come from."""
    map: str
    """The same as `--map`."""


@told
class RecordChannels(TypedDict):
    """`faultloop channels RECORD --json`."""

    record: str
    """The file."""
    station: str
    """As the record has it."""
    device: str
    """As the record has it."""
    revision: str
    """Of COMTRADE: 1991, 1999, 2013."""
    encoding: str
    """Of the texts."""
    frequency_hz: float | None
    """Nominal; null where not said."""
    samples: int
    """How many."""
    duration_s: float
    """From the first to the last."""
    rates: list[Rate]
    """The first hundred stretches."""
    analog: list[AnalogChannel]
    """In the record's order."""
    digital: list[DigitalChannel]
    """In the record's order."""
    bays: list[Bay]
    """What `--map bay=` can name."""
    notes: list[str]
    """How the record was read."""
