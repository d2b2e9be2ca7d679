"""SEL settings text (SET_n.TXT): ``[section]`` and ``NAME,"value"``; 311 and 321 families, and 421."""

from __future__ import annotations

import cmath
import math
import re
from typing import Literal, NamedTuple

from faultloop.errors import InputError
from faultloop.interchange.model import Given, Loops, Taken, Zone

PAIR = re.compile(r'^\s*([A-Z][A-Z0-9_]*)\s*,\s*"((?:[^"]|"")*)"\s*$', re.I)
ZONES = range(1, 6)
READ = {
    "RELAYTYPE", "FID", "Z1MAG", "Z1ANG", "Z0MAG", "Z0ANG", "CTR", "CTRW", "PTR", "PTRY", "NFREQ", "FNOM",
    "K0M1", "K0A1",
}  # fmt: skip
OFF = ("OFF", "N", "NA", "")
DIRECTIONS: dict[str, Literal["forward", "reverse"]] = {"F": "forward", "R": "reverse"}


class _Settings:
    """The values of a file by name."""

    def __init__(self, text: str, taken: Taken) -> None:
        self.values: dict[str, str] = {}
        for line in text.splitlines():
            if (match := PAIR.match(line)) is None:
                continue
            name, value = match[1].upper(), match[2].replace('""', '"')
            if self.values.setdefault(name, value) != value:
                taken.noted.append(f"{name}: given twice; the first, {self.values[name]}, was taken")
        if not self.values:
            raise InputError('has no line NAME,"value"')

    def number(self, *names: str) -> float | None:
        """Of the first of these names that is there and not off."""
        for name in names:
            if self.values.get(name, "OFF").strip().upper() not in OFF:
                try:
                    return float(self.values[name])
                except ValueError:
                    raise InputError(f"'{self.values[name]}' should be a number", key=name) from None
        return None

    def polar(self, magnitude: str, degrees: str) -> complex | None:
        size, angle = self.number(magnitude), self.number(degrees)
        return None if size is None or angle is None else cmath.rect(size, math.radians(angle))


def read_sel(text: str, given: Given) -> Taken:
    """The distance zones of the first group that is in the file.

    Reaches are secondary ohms, delays cycles.  Raises InputError where nothing of it is a distance relay's.
    """
    taken = Taken("SEL text", secondary=True)
    own = _Settings(text, taken)
    taken.ct_ratio, taken.vt_ratio = own.number("CTRW", "CTR"), own.number("PTRY", "PTR")
    taken.frequency_hz = own.number("NFREQ", "FNOM")
    taken.z1_ohm, taken.z0_ohm = own.polar("Z1MAG", "Z1ANG"), own.polar("Z0MAG", "Z0ANG")
    taken.k0 = own.polar("K0M1", "K0A1")
    used = set(READ)
    frequency = given.frequency_hz or taken.frequency_hz
    for n in ZONES:
        phase = Names((f"Z{n}MP", f"Z{n}P"), f"XP{n}", f"RP{n}", f"Z{n}PD")
        ground = Names((f"Z{n}MG",), f"XG{n}", f"RG{n}", f"Z{n}GD")
        _zone(taken, own, n, "phase", phase, frequency)
        _zone(taken, own, n, "ground", ground, frequency)
        used |= {f"DIR{n}", *phase.all, *ground.all}
    taken.left += [f"{name} = {value}" for name, value in own.values.items() if name not in used]
    return taken.complete(given)


class Names(NamedTuple):
    """Of one zone's settings."""

    mho: tuple[str, ...]
    reactance: str
    resistance: str
    delay: str

    @property
    def all(self) -> set[str]:
        return {*self.mho, self.reactance, self.resistance, self.delay}


def _zone(taken: Taken, own: _Settings, n: int, loops: Loops, names: Names, frequency: float | None) -> None:
    reach, reactance = own.number(*names.mho), own.number(names.reactance)
    if reach is None and reactance is None:
        return
    name, toward = f"{n} {loops}", own.values.get(f"DIR{n}", "F").strip().upper()
    if taken.z1_ohm is None or toward not in DIRECTIONS:
        why = "Z1MAG and Z1ANG are missing" if taken.z1_ohm is None else f"DIR{n} = {toward}"
        taken.left.append(f"zone {name}: {why}")
        return
    cycles, resistance = own.number(names.delay), own.number(names.resistance)
    if cycles is not None and frequency is None:
        raise InputError("does not tell the nominal frequency: give --frequency 50 or 60")
    delay_s = None if cycles is None or frequency is None else cycles / frequency
    if delay_s is None:
        taken.noted.append(f"zone {name}: without {names.delay}, so it starts and does not trip")
    along = taken.z1_ohm / abs(taken.z1_ohm)
    direction, trips = DIRECTIONS[toward], delay_s is not None
    if reach is not None:
        taken.zones.append(Zone(n, name, loops, direction, reach * along, delay_s, trips))
        if reactance is not None:
            both = f"{names.reactance}, {names.resistance}"
            taken.left.append(f"zone {name}: its quadrilateral ({both}) beside its mho")
    elif reactance is not None and resistance is not None:
        point = along * reactance / along.imag
        taken.zones.append(Zone(n, name, loops, direction, point, delay_s, trips, resistance))
    else:
        taken.left.append(f"zone {name}: {names.reactance} without {names.resistance}")
