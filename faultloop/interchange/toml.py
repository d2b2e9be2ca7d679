"""What was taken, as a settings file of faultloop."""

from __future__ import annotations

from typing import Any

from faultloop.config.toml_text import toml_text
from faultloop.interchange.model import Taken, Zone


def settings_dict(taken: Taken) -> dict[str, Any]:
    """The settings, as `faultloop.RelaySettings.from_dict` takes them."""
    assert taken.z1_ohm is not None and taken.z0_ohm is not None and taken.frequency_hz is not None
    relay: dict[str, Any] = {"frequency_hz": _short(taken.frequency_hz)}
    if taken.secondary:
        relay |= {"ohms": "secondary", "ct_ratio": _short(taken.ct_ratio), "vt_ratio": _short(taken.vt_ratio)}
    line = {"z1_ohm": _pair(taken.z1_ohm), "z0_ohm": _pair(taken.z0_ohm)}
    k0 = (taken.z0_ohm - taken.z1_ohm) / (3 * taken.z1_ohm) if taken.k0 is None else taken.k0
    zones = [_zone(zone, abs(1 + k0)) for zone in taken.zones]
    trips = sorted({zone.number for zone in taken.zones if zone.trips})
    found: dict[str, Any] = {"relay": relay, "line": line, "pdis": zones, "ptrc": {"zones": trips}}
    if taken.k0 is not None:
        for zone in zones:
            zone["residual_compensation_factor"] = _pair(taken.k0)
    return found


def settings_text(taken: Taken, source: str) -> str:
    """The same as TOML, with what was not taken as comments on top."""
    head = [f"Taken from {source} ({taken.kind})."]
    head += [f"Look at: {line}" for line in taken.noted]
    head += [f"Not taken: {line}" for line in taken.left]
    comments = "".join(f"# {_printable(line)}\n" for line in head)
    return comments + "\n" + toml_text(settings_dict(taken))


def _zone(zone: Zone, one_plus_k0: float) -> dict[str, Any]:
    import cmath
    import math

    found: dict[str, Any] = {"zone": zone.number}
    if zone.direction != "forward":
        found["direction"] = zone.direction
    if zone.loops != "all":
        found["loops"] = zone.loops
    found |= {
        "reach_ohm": _short(abs(zone.reach)),
        "angle_deg": _short(math.degrees(cmath.phase(zone.reach))),
    }
    if zone.resistive is not None:
        found |= {"characteristic": "quad", "tilt_deg": _short(zone.tilt_deg)}
        found["resistive_reach_ohm"] = _short(zone.resistive)
        if zone.loops != "phase":
            found["resistive_reach_ground_ohm"] = _short(
                zone.resistive * (one_plus_k0 if zone.drawn else 1.0)
            )
    if zone.delay_s is not None:
        found["delay_ms"] = _short(1e3 * zone.delay_s)
    return found


def _short(value: float | None) -> float:
    assert value is not None
    rounded = float(f"{value:.9g}")
    return int(rounded) if rounded.is_integer() else rounded


def _pair(z: complex) -> list[float]:
    return [_short(z.real), _short(z.imag)]


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in text)[:300]
