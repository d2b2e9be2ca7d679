"""``[iec61850]``"""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from faultloop.config.tables import Table

SampledValuesProfile = Literal["9-2LE", "F4000S1I4U4", "F4800S2I4U4", "F14400S6I4U4"]


class Iec61850(Table):
    """``[iec61850]``: what GOOSE and Sampled Values carry, on an interface or in a file."""

    sampled_values: SampledValuesProfile | None = None
    """Left out: what fits ``sampling_hz``, 9-2LE first."""
    vlan_id: int = Field(default=0, ge=0, le=4095)
    """Of the tag of IEEE 802.1Q; 0 is a tag of priority alone."""
    vlan_priority: int = Field(default=4, ge=0, le=7)
    """Of the same tag."""
    simulation: bool = False
    """Every message is published with the simulation flag set."""
    accept_simulation: bool = False
    """LPHD.Sim of every node: of a stream with simulated messages these count, and from the first one on no
    others."""
