"""What a scenario file may say of faults on the bus: ``[[bus_fault]]``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Literal, get_args

from pydantic import Field, model_validator

from faultloop.config.tables import Milliseconds, Name, Seconds, Table
from faultloop.errors import InputError, nearest

PLANT = "plant"
"""The plant's name as a sender."""

BusFaultKind = Literal[
    "loss", "corruption", "delay", "duplication", "reordering",
    "bit_error", "babbling", "forging", "bus_off", "restart",
]  # fmt: skip
MessageName = Literal[
    "trip", "close", "pilot", "transfer", "differential", "breaker_status", "sampled_values", "measurements",
    "heartbeat", "time_sync",
]  # fmt: skip
FORGED = ("trip", "close", "pilot", "transfer", "differential", "breaker_status")
Content = Literal["random", "replayed", "crafted"]

STAGES = ("loss", "corruption", "delay", "duplication", "reordering")
"""Kinds that befall a frame between its sender and the bus."""

_COMMON = {"name", "kind", "start_s", "duration_s"}
_CHANCE = {"node", "message", "probability", "pattern", "burst_length"}
_KEYS: dict[str, set[str]] = {
    "loss": _CHANCE,
    "corruption": _CHANCE | {"bits"},
    "delay": _CHANCE | {"delay_ms", "jitter_ms"},
    "duplication": _CHANCE | {"copies"},
    "reordering": _CHANCE,
    "bit_error": _CHANCE,
    "babbling": {"identifier", "rate_hz", "length"},
    "forging": {"node", "message", "rate_hz", "content", "poles"},
    "bus_off": {"node"},
    "restart": {"node"},
}
_NEEDED: dict[str, tuple[str, ...]] = {
    "delay": ("delay_ms",),
    "babbling": ("identifier", "rate_hz"),
    "forging": ("node", "message", "rate_hz"),
    "bus_off": ("node", "duration_s"),
    "restart": ("node",),
}


class BusFault(Table):
    """``[[bus_fault]]``: something that goes wrong on the bus, from ``start_s`` for ``duration_s``."""

    name: Name = ""
    """For `--set` and the log, and of a babbling or forging node; B1, B2, ... where not given."""
    kind: BusFaultKind
    """What goes wrong; the other keys are each of some kinds."""
    node: Name | None = None
    """Whose frames: a relay, a breaker or "plant"; everybody's where not given.  A forger's victim."""
    message: MessageName | None = None
    """Which frames; all where not given."""
    start_s: Seconds = 0.0
    """When it begins; of a restart, when the node goes."""
    duration_s: Annotated[float, Field(gt=0, le=1e6)] | None = None
    """To the end of the run where not given; of a restart, how long the node is away."""
    probability: Annotated[float, Field(ge=0, le=1)] | None = None
    """Of each frame being hit.  Neither this nor a pattern: every frame is."""
    pattern: Annotated[str, Field(pattern=r"^[01]+$", max_length=10_000)] | None = None
    """1 hits; begins anew at its end."""
    burst_length: Annotated[float, Field(ge=1, le=1e6)] | None = None
    """With a probability: hits come in bursts of this many frames in the mean (Gilbert 1960)."""
    bits: int = Field(default=1, ge=1, le=512)
    """Of the payload, flipped in a corrupted frame."""
    delay_ms: Milliseconds = 0.0
    """Of a delayed frame; needed there."""
    jitter_ms: Milliseconds = 0.0
    """Uniformly distributed, 0 to this, added to the delay."""
    copies: int = Field(default=1, ge=1, le=100)
    """Of a duplicated frame, beside itself."""
    identifier: int = Field(default=0, ge=0, le=0x7FF)
    """Of a babbler's frames; needed there."""
    rate_hz: Annotated[float, Field(gt=0, le=100_000)] | None = None
    """Frames per second that a babbling or forging node offers."""
    length: int = Field(default=8, ge=0, le=8)
    """Bytes of a babbler's frame."""
    content: Content = "random"
    """Of a forged frame: random bytes, one heard before, or a fresh one whose E2E protection is right."""
    poles: Literal["A", "B", "C", "AB", "BC", "CA", "ABC"] = "ABC"
    """What a crafted frame says."""

    @model_validator(mode="after")
    def _keys_of_its_kind(self) -> BusFault:
        allowed = _COMMON | _KEYS[self.kind]
        for key in sorted(self.model_fields_set - allowed):
            raise ValueError(f"{key} is nothing of {self.kind}; it has {', '.join(sorted(allowed))}")
        for key in _NEEDED.get(self.kind, ()):
            if key not in self.model_fields_set or getattr(self, key) is None:
                raise ValueError(f"{self.kind} needs {key}")
        if self.kind == "forging" and self.message not in FORGED:
            raise ValueError(
                "forging: message must be trip, close, pilot, transfer, differential or breaker_status"
            )
        return self

    @model_validator(mode="after")
    def _one_chance(self) -> BusFault:
        if self.probability is not None and self.pattern is not None:
            raise ValueError("give either probability or pattern")
        if self.burst_length is not None:
            if self.probability is None:
                raise ValueError("burst_length needs a probability: the mean share of frames hit")
            most = self.burst_length / (self.burst_length + 1)
            if self.probability > most:
                raise ValueError(
                    f"probability {self.probability:g}: bursts of {self.burst_length:g} frames with at least "
                    f"one between them hit at most {most:g} of all"
                )
        return self

    @property
    def start_ns(self) -> int:
        """When it begins [ns of the run]."""
        return round(self.start_s * 1e9)

    @property
    def end_ns(self) -> int | None:
        """When it is over [ns of the run]; None: with the run."""
        return None if self.duration_s is None else round((self.start_s + self.duration_s) * 1e9)


def check_references(
    faults: Iterable[BusFault], relays: Iterable[str], breakers: Iterable[str], duration_s: float
) -> None:
    """Names that must exist, and times; raises InputError."""
    relays, breakers = list(relays), list(breakers)
    for fault in faults:
        key = f"bus_fault[{fault.name}]"
        nodes = [*relays, *breakers] if fault.kind in ("bus_off", "restart") else [*relays, *breakers, PLANT]
        if fault.kind == "forging":
            nodes = breakers if fault.message == "breaker_status" else relays
        if fault.node is not None and fault.node not in nodes:
            raise InputError(
                f"there is no node '{fault.node}'; {nearest(fault.node, nodes)}", key=f"{key}.node"
            )
        if fault.start_s >= duration_s:
            raise InputError(
                f"{fault.start_s:g} is not before the end of the run (duration_s = {duration_s:g})",
                key=f"{key}.start_s",
            )


assert set(get_args(BusFaultKind)) == set(_KEYS)
