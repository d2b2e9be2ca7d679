"""Whether a current has collapsed, as that of a transformer whose core is full.

Its secondary current then falls to next to nothing within a millisecond or two, at any point of the wave,
and rests there until the primary one has changed sides.  What flows in the line can do that at no point, as
it is a sinusoid with an offset: in a sixteenth of a cycle it falls by 0.39 of its crest at most, and by 0.34
where it is then to stay below for a tenth.  What rings beside it falls faster, but does not rest.

The voltage goes on meanwhile.  So the loop in time (`loop_fit`), most of whose window still has the right
current, finds a resistance where there is none: for bolted faults at the far bus, behind a current that
collapses 3 to 9 ms after the fault, m of 0.01 to 0.4 with 0.6 to 1.7 times the reach as resistance and 0.11
to 0.19 left, as soon as that counts four times (bench/ct_saturation.py, seed 1: 15 of 3,671).
"""

from __future__ import annotations

from typing import Any

from faultloop.jit import njit
from faultloop.relay.loop_fit import FIRST, SECOND
from faultloop.relay.recent import LENGTH

Record = Any
FALLS, RESTS = 16, 10
"""Parts of a cycle in which it falls, and for which it then stays down at least."""
COLLAPSE = 0.5
"""Of its largest value in the last cycle: a fall that is no sinusoid's.  Of those that started zone 1 the
least was 0.56.  Of 1,426 right starts behind ideal transformers, on lines of 10 to 300 km, 31 had more than
this, none of them with a resistance above a quarter of the reach and enough left to matter; of 61 with more
than 0.45 six had (bench/security.py, seed 97030)."""


@njit
def has_collapsed(g: Record, r: Record, phase: int, length: int) -> bool:
    """Whether the phase's current has, within the last ``length`` values, of which a cycle count; unknown,
    so no, where a sixteenth of a cycle is less than a value."""
    if g.values < FALLS:
        return False
    rest = max(g.values // RESTS, 1)
    falls = max(g.values // FALLS, 1)
    peak = 0.0
    for j in range(g.values):
        peak = max(peak, abs(r.value[(r.head - j) % LENGTH, 3 + phase]))
    for j in range(rest - 1, min(length, g.values) - falls):
        least = abs(r.value[(r.head - j - falls) % LENGTH, 3 + phase]) - COLLAPSE * peak
        if least <= 0.0:
            continue
        k = 0
        while k < rest and abs(r.value[(r.head - j + k) % LENGTH, 3 + phase]) < least:
            k += 1
        if k == rest:
            return True
    return False


@njit
def is_saturated(g: Record, r: Record, loop: int, length: int) -> bool:
    """Whether any current of a loop has collapsed."""
    if has_collapsed(g, r, FIRST[loop], length):
        return True
    return loop >= 3 and has_collapsed(g, r, SECOND[loop], length)


@njit
def has_any_collapsed(g: Record, r: Record) -> bool:
    """Whether any phase's current has within the last cycle."""
    return (
        has_collapsed(g, r, 0, g.values)
        or has_collapsed(g, r, 1, g.values)
        or has_collapsed(g, r, 2, g.values)
    )
