"""What is taken of a settings file: the line, the zones, and what was not understood."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from faultloop.errors import InputError
from faultloop.interchange.shape import FittedQuad, inside

Loops = Literal["ground", "phase", "all"]
DIFFERS, ANOTHER = 0.03, 0.25
"""Part of its area by which a quadrilateral may miss a zone without a word; from which it is another zone."""


@dataclass(frozen=True)
class Given:
    """What a person says beside the file: impedances in the file's own ohms."""

    z1_ohm: complex | None = None
    z0_ohm: complex | None = None
    ct_ratio: float | None = None
    vt_ratio: float | None = None
    frequency_hz: float | None = None


@dataclass(frozen=True)
class Zone:
    """One zone, in the file's ohms.

    Attributes
    ----------
    number, name : as the file has them.
    reach : complex, along the characteristic's angle, always into the first or second quadrant.
    resistive : of a quadrilateral, the fault's own: half the arc between two phases, or to ground; None for a
        mho.
    drawn : it is of a shape in the impedance plane instead, where one to ground is divided by ``|1 + k0|``.
    tilt_deg : of its reactance line, positive where it falls towards the resistive side.
    differs : part of its area by which it misses the file's own shape.
    shape : the corners of the file's own shape, where it draws one.
    """

    number: int
    name: str
    loops: Loops
    direction: Literal["forward", "reverse", "none"]
    reach: complex
    delay_s: float | None
    trips: bool = True
    resistive: float | None = None
    drawn: bool = False
    tilt_deg: float = 0.0
    differs: float = 0.0
    shape: tuple[complex, ...] = ()


@dataclass
class Taken:
    """What a file comes to.  ``left`` : what of it was not taken, and why; ``noted`` : what to look at."""

    kind: str
    secondary: bool
    frequency_hz: float | None = None
    ct_ratio: float | None = None
    vt_ratio: float | None = None
    z1_ohm: complex | None = None
    z0_ohm: complex | None = None
    k0: complex | None = None
    zones: list[Zone] = field(default_factory=list)
    left: list[str] = field(default_factory=list)
    noted: list[str] = field(default_factory=list)

    def complete(self, given: Given) -> Taken:
        """With what was given beside the file; InputError where something is still unknown."""
        self.frequency_hz = given.frequency_hz or self.frequency_hz
        self.ct_ratio = given.ct_ratio or self.ct_ratio
        self.vt_ratio = given.vt_ratio or self.vt_ratio
        self.z1_ohm = self.z1_ohm if given.z1_ohm is None else given.z1_ohm
        self.z0_ohm = self.z0_ohm if given.z0_ohm is None else given.z0_ohm
        if self.z1_ohm is None:
            raise InputError("does not tell the line's impedance: give --z1 R,X in the file's ohms")
        if self.z0_ohm is None and self.k0 is not None:
            self.z0_ohm = self.z1_ohm * (1 + 3 * self.k0)
        if self.z0_ohm is None:
            raise InputError("does not tell the line's zero-sequence impedance: give --z0 R,X")
        if self.frequency_hz is None:
            raise InputError("does not tell the nominal frequency: give --frequency 50 or 60")
        if self.secondary and (self.ct_ratio is None or self.vt_ratio is None):
            raise InputError(
                "is in secondary ohms and does not tell both ratios: give --ct-ratio and --vt-ratio"
            )
        if not self.zones:
            raise InputError(
                f"has no zone that could be taken: {'; '.join(self.left[:3]) or 'none is in it'}"
            )
        return self

    def add_polygon(
        self, number: int, name: str, loops: Loops, points: list[complex], delay_s: float | None,
        angle: float | None, *, trips: bool = True,
    ) -> None:  # fmt: skip
        """A zone by its corners: the quadrilateral that has its reach, its right side and its tilt."""
        corners = np.array(points)
        if len(corners) < 3 or not np.isfinite(corners).all():
            self.left.append(f"zone {name}: a shape of {len(corners)} corners")
            return
        middle = corners.mean()
        if inside(np.array([0j]), corners)[0] and abs(middle) < 0.05 * np.abs(corners).max():
            direction: Literal["forward", "reverse", "none"] = "none"
        else:
            direction = "reverse" if middle.imag < 0 else "forward"
        mirrored = -corners if direction == "reverse" else corners
        along = angle if angle is not None else cmath.phase(self.z1_ohm or 1j)
        fitted = FittedQuad.of(mirrored, along, direction == "none")
        if fitted is None:
            self.left.append(f"zone {name}: its shape has no reach along {math.degrees(along):.1f} degrees")
            return
        if fitted.differs > ANOTHER:
            self.left.append(
                f"zone {name}: a quadrilateral would miss {100 * fitted.differs:.0f} % of its area"
            )
            return
        if fitted.differs > DIFFERS:
            self.noted.append(
                f"zone {name}: the quadrilateral misses {100 * fitted.differs:.0f} % of its area; same reach"
                " along the line, same right side"
            )
        self.zones.append(
            Zone(
                number, name, loops, direction, cmath.rect(fitted.reach, along), delay_s, trips,
                fitted.resistive, True, fitted.tilt_deg, fitted.differs, tuple(points),
            )
        )  # fmt: skip
