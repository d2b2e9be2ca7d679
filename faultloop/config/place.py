"""``[[relay]]``: where a relay measures; ``[front_end]``: what stands between the primary values and it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from pydantic import Field, model_validator

from faultloop.config.tables import Name, NonNegative, Positive, Table

End = Literal["from", "to"]


class FrontEnd(Table):
    """``[front_end]``: what stands between the primary values and the relay's samples; all off is ideal."""

    antialias_hz: NonNegative = 0.0
    """-3 dB frequency of the Butterworth low-pass before sampling; 0 leaves it out."""
    antialias_order: Literal[2, 4] = 2
    """Of the low-pass."""
    voltage_noise_v: NonNegative = 0.0
    """RMS of the white noise on each voltage sample, primary volts."""
    current_noise_a: NonNegative = 0.0
    """The same of each current sample, primary amperes."""
    adc_bits: int = Field(default=0, ge=0, le=32)
    """Of the converter, sign included; 0 leaves quantization and clipping out."""
    voltage_full_scale_v: Positive | None = None
    """Peak, primary; 2 times the rated phase voltage's peak where not given."""
    current_full_scale_a: Positive | None = None
    """Peak, primary; needed with adc_bits."""

    @model_validator(mode="after")
    def _full_scale(self) -> FrontEnd:
        if self.adc_bits == 1:
            raise ValueError("adc_bits must be 0 (off) or from 2 to 32, not 1")
        if self.adc_bits and self.current_full_scale_a is None:
            raise ValueError("adc_bits needs current_full_scale_a (peak primary amperes)")
        return self


class RelayPlace(Table):
    """``[[relay]]``: where a relay measures, which breaker it trips, and its settings file."""

    name: Name
    """Its name."""
    line: Name
    """The line that it protects; its current is positive into the line."""
    end: End
    """The end of the line at which it measures."""
    breaker: Name | None = None
    """The one it trips and follows; none where not given."""
    settings: str = Field(min_length=1)
    """Path of the settings, relative to the scenario file."""
    voltage_at: Literal["bus", "line"] = "bus"
    """Which side of the breaker the voltage transformer is on."""
    ct: Name | None = None
    """The current transformer, a ``[[ct]]``; ideal where not given."""
    vt: Name | None = None
    """The voltage transformer, a ``[[vt]]``; ideal where not given."""
    synchro_vt: bool = False
    """There is a voltage transformer on the breaker's other side, too: for synchrocheck."""
    parallel: Name | None = None
    """The relay of the parallel line at the same end, whose residual current it measures, too."""
    back_trip: tuple[Name, ...] = Field(default=(), strict=False)
    """Breakers that are told to open when its own has failed: those around it."""
    front_end: FrontEnd | None = None
    """This relay's own, in place of the scenario's."""


def more_rows(places: Sequence[RelayPlace]) -> list[tuple[int, int]]:
    """Per relay the rows of the plant's samples that it measures beside its own: of the breaker's other
    side, which follow the relays', and of the parallel line's relay; -1 for none."""
    names = [place.name for place in places]
    behind = iter(range(len(places), measured_rows(places)))
    return [
        (
            next(behind) if place.synchro_vt else -1,
            -1 if place.parallel is None else names.index(place.parallel),
        )
        for place in places
    ]


def measured_rows(places: Sequence[RelayPlace]) -> int:
    """How many places the plant measures at."""
    return len(places) + sum(place.synchro_vt for place in places)
