"""The unit of a key, by the end of its name."""

from __future__ import annotations

UNITS = {
    "_ohm_per_km": "ohm/km",
    "_us_per_km": "uS/km",
    "b1_us": "uS",
    "b0_us": "uS",
    "_hz_per_s": "Hz/s",
    "_ohm": "ohm",
    "_ms": "ms",
    "_us": "us",
    "_deg": "degrees",
    "_pu": "per unit",
    "_ppm": "ppm",
    "_cycles": "cycles",
    "_km": "km",
    "_kv": "kV",
    "_ka": "kA",
    "_va": "VA",
    "_mva": "MVA",
    "_nf": "nF",
    "_hz": "Hz",
    "_a": "A",
    "_v": "V",
    "_s": "s",
    "_h": "H",
    "_mw": "MW",
    "mw": "MW",
    "mvar": "Mvar",
}


def unit_of(key: str) -> str:
    """As people write it; empty where a key has none."""
    found = [tail for tail in UNITS if (key.endswith(tail) if tail.startswith("_") else key == tail)]
    return UNITS[max(found, key=len)] if found else ""
