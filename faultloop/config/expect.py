"""``[[expect]]``"""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from faultloop.config.tables import Name, NonNegative, Positive, Table

LOOPS = ("AG", "BG", "CG", "AB", "BC", "CA", "ABC")


class Expect(Table):
    """``[[expect]]``: what a relay shall do.  Times count from the first fault's start."""

    relay: Name
    """Of which it is expected."""
    trip: bool
    """Whether it shall trip, or shall not."""
    function: str | None = None
    """Of the trip, as "PDIS1"."""
    zone: int | None = Field(default=None, ge=1)
    """Of the trip."""
    loop: Literal["AG", "BG", "CG", "AB", "BC", "CA", "ABC"] | None = None
    """Of the trip; "ABC" of a three-phase fault."""
    poles: Literal["A", "B", "C", "ABC"] | None = None
    """That the trip opens."""
    within_ms: Positive | None = None
    """Received by the breaker at most this long after the fault's start."""
    after_ms: NonNegative | None = None
    """Not before this long after the fault's start."""

    @model_validator(mode="after")
    def _details_of_a_trip(self) -> Expect:
        details = ("function", "zone", "loop", "poles", "within_ms", "after_ms")
        given = [k for k in details if getattr(self, k) is not None]
        if not self.trip and given:
            raise ValueError(f"{given[0]} describes a trip and cannot stand with trip = false")
        return self
