"""What a ground loop measures of a bolted fault on a long line behind a weak source, in closed form.

    python bench/long_line_reach.py [--seed 3003] [--kind extreme] [--case 33 156]

Sequence networks of a case of `security_cases`, lines with their exact equations, the fault's current from
the Thevenin impedances at the fault; nothing of the plant or the relay is used.  The relay measures
V / (I + k0 3 I0), and per sequence V(0) = T z x I(0) + V(x) / cosh(gamma x), T = tanh(gamma x) / (gamma x).
The sequence voltages at the fault add up to nothing, but each is there: what is left of them is
(1 / cosh(gamma1 x) - 1 / cosh(gamma0 x)) (V1 + V2 at the fault), as large as V behind a weak source.
"""

from __future__ import annotations

import argparse
import cmath
import math
from typing import Any, NamedTuple

import numpy as np
from security_cases import KINDS, draw, view

BUSES = "XAFBC"


class Sequence(NamedTuple):
    """Of a sequence: impedance and admittance per km, the buses' impedance matrix."""

    z: complex
    y: complex
    matrix: np.ndarray


def sequence(case: dict[str, Any], number: int) -> Sequence:
    line, turn = case["line"], case["frequency"] / case["f0"]
    z = complex(line[f"r{number}_ohm_per_km"], turn * line[f"x{number}_ohm_per_km"])
    y = 1e-6j * turn * line.get(f"b{number}_us_per_km", 1e-9)
    sections = [("XA", case["near"]), ("AB", case["length"]), ("BC", case["far"])]
    if case["parallel"]:
        sections.append(("AB", case["length"]))
    place = {"behind": 0, "inside": 1, "beyond": 2, "parallel": 3}[case["where"]]
    (first, last), km = sections.pop(place)
    sections += [(first + "F", case["at"] * km), ("F" + last, (1 - case["at"]) * km)]
    matrix = np.zeros((5, 5), complex)
    for (i, j), km in (([BUSES.index(b) for b in ends], km) for ends, km in sections):
        gamma, surge = cmath.sqrt(z * y), cmath.sqrt(z / y)
        series, shunt = 1 / (surge * cmath.sinh(gamma * km)), cmath.tanh(gamma * km / 2) / surge
        matrix[[i, j], [i, j]] += series + shunt
        matrix[[i, j], [j, i]] -= series
    for bus in "XC":
        r, x = case[bus][f"z{number}_ohm"]
        matrix[BUSES.index(bus), BUSES.index(bus)] += 1 / complex(r, turn * x)
    return Sequence(z, y, np.linalg.inv(matrix))


def source_currents(case: dict[str, Any]) -> np.ndarray:
    """Of the sources as current sources, per unit of voltage."""
    found, turn = np.zeros(5, complex), case["frequency"] / case["f0"]
    for bus, emf in (("X", 1.02), ("C", cmath.exp(-1j * math.radians(case["load"])))):
        r, x = case[bus]["z1_ohm"]
        found[BUSES.index(bus)] = emf / complex(r, turn * x)
    return found


def measured(case: dict[str, Any], end: int) -> tuple[complex, complex, complex]:
    """Of a bolted A-G, per unit of the line's impedance; the loop's voltage, and what the voltages at the
    fault, or at the line's other end, leave of it, per unit."""
    one, zero = sequence(case, 1), sequence(case, 0)
    before = one.matrix @ source_currents(case)
    fault = BUSES.index("F")
    current = before[fault] / (2 * one.matrix[fault, fault] + zero.matrix[fault, fault])
    positive = before - 2 * one.matrix[:, fault] * current  # V1 + V2
    residual = -zero.matrix[:, fault] * current
    bus, other, km = BUSES.index("AB"[end]), BUSES.index("BA"[end]), case["length"]
    if case["where"] == "inside":
        other, km = fault, km * (1 - case["at"] if end else case["at"])

    def into_the_line(s: Sequence, v: np.ndarray) -> complex:
        gamma, surge = cmath.sqrt(s.z * s.y), cmath.sqrt(s.z / s.y)
        return (v[bus] * cmath.cosh(gamma * km) - v[other]) / (surge * cmath.sinh(gamma * km))

    i = into_the_line(one, positive) + into_the_line(zero, residual) * zero.z / one.z
    v = positive[bus] + residual[bus]
    left = [1 / cmath.cosh(cmath.sqrt(s.z * s.y) * km) for s in (one, zero)]
    return v / (i * one.z * case["length"]), v, (left[0] - left[1]) * positive[other]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seed", type=int, default=3003)
    parser.add_argument("--kind", choices=KINDS, default="extreme")
    parser.add_argument("--case", type=int, nargs="+", default=[33, 156])
    given = parser.parse_args()
    for number in given.case:
        case = draw(given.seed, number, given.kind)
        if case["type"] not in ("AG", "BG", "CG") or case["resistance"]:
            print(f"{number}: no bolted one-phase fault")
            continue
        for end in (0, 1):
            seen, z = view(case, end), measured(case, end)
            where = f"{number} from {'AB'[end]}: {seen.where}, {seen.at:.3f} of {seen.length:.0f} km"
            print(f"{where}, SIR {seen.sir:.1f}: measured {z[0]:.3f} of the line;"
                  f" loop voltage {abs(z[1]):.3f}, of it left {abs(z[2]):.3f} per unit")  # fmt: skip


if __name__ == "__main__":
    main()
