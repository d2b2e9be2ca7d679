"""RIO: text of nested BEGIN ... END blocks, in two families (TESTOBJECT and PROTECTIONDEVICE)."""

from __future__ import annotations

import cmath
import math
import re
from dataclasses import dataclass, field

import numpy as np

from faultloop.errors import InputError
from faultloop.interchange.model import Given, Loops, Taken, Zone
from faultloop.interchange.shape import arc, cut, everything

DEEPEST = 20
LOOPS: dict[str, Loops] = {"LN": "ground", "LL": "phase", "ALL": "all"}
UNDERSTOOD = {
    "DEVICE": {"NAME", "VNOM", "VPRIM-LL", "INOM", "IPRIM", "FNOM"},
    "DISTANCE": {"LINEANGLE", "IMPPRIM", "KL", "Z0Z1", "RERL_XEXL"},
    "ZONE": {"INDEX", "LABEL", "NAME", "TYPE", "FAULTLOOP", "TRIPTIME", "ACTIVE", "TIME1", "TIMEM"},
    "PROTECTIONDEVICE": {"DEVICE", "RATING", "LINEANGLE", "RE/RL", "XE/XL", "DIRCHAR"},
}


@dataclass
class Block:
    """One block: its entries in order, and the blocks in it."""

    name: str
    entries: list[tuple[str, str]] = field(default_factory=list)
    blocks: list[Block] = field(default_factory=list)

    def text(self, key: str) -> str | None:
        return next((value for name, value in self.entries if name == key), None)

    def numbers(self, key: str, count: int | None = None) -> list[float] | None:
        """The numbers of an entry; None where there is none, InputError where they are not numbers."""
        text = self.text(key)
        if text is None:
            return None
        found = numbers(text)
        if found is None or (count is not None and len(found) < count):
            raise InputError(f"{self.name} {key}: '{text[:40]}' should be {_COUNTS.get(count, 'numbers')}")
        return found

    def all(self, *names: str) -> list[Block]:
        return [block for block in self.blocks if block.name in names]


_COUNTS = {1: "a finite number", 2: "two finite numbers", None: "finite numbers"}


def numbers(text: str) -> list[float] | None:
    parts = [part for part in re.split(r"[,;\s]+", text.strip()) if part]
    try:
        found = [float(part) for part in parts]
    except ValueError:
        return None
    return found if found and all(map(math.isfinite, found)) else None


def parse(text: str) -> Block:
    """The tree of blocks.  InputError where BEGIN and END do not match."""
    root = Block("")
    stack = [root]
    for number, line in enumerate(text.splitlines(), 1):
        words = line.strip().split(None, 1)
        if not words or words[0].startswith((";", "//", "#")):
            continue
        key, rest = words[0].upper(), words[1].strip() if len(words) > 1 else ""
        if key == "BEGIN":
            if len(stack) > DEEPEST or not rest:
                raise InputError(f"line {number}: a BEGIN without a name, or blocks {DEEPEST} deep")
            block = Block(rest.split()[0].upper())
            stack[-1].blocks.append(block)
            stack.append(block)
        elif key == "END":
            if len(stack) == 1 or (rest and rest.split()[0].upper() != stack[-1].name):
                raise InputError(f"line {number}: END {rest} does not end {stack[-1].name or 'anything'}")
            stack.pop()
        else:
            stack[-1].entries.append((key, rest))
    if len(stack) > 1:
        raise InputError(f"ends within {stack[-1].name}: the file is not whole")
    return root


def read_rio(text: str, given: Given) -> Taken:
    """Either family.  Raises InputError where it is neither, or has no zone that could be taken."""
    root = parse(text)
    if objects := root.all("TESTOBJECT"):
        return _test_object(objects[0], given)
    if devices := root.all("PROTECTIONDEVICE"):
        return _protection_device(devices[0], given)
    names = ", ".join(block.name for block in root.blocks) or "no block"
    raise InputError(f"has neither a TESTOBJECT nor a PROTECTIONDEVICE: {names}")


def _not_taken(taken: Taken, block: Block, kind: str) -> None:
    for key, value in block.entries:
        if key not in UNDERSTOOD[kind]:
            taken.left.append(f"{block.name} {key} {value}".strip())


def _test_object(root: Block, given: Given) -> Taken:
    distances = root.all("DISTANCE")
    if not distances:
        raise InputError("has no DISTANCE block")
    distance = distances[0]
    taken = Taken("RIO, TESTOBJECT", secondary=(distance.text("IMPPRIM") or "NO").upper() != "YES")
    for device in root.all("DEVICE"):
        _ratios(taken, device)
        _not_taken(taken, device, "DEVICE")
    _not_taken(taken, distance, "DISTANCE")
    taken.left += [f"block {block.name}" for block in root.blocks if block.name not in ("DEVICE", "DISTANCE")]
    degrees = distance.numbers("LINEANGLE", 1)
    angle = None if degrees is None else math.radians(degrees[0])
    taken.z1_ohm = given.z1_ohm
    taken.k0 = _residual(distance, given.z1_ohm, angle)
    for block in distance.blocks:
        if block.name != "ZONE":
            taken.left.append(f"block {block.name}")
            continue
        _zone(taken, block, angle)
    return taken.complete(given)


def _ratios(taken: Taken, device: Block) -> None:
    frequency = device.numbers("FNOM", 1)
    taken.frequency_hz = frequency[0] if frequency else None
    for key, primary, nominal in (("ct_ratio", "IPRIM", "INOM"), ("vt_ratio", "VPRIM-LL", "VNOM")):
        a, b = device.numbers(primary, 1), device.numbers(nominal, 1)
        if a and b and a[0] > 0 and b[0] > 0:
            setattr(taken, key, a[0] / b[0])


def _residual(block: Block, z1: complex | None, angle: float | None) -> complex | None:
    """k0, by whichever of its definitions the file has."""
    if (kl := block.numbers("KL", 2)) is not None:
        return cmath.rect(kl[0], math.radians(kl[1]))
    if (ratio := block.numbers("Z0Z1", 2)) is not None:
        return (cmath.rect(ratio[0], math.radians(ratio[1])) - 1) / 3
    both = block.numbers("RERL_XEXL", 2)
    if both is None and (re_rl := block.numbers("RE/RL", 1)) and (xe_xl := block.numbers("XE/XL", 1)):
        both = [re_rl[0], xe_xl[0]]
    if both is None:
        return None
    z = z1 if z1 is not None else None if angle is None else cmath.exp(1j * angle)
    if z is None:
        return None
    return complex(both[0] * z.real, both[1] * z.imag) / z


def _zone(taken: Taken, block: Block, angle: float | None) -> None:
    index = block.numbers("INDEX", 1)
    number = int(index[0]) if index else len(taken.zones) + 1
    name = (block.text("LABEL") or str(number)).strip('"')
    _not_taken(taken, block, "ZONE")
    if (block.text("ACTIVE") or "YES").upper() not in ("YES", "1", "TRUE"):
        taken.left.append(f"zone {name}: not active")
        return
    wanted = (block.text("FAULTLOOP") or "ALL").upper()
    if wanted not in LOOPS:
        taken.left.append(f"zone {name}: of the loop {wanted} alone")
        return
    time = block.numbers("TRIPTIME", 1)
    delay_s = time[0] if time else None
    trips = (block.text("TYPE") or "TRIPPING").upper() == "TRIPPING"
    shapes = block.all("SHAPE", "MHOSHAPE", "LENSTOMATOSHAPE")
    if len(shapes) != 1 or shapes[0].name == "LENSTOMATOSHAPE":
        kind = shapes[0].name if shapes else "no shape"
        taken.left.append(f"zone {name}: {len(shapes)} shapes" if len(shapes) > 1 else f"zone {name}: {kind}")
        return
    shape, loops = shapes[0], LOOPS[wanted]
    if (shape.text("INVERT") or "NO").upper() == "YES":
        taken.left.append(f"zone {name}: inverted, outside its shape")
    elif shape.name == "MHOSHAPE":
        _mho(taken, shape, number, name, loops, delay_s, trips)
    else:
        corners = _corners(taken, shape, name)
        if corners is not None:
            taken.add_polygon(number, name, loops, corners, delay_s, angle, trips=trips)


def _mho(
    taken: Taken, shape: Block, number: int, name: str, loops: Loops, delay_s: float | None, trips: bool
) -> None:
    degrees, reach, offset = (shape.numbers(key, 1) for key in ("ANGLE", "REACH", "OFFSET"))
    if not degrees or not reach or reach[0] <= 0:
        taken.left.append(f"zone {name}: a mho without angle and reach")
        return
    if offset and offset[0] != 0:
        taken.left.append(f"zone {name}: a mho with an offset of {offset[0]:g} ohm")
        return
    point = cmath.rect(reach[0], math.radians(degrees[0]))
    reverse = point.imag < 0
    taken.zones.append(
        Zone(
            number,
            name,
            loops,
            "reverse" if reverse else "forward",
            -point if reverse else point,
            delay_s,
            trips,
        )
    )
    taken.noted.append(f"zone {name}: RIO does not tell how a mho is polarized: by memory, unless changed")


def _corners(taken: Taken, shape: Block, name: str) -> list[complex] | None:
    """Of half-planes, each to the left or right of a line."""
    corners = everything()
    for key, text in shape.entries:
        if key in ("INVERT", "AUTOCLOSE"):
            continue
        words = [part for part in re.split(r"[,\s]+", text) if part]
        values = numbers(" ".join(words[:-1])) if words else None
        side = words[-1].upper() if words else ""
        count = {"LINE": 3, "LINEP": 3}.get(key)
        if count is None or values is None or len(values) != count or side not in ("LEFT", "RIGHT"):
            taken.left.append(f"zone {name}: {key} {text}".strip())
            return None
        first, second, degrees = values
        point = complex(first, second) if key == "LINE" else cmath.rect(first, math.radians(second))
        corners = cut(corners, point, math.radians(degrees), side == "LEFT")
    if len(corners) < 3 or np.abs(corners).max() > 1e4:
        taken.left.append(f"zone {name}: its lines enclose nothing, or not all of it")
        return None
    return corners.tolist()


def _protection_device(root: Block, given: Given) -> Taken:
    """The older family, in secondary ohms."""
    taken = Taken("RIO, PROTECTIONDEVICE", secondary=True)
    _not_taken(taken, root, "PROTECTIONDEVICE")
    rating = root.numbers("RATING")
    if rating and len(rating) >= 3:
        taken.frequency_hz = rating[2]
    degrees = root.numbers("LINEANGLE", 1)
    angle = None if degrees is None else math.radians(degrees[0])
    taken.z1_ohm = given.z1_ohm
    taken.k0 = _residual(root, given.z1_ohm, angle)
    for block in root.blocks:
        if not block.name.startswith("ZONE"):
            taken.left.append(f"block {block.name}")
            continue
        name = (block.text("NAME") or str(len(taken.zones) + 1)).strip('"')
        _not_taken(taken, block, "ZONE")
        digits = re.search(r"\d+", name)
        number = int(digits[0]) if digits else len(taken.zones) + 1
        time1, several = block.numbers("TIME1", 1), block.numbers("TIMEM", 1)
        for shape in block.blocks:
            ground = shape.name == "TRIPCHAR-EARTH"
            if shape.name not in ("TRIPCHAR", "TRIPCHAR-EARTH"):
                taken.left.append(f"zone {name}: block {shape.name}")
                continue
            points = _way(taken, shape, name)
            time = time1 if ground or several is None else several
            if points is not None:
                delay_s = time[0] if time else None
                taken.add_polygon(number, name, "ground" if ground else "phase", points, delay_s, angle)
    return taken.complete(given)


def _way(taken: Taken, shape: Block, name: str) -> list[complex] | None:
    """START r, x; LINE r, x; ARC radius, start, sweep, CW or CCW; CLOSE."""
    points: list[complex] = []
    for key, text in shape.entries:
        words = [part for part in re.split(r"[,\s]+", text) if part]
        if key == "CLOSE":
            break
        turn = words[-1].upper() if words and words[-1].upper() in ("CW", "CCW") else None
        values = numbers(" ".join(words[:-1] if turn else words))
        if key in ("START", "LINE") and values and len(values) == 2 and (key == "START") == (not points):
            points.append(complex(*values))
        elif key == "ARC" and values and len(values) == 3 and points and turn:
            radius, from_deg, sweep_deg = values
            points += arc(points[-1], radius, from_deg, sweep_deg, turn == "CW")
        else:
            taken.left.append(f"zone {name}: {key} {text}".strip())
            return None
    return points
