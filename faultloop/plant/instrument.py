"""What `[[ct]]` and `[[vt]]` have alike: a circuit to the relay that opens in the run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from faultloop.config.tables import Poles, Positive, Seconds
from faultloop.jit import njit
from faultloop.plant.component import Component, PlantTables
from faultloop.plant.elements import Floats, Ints

FOREVER = 2**62


class Instrument(Component):
    """A transformer between the network, on which it has no effect, and a relay."""

    first: ClassVar[int]
    """Channel of its phase A: 0 of voltages, 3 of currents."""

    ratio: Annotated[tuple[Positive, Positive], Field(strict=False)]
    """[primary, secondary] volts or amperes."""
    open_at_s: Seconds | None = None
    """From then on its circuit to the relay is open, as by a blown fuse: nothing is measured ..."""
    open_for_s: Annotated[float, Field(gt=0, le=1e6)] | None = None
    """... for so long; to the end where not given ..."""
    open_phases: Poles = "ABC"
    """... in these phases."""

    @model_validator(mode="after")
    def _open(self) -> Self:
        if self.open_at_s is None and (self.open_for_s is not None or self.open_phases != "ABC"):
            raise ValueError("open_for_s and open_phases need open_at_s")
        return self

    def check(self, tables: PlantTables) -> None:
        if self.open_at_s is not None:
            tables.within_run(self.open_at_s, self.key("open_at_s"))

    def beginning_at(self, begins_s: float, tables: PlantTables) -> Self | None:
        """A circuit that is open then is open from the beginning."""
        if self.open_at_s is None:
            return self
        whole_s = math.inf if self.open_for_s is None else self.open_at_s + self.open_for_s - begins_s
        if whole_s <= 0:
            return self.model_copy(update={"open_at_s": None, "open_for_s": None, "open_phases": "ABC"})
        update = {"open_at_s": max(self.open_at_s - begins_s, 0.0)}
        if self.open_for_s is not None:
            update["open_for_s"] = whole_s - update["open_at_s"]
        return self.model_copy(update=update)


def open_circuits(instruments: Sequence[tuple[int, Instrument]], rate: float) -> Ints:
    """(n, 4) of those among ``instruments`` (relay's number, transformer) whose circuits open: relay, mask of
    channels, first step, first one after it."""
    rows = []
    for relay, own in instruments:
        if own.open_at_s is not None:
            end = FOREVER if own.open_for_s is None else round((own.open_at_s + own.open_for_s) * rate)
            channels = sum(1 << own.first + "ABC".index(phase) for phase in own.open_phases)
            rows.append([relay, channels, round(own.open_at_s * rate), end])
    return np.array(rows, dtype=np.int64).reshape(-1, 4)


@njit
def open_step(circuits: Ints, step: int, x: Floats) -> None:
    """What an open circuit takes away of the channels in ``x`` (relays, 6), in place."""
    for k in range(circuits.shape[0]):
        if circuits[k, 2] <= step < circuits[k, 3]:
            for channel in range(6):
                if circuits[k, 1] >> channel & 1:
                    x[circuits[k, 0], channel] = 0.0
