"""What a scenario file may say of the time on its bus: ``[time_sync]``."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from faultloop.config.tables import NonNegative, Positive, Seconds, Table

PERIODS = 3.5
"""Without a follow-up, after which a node has no time where nothing else is said."""


class TimeSync(Table):
    """``[time_sync]``: the plant tells the time by AUTOSAR's SYNC and follow-up, and relays follow it.

    A relay's `[[clock]]` then is its oscillator, which drifts all the time; from `lost_at_s` on it hears
    none.
    """

    period_s: Annotated[float, Field(ge=0.005, le=10)] = 0.1
    """From one SYNC to the next."""
    domain: int = Field(default=0, ge=0, le=15)
    """Of the time base."""
    timeout_s: Annotated[float, Field(gt=0, le=60)] | None = None
    """Without a follow-up for so long a relay has no time; 3.5 periods where not given."""
    jump_us: Positive = 500.0
    """A time that differs by more from the relay's clock is refused, and the relay has none, until it has
    been told for `timeout_s`."""
    jitter_us: NonNegative = 0.0
    """Of every stamp, uniform to both sides."""
    out_at_s: Seconds | None = None
    """From then on the plant tells no time ..."""
    out_for_s: Annotated[float, Field(gt=0, le=1e6)] | None = None
    """... for so long; to the end where not given."""
    step_at_s: Seconds | None = None
    """From then on the plant's time is another ..."""
    step_us: Annotated[float, Field(ge=-1e6, le=1e6)] = 0.0
    """... by so much."""

    @model_validator(mode="after")
    def _complete(self) -> TimeSync:
        if self.timeout_s is not None and self.timeout_s <= self.period_s:
            raise ValueError(f"timeout_s must be above period_s, {self.period_s:g} s, not {self.timeout_s:g}")
        if self.out_for_s is not None and self.out_at_s is None:
            raise ValueError("out_for_s needs out_at_s")
        if (self.step_at_s is None) != (self.step_us == 0):
            raise ValueError("step_at_s and step_us go together")
        return self

    @property
    def timeout(self) -> float:
        """`timeout_s`, or what stands for it [s]."""
        return PERIODS * self.period_s if self.timeout_s is None else self.timeout_s

    @property
    def outage_ns(self) -> tuple[int, int] | None:
        """From when to when no time is told [ns]."""
        if self.out_at_s is None:
            return None
        start = round(self.out_at_s * 1e9)
        return start, 2**62 if self.out_for_s is None else start + round(self.out_for_s * 1e9)

    @property
    def step_ns(self) -> tuple[int, int] | None:
        """When the time steps, and by how much [ns]."""
        return None if self.step_at_s is None else (round(self.step_at_s * 1e9), round(self.step_us * 1e3))
