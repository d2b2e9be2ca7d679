"""``[[relay]]``: where a relay measures; ``[front_end]``: what stands between the primary values and it."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from faultloop.config.tables import Name, NonNegative, Positive, Table

End = Literal["from", "to"]


class FrontEnd(Table):
    """``[front_end]``: what stands between the primary values and the relay's samples; all off is ideal."""

    antialias_hz: NonNegative = 0.0
    """-3 dB frequency of the Butterworth low-pass before sampling; 0 leaves it out."""
    antialias_order: Literal[2, 4] = 2
    voltage_noise_v: NonNegative = 0.0
    """RMS of the white noise on each voltage sample, primary volts."""
    current_noise_a: NonNegative = 0.0
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
    line: Name
    end: End
    breaker: Name | None = None
    settings: str = Field(min_length=1)
    """Path of the settings, relative to the scenario file."""
    voltage_at: Literal["bus", "line"] = "bus"
    """Which side of the breaker the voltage transformer is on."""
    ct: Name | None = None
    """The current transformer, a ``[[ct]]``; ideal where not given."""
    vt: Name | None = None
    """The voltage transformer, a ``[[vt]]``; ideal where not given."""
    front_end: FrontEnd | None = None
    """This relay's own, in place of the scenario's."""
