"""What makers say of their relays, as their manuals print it.

Makers' times include the output contact; ours end where the breaker receives the trip frame.
"""

from __future__ import annotations

from typing import NamedTuple


class Claim(NamedTuple):
    """One figure of a maker."""

    relay: str
    what: str
    condition: str
    figure: str


STATIC = (
    Claim("SEL-421", "static accuracy", "SIR below 30", "3 %"),
    Claim("SEL-421", "static accuracy", "SIR 30 to 60", "5 %"),
    Claim("REL670, RED650 ZMFPDIS", "static accuracy", "60255-121 points, shots", "2 %"),
    Claim("MiCOM P54x, P44x", "static accuracy", "on the angle, SIR to 30", "5 %"),
    Claim("MiCOM P54x, P44x", "static accuracy", "off the angle, SIR to 30", "10 %"),
    Claim("7SA522", "static accuracy", "X, R, Z", "5 %"),
)
OVERREACH = (
    Claim("SEL-421", "transient overreach", "plus static accuracy", "below 5 %"),
    Claim("REL670, RED650 ZMFPDIS", "dynamic overreach", "85 degrees, CVT, SIR 0.5 to 30", "below 5 %"),
    Claim("Costello and Zimmerman (2012)", "largest secure reach", "active CVT, SIR 18", "7 % of the line"),
)
DIRECTION = (Claim("REL670, RED650 ZMFPDIS", "directional accuracy", "angle", "2 degrees"),)
