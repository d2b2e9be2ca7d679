"""What run and replay print with ``--json``."""

from __future__ import annotations

from typing_extensions import TypedDict

from faultloop.cli.printed.told import told


@told
class FaultChange(TypedDict):
    """A fault applied, or gone."""

    fault: str
    """The scenario's name of it."""
    type: str
    """`AG`, `BCG`, `ABC` ..."""
    on: bool
    """Applied; false: gone."""
    t_s: float
    """When."""


@told
class Trip(TypedDict):
    """A trip on its way from the relay to the breaker."""

    relay: str
    """Who tripped."""
    function: str
    """What decided it, `PDIS1`."""
    zone: int
    """The zone, 0 where it has none."""
    loop: str
    """`AG`, `BC`; empty where there is none."""
    poles: str
    """The poles to open, `A`, `ABC`."""
    sample_count: int
    """The deciding sample's number."""
    decided_s: float
    """When the relay decided."""
    breaker: str | None
    """Whom it is for."""
    received_s: float | None
    """When the breaker had the frame; null: never."""
    opened_s: float | None
    """When the last commanded pole was open; null: never."""
    trip_time_ms: float | None
    """From the first fault's start to the breaker's reception; null without either."""


@told
class Bus(TypedDict):
    """The CAN bus of a run."""

    frames: int
    """How many were on it."""
    load: float | None
    """Part of the time in which it was busy, 0 to 1; null on a real bus."""


@told
class Percentiles(TypedDict):
    """Of durations [ms of wall time]; null where there were none."""

    count: int
    """How many."""
    median: float | None
    """Half are shorter."""
    p95: float | None
    """95 % are shorter."""
    p99: float | None
    """99 % are shorter."""
    greatest: float | None
    """The longest."""


@told
class Pacing(TypedDict):
    """How well a run at the clock's pace kept time."""

    pace: float
    """Run time in a second of wall time."""
    samples: int
    """Of the plant; in one process blocks of about a millisecond."""
    missed: int
    """Of these, later than the next was due."""
    jitter: Percentiles
    """How late they were."""
    reaction: Percentiles
    """From the sample that a relay tripped at to its breaker's taking the frame."""
    latency: dict[str, Percentiles]
    """By relay: from a sample to the relay's having worked on it."""
    lost: dict[str, int]
    """By relay: sampled values that did not arrive."""
    dropped: dict[str, int]
    """By node: frames that the kernel could not keep."""
    retries: dict[str, int]
    """By node: how often a transmit queue was full."""


@told
class Expectation(TypedDict):
    """An `[[expect]]` of the scenario."""

    relay: str
    """Of which relay."""
    trip: bool
    """Whether it was to trip."""
    held: bool
    """Whether that, and what else was asked, held."""
    why: str
    """What happened, in words."""


@told
class RunEvent(TypedDict):
    """What a node said."""

    t_s: float
    """When."""
    source: str
    """Who."""
    level: str
    """DEBUG, INFO, WARNING, ERROR or FATAL."""
    text: str
    """What."""


@told
class Run(TypedDict):
    """`faultloop run --json`."""

    scenario: str
    """Its name."""
    held: bool
    """Whether all that it expects held."""
    interrupted: bool
    """Ended before its time; the log is whole."""
    simulated_s: float
    """How much time was simulated."""
    wall_s: float
    """How long that took, without compilation."""
    log: str | None
    """The log written."""
    faults: list[FaultChange]
    """In order of time."""
    trips: list[Trip]
    """In order of time."""
    fault_locations_pu: dict[str, float | None]
    """By relay: part of its line; null where none was found."""
    can: Bus
    """The bus."""
    pacing: Pacing | None
    """How time was kept; null in a run that was not paced."""
    died: list[str]
    """Of a run as processes: nodes that ended before it did."""
    warnings: list[str]
    """What may not be meant so."""
    expectations: list[Expectation]
    """Each `[[expect]]`."""
    events: list[RunEvent]
    """In order of time."""


@told
class ReplayTrip(TypedDict):
    """A trip of a relay that a record was played into."""

    function: str
    """What decided it, `PDIS1`."""
    zone: int
    """The zone, 0 where it has none."""
    loop: str
    """`AG`, `BC`; empty where there is none."""
    poles: str
    """The poles to open."""
    sample_count: int
    """The deciding sample's number."""
    t_s: float
    """When, from the first sample played."""


@told
class ReplayEvent(TypedDict):
    """What the relay said."""

    t_s: float
    """When, from the first sample played."""
    level: str
    """DEBUG, INFO, WARNING, ERROR or FATAL."""
    text: str
    """What."""


@told
class Replay(TypedDict):
    """`faultloop replay --json`."""

    record: str
    """The file."""
    duration_s: float
    """How much of it was played."""
    interrupted: bool
    """Ended before its end; the log is whole."""
    log: str | None
    """The log written."""
    tripped: bool
    """Whether the relay did."""
    trips: list[ReplayTrip]
    """In order of time."""
    fault_location_pu: float | None
    """Part of the line; null where none was found."""
    pickup_s: dict[str, float]
    """By function: when it first started."""
    operate_s: dict[str, float]
    """By function: when it first operated."""
    notes: list[str]
    """How the record was read."""
    warnings: list[str]
    """What to doubt."""
    events: list[ReplayEvent]
    """In order of time."""
