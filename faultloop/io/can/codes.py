"""Why a frame is refused, as the numbers of the kernels: `Rejection.code`; `FINE` is none."""

from __future__ import annotations

FINE = 0
(
    UNKNOWN_ID,
    FORMAT,
    LENGTH,
    NOT_AUTHENTICATED,
    TAG,
    CRC,
    VALUE,
    TEST,
    STALE,
    BEFORE_START,
    OLD,
    INCONSISTENT,
    SEQUENCE,
    SETTINGS,
    JUMP,
) = range(1, 16)
