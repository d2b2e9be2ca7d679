"""What the commands that read settings, logs and a bus print with ``--json``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NotRequired

from typing_extensions import TypedDict

from faultloop.cli.printed.told import told, told_with
from faultloop.review.facts import Summary


@told_with(Summary)
@dataclass(frozen=True)
class Review(Summary):
    """`faultloop review --json`."""

    written: list[str]
    """Pages and pictures."""


@told
class ZoneAt(TypedDict):
    """A zone at an instant."""

    function: str
    """`PDIS1`."""
    m: dict[str, float]
    """By loop: depth as a part of the zone's reach."""
    m_by_samples: float | None
    """The depth that counts in place of the phasors' while these ring."""
    polarized_by: str
    """By what voltage or current."""
    blocked: bool
    """Whether something blocks it."""
    inside_ms: float
    """For how long a loop has been inside."""
    waits_for_confirmation: bool
    """Inside, and not yet confirmed in time."""
    started: bool
    """Whether it has."""
    timer_ms: float
    """For how long."""
    delay_ms: float
    """What the timer is set to."""
    operated: bool
    """Whether it has."""
    text: str
    """The same in words."""


@told
class Instant(TypedDict):
    """What a relay knew at an instant.  At rest there is nothing between `text` and `zones`."""

    relay: str
    """Whose."""
    t_ns: int
    """The sample [ns since the start]."""
    text: str
    """The whole in words."""
    ready: NotRequired[bool]
    """Whether its estimates have settled."""
    type: NotRequired[str]
    """`AG`, `BC` ...; empty: unknown."""
    released: NotRequired[list[str]]
    """Loops that phase selection lets measure."""
    direction: NotRequired[str]
    """forward, reverse or unknown."""
    power_swing: NotRequired[bool]
    """Whether it sees one."""
    fuse_failure: NotRequired[bool]
    """Whether it sees one."""
    polarizing_v: NotRequired[float | None]
    """The polarizing positive-sequence voltage."""
    disturbed_ms: NotRequired[float | None]
    """Since when something changed; null: nothing did."""
    zones: list[ZoneAt]
    """Its distance zones."""


@told
class Difference(TypedDict):
    """A field that differs between two logs."""

    name: str
    """`/relay/R1/phasors.va_re`; `(message)` where one log lacks whole messages."""
    count: int
    """Messages in which it differs."""
    compared: int
    """Of how many."""
    t_ns: int
    """The first of them [ns since the start]."""
    a: str | float | bool | None
    """Its value in the first log; null: no message."""
    b: str | float | bool | None
    """Its value in the second."""
    largest: float | None
    """Greatest absolute difference; null for texts, and where one side alone is no number."""


@told
class OneSided(TypedDict):
    """A topic that only one log has."""

    topic: str
    """Which."""
    only_in: Literal["a", "b"]
    """The first or the second log."""


@told
class Diff(TypedDict):
    """`faultloop diff --json`."""

    equal: bool
    """Whether nothing differs that makes logs different."""
    first: Difference | None
    """What differs first."""
    fields: list[Difference]
    """All that differ, the first one first."""
    topics: list[OneSided]
    """What one log alone has."""
    information: list[str]
    """Differing metadata and attachments, which do not make logs different."""
    warnings: list[str]
    """What is damaged in the logs."""


@told
class Export(TypedDict):
    """`faultloop export --json`."""

    written: list[str]
    """The files."""
    warnings: list[str]
    """What is damaged in the log."""


@told
class Recover(TypedDict):
    """`faultloop recover --json`."""

    source: str
    """The file read: the newest `.part` if there is no log."""
    out: str
    """The file written."""
    others: list[str]
    """Older `.part` files, which are not in it."""
    whole: bool
    """The source was complete: nothing was lost."""
    messages: dict[str, int]
    """By topic: how many came back."""
    last_t_ns: int | None
    """The last of them [ns since the start]; null without messages."""
    cut_bytes: int
    """How much there is of the last record, which was cut off."""
    damaged: int
    """Chunks, attachments and messages left out, as damaged."""
    warnings: list[str]
    """What is not in the log written."""


@told
class Locate(TypedDict):
    """`faultloop locate --json`."""

    part: float
    """Of the line, from the first relay."""
    km: float | None
    """The same; null where the length is not known."""
    sequence: Literal["positive", "negative"]
    """By which it was found."""
    synchronised: bool
    """Whether by one clock."""
    mismatch: float
    """Of the two voltages there, as a part of the greater of the ends' own."""
    second_mismatch: float | None
    """The same of what was not used to find the place; null where there is nothing."""
    from_ms: float
    """What of the records was used: from here after the inception ..."""
    to_ms: float
    """... to here."""


@told
class Import(TypedDict):
    """`faultloop import --json`."""

    kind: str
    """What the file is."""
    settings: dict[str, Any]
    """faultloop's settings, as in its TOML."""
    not_taken: list[str]
    """What of the file was not understood, and why."""
    look_at: list[str]
    """What was taken with a doubt."""
    written: str | None
    """The TOML file."""


@told
class BusMessage(TypedDict):
    """A message on a bus."""

    id: int
    """Its identifier."""
    extended: bool
    """Of 29 bits."""
    name: str | None
    """As the DBC has it; null: unknown."""
    sender: str | None
    """Who sends it; null: unknown."""
    frames: int
    """How many."""
    rate_hz: float
    """How often."""
    lost: int
    """Missed, by the counter."""
    rejected: dict[str, int]
    """By cause: what a receiver refuses."""
    checks: str | None
    """What its protection says; null: it has none."""
    content: str
    """The newest, decoded."""


@told
class Monitor(TypedDict):
    """`faultloop monitor --json`."""

    frames: int
    """How many."""
    load: float
    """Part of the time in which the bus was busy, 0 to 1."""
    dropped: int
    """What the kernel could not keep."""
    error_frames: int
    """How many."""
    messages: list[BusMessage]
    """By identifier."""


@told
class ScenarioCheck(TypedDict):
    """`faultloop check --json` of a scenario."""

    file: str
    """The file."""
    valid: bool
    """Always true: what is wrong is an error."""
    kind: Literal["scenario"]
    """What the file is."""
    name: str
    """Its name."""
    duration_s: float
    """How much it simulates."""
    relays: list[str]
    """Their names."""
    faults: int
    """How many."""
    expectations: int
    """How many."""
    samples_per_relay: int
    """How many."""
    log_mb: float
    """Size of its log, about."""
    seconds_about: float
    """How long it takes, about."""
    user_code: list[str]
    """What code of the user's own its settings name."""
    warnings: list[str]
    """What may not be meant so."""


@told
class SettingsCheck(TypedDict):
    """`faultloop check --json` of relay settings."""

    file: str
    """The file."""
    valid: bool
    """Always true: what is wrong is an error."""
    kind: Literal["relay settings"]
    """What the file is."""
    estimator: str
    """Its method."""
    zones: list[int]
    """Their numbers."""
    user_code: list[str]
    """What code of the user's own it names."""
    warnings: list[str]
    """What may not be meant so."""


@told
class CampaignCheck(TypedDict):
    """`faultloop check --json` of a campaign."""

    file: str
    """The file."""
    valid: bool
    """Always true: what is wrong is an error."""
    kind: Literal["campaign"]
    """What the file is."""
    name: str
    """Its name."""
    cases: int
    """How many."""
    varied: list[str]
    """Keys."""
    judges: int
    """How many."""
    relays: list[str]
    """Their names."""
    core_seconds_about: float
    """Seconds of one core."""
    rests_on: str
    """What that is reckoned from."""
    file_mb_about: float
    """Size of its file."""
    keep_mb_at_most: dict[str, float]
    """By kind: size of what `--keep` keeps, before it is compressed."""
    user_code: list[str]
    """What code of the user's own its settings name."""
    warnings: list[str]
    """What may not be meant so."""
