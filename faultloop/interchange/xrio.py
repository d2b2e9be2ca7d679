"""XRIO: nested blocks and parameters of the makers' own names; ABB's ZMFPDIS and ZMQPDIS, MiCOM's zones."""

from __future__ import annotations

import cmath
import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator

from faultloop.errors import InputError
from faultloop.interchange.model import Given, Loops, Taken, Zone

MOST_PARAMETERS = 200_000
Parameters = dict[tuple[str, ...], str]


def read_xrio(text: str, given: Given) -> Taken:
    """The distance zones.  Raises InputError where it is no XML, or has none of the names that are known."""
    if re.search(r"<!(DOCTYPE|ENTITY)", text[:100_000], re.I):
        raise InputError("has a document type: not read, as entities could be anything")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"is not whole XML: {error}") from error
    found: Parameters = {}
    for path, value in _parameters(root, ()):
        found.setdefault(path, value)
        if len(found) > MOST_PARAMETERS:
            raise InputError(f"has more than {MOST_PARAMETERS} parameters")
    taken = Taken("XRIO", secondary=False)
    used: set[tuple[str, ...]] = set()
    if any(re.match(r"ZM[FQ]\w*PDIS", name) for path in found for name in path):
        taken.kind = "XRIO, ABB"
        _abb(taken, found, used)
    elif any(re.fullmatch(r"Z\d Ph\. Reach", path[-1]) for path in found):
        taken.kind, taken.secondary = "XRIO, MiCOM", True
        _micom(taken, found, used)
    else:
        raise InputError("has neither ABB's ZMFPDIS nor MiCOM's 'Z1 Ph. Reach'")
    left = sorted(path for path in found if path not in used)
    taken.left += [" > ".join(path) for path in left[:200]]
    if len(left) > 200:
        taken.left.append(f"and {len(left) - 200} parameters more")
    return taken.complete(given)


def _parameters(node: ElementTree.Element, place: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], str]]:
    for child in node:
        kind = child.tag.rpartition("}")[2]
        name = _name(child)
        if kind == "Parameter" and name is not None:
            value = child.find("{*}Value")
            value = child.find("Value") if value is None else value
            yield (*place, name), (value.text or "").strip() if value is not None else ""
        elif len(place) < 40:
            yield from _parameters(child, (*place, name) if name is not None else place)


def _name(node: ElementTree.Element) -> str | None:
    own = node.find("{*}Name")
    own = node.find("Name") if own is None else own
    return own.text.strip() if own is not None and own.text else node.get("Name")


class _Values:
    """Numbers by the last name of a path, in the blocks that have all of some names in theirs."""

    def __init__(self, found: Parameters, used: set[tuple[str, ...]], within: tuple[str, ...] = ()) -> None:
        self._found, self._used, self._within = found, used, within

    def text(self, *names: str) -> str | None:
        for name in names:
            for path, value in self._found.items():
                if path[-1] == name and set(self._within) <= set(path):
                    self._used.add(path)
                    return value
        return None

    def number(self, *names: str) -> float | None:
        text = self.text(*names)
        if text is None:
            return None
        match = re.match(r"\s*([-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?)", text)
        if match is None:
            raise InputError(f"'{text[:40]}' should be a number", key=names[0])
        value = float(match[1].replace(",", "."))
        return value / 1000 if re.search(r"\dms\b|\d ms\b", text) else value


def _abb(taken: Taken, found: Parameters, used: set[tuple[str, ...]]) -> None:
    """Reaches in primary ohm a phase, resistances in ohm a loop; the zone's number is in the names."""
    blocks = sorted({name for path in found for name in path if re.match(r"ZM[FQ]\w*PDIS", name)})
    block = blocks[0]
    if len(blocks) > 1:
        taken.left.append(f"{', '.join(blocks[1:])}: {block} was taken")
    values = _Values(found, used, (block,))
    for n in range(1, 8):
        for loops, short, per_loop in (("phase", "PP", 2.0), ("ground", "PE", 1.0)):
            x = values.number(f"X1{short}Z{n}", f"X1FW{short}Z{n}")
            if x is None:
                continue
            r1 = values.number(f"R1{short}Z{n}", f"R1FW{short}Z{n}")
            resistance = values.number(f"RF{short}Z{n}", f"RFFW{short}Z{n}")
            delay, mode = values.number(f"t{short}Z{n}"), values.text(f"OpMode{short}Z{n}")
            toward = (values.text(f"DirMode{short}Z{n}", f"DirModeZ{n}", f"OpDir{n}") or "Forward").lower()
            name = f"{n} {loops}"
            if mode is not None and mode.lower() in ("disable", "disabled", "off", "0"):
                taken.left.append(f"zone {name}: off")
                continue
            line = taken.z1_ohm
            if r1 is None and line is None:
                taken.noted.append(f"zone {name}: without R1{short}Z{n} its angle is taken as 80 degrees")
            reach = complex(r1, x) if r1 is not None else x * complex(math.tan(math.radians(10)), 1)
            if resistance is None:
                taken.left.append(f"zone {name}: no RF{short}Z{n}")
                continue
            direction = "reverse" if "rev" in toward else "none" if "non" in toward else "forward"
            loops_of: Loops = "phase" if loops == "phase" else "ground"
            taken.zones.append(
                Zone(n, name, loops_of, direction, reach, delay, delay is not None, resistance / per_loop)
            )
    taken.ct_ratio, taken.vt_ratio = values.number("CTRatio"), values.number("VTRatio")
    everywhere = _Values(found, used)
    taken.frequency_hz = everywhere.number("Rated Frequency", "FreqRated", "fn")


def _micom(taken: Taken, found: Parameters, used: set[tuple[str, ...]]) -> None:
    """The active group; reaches in secondary ohm, resistances in such of a loop; zone 4 looks back."""
    everywhere = _Values(found, used)
    active = everywhere.text("Active Settings")
    groups = sorted({name for path in found for name in path if re.fullmatch(r"GROUP \d", name, re.I)})
    digit = re.search(r"\d", active or "")
    group = next((g for g in groups if digit and g.endswith(digit[0])), groups[0] if groups else None)
    values = _Values(found, used, () if group is None else (group,))
    magnitude, degrees = values.number("Line Impedance"), values.number("Line Angle")
    if magnitude is not None and degrees is not None:
        taken.z1_ohm = cmath.rect(magnitude, math.radians(degrees))
    size, turn = (
        values.number("kZN Res Comp", "kZN1 Res Comp"),
        values.number("kZN Res Angle", "kZN1 Res Angle"),
    )
    if size is not None and turn is not None:
        taken.k0 = cmath.rect(size, math.radians(turn))
    taken.frequency_hz = everywhere.number("Frequency")
    for key, primary, secondary in (
        ("ct_ratio", "Phase CT Primary", "Phase CT Sec'y"),
        ("vt_ratio", "Main VT Primary", "Main VT Sec'y"),
    ):
        a, b = everywhere.number(primary), everywhere.number(secondary)
        if a and b:
            setattr(taken, key, a / b)
    for n in range(1, 5):
        for loops, short, resistive in (("phase", "Ph.", "Resistive"), ("ground", "Gnd.", "Resistive")):
            reach = values.number(f"Z{n} {short} Reach")
            if reach is None:
                continue
            angle = values.number(f"Z{n} {short} Angle")
            along = None if angle is None else math.radians(angle)
            if along is None:
                if taken.z1_ohm is None:
                    taken.left.append(f"zone {n} {loops}: neither its angle nor the line's is there")
                    continue
                along = cmath.phase(taken.z1_ohm)
            resistance = values.number(f"R{n} {short} {resistive}")
            delay = values.number(f"tZ{n} {short} Delay")
            loops_of: Loops = "phase" if loops == "phase" else "ground"
            own = None if resistance is None else resistance / (2.0 if loops == "phase" else 1.0)
            point, name = cmath.rect(reach, along), f"{n} {loops}"
            taken.zones.append(
                Zone(
                    n,
                    name,
                    loops_of,
                    "reverse" if n == 4 else "forward",
                    point,
                    delay,
                    delay is not None,
                    own,
                )
            )
            if resistance is None:
                taken.noted.append(f"zone {n} {loops}: a mho; by memory polarized, unless changed")
