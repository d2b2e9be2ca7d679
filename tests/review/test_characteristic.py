"""A zone's characteristic at an instant: the loop's impedance is inside where its depth is below 1."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.path import Path as Polygon

from faultloop.io.mcap_reader import open_log
from faultloop.review.characteristic import characteristic
from faultloop.review.retrace import retrace
from faultloop.review.rows import relay_rows
from tests.review.why_cases import fault, write

QUAD: dict[str, Any] = {
    "characteristic": "quad",
    "resistive_reach_ohm": 10.0,
    "resistive_reach_ground_ohm": 30.0,
}
QUICK: list[dict[str, Any]] = [{}, QUAD, {"polarization": "cross"}, QUAD | {"direction": "reverse"}]
SLOW: list[dict[str, Any]] = [{"polarization": "self"}, {"direction": "reverse"}, {"direction": "none"}]
SLOW.append(QUAD | {"direction": "none"})
FAULTS = [("AG", 0.4), ("AG", -0.3), ("BC", 0.75), ("BC", -0.01), ("CAG", 0.9), ("ABC", 0.3), ("ABC", -0.2)]


@pytest.mark.parametrize(
    "shape",
    [*QUICK, *(pytest.param(shape, marks=pytest.mark.slow) for shape in SLOW)],
    ids=lambda shape: "-".join(str(value) for value in shape.values()),
)  # fmt: skip
def test_a_loop_is_inside_the_polygon_where_its_depth_is_below_1(
    shape: dict[str, Any], tmp_path: Path
) -> None:
    """At every quarter of a cycle from the fault on, each loop with its own current, load and memory."""
    inside = outside = 0
    for number, (kind, at) in enumerate(FAULTS):
        path = tmp_path / f"{number}.mcap"
        tables = {"pdis": [{"zone": 1, "reach_pu": 0.8} | shape]}
        log = open_log(write(path, tables, fault(kind, at, resistance=1.0), kind))
        known, rows = retrace(log, "R1"), relay_rows(log, "R1")
        g, c = known.constants["shared"], known.constants["pdis"][0]
        for k in range(0, len(known.t_ns), 24):
            q, z = known.shared[k], known.zones[k, 0]
            if not q["disturbed"]:
                continue
            x = rows.phasors[np.searchsorted(rows.t_ns, known.t_ns[k])]
            for loop in range(6):
                m = float(z["m"][loop])
                if abs(m - 1) < 0.02 or np.isnan(m):
                    continue
                points = characteristic(g, c, q, x, loop)
                v, i = _loop(x, loop, complex(c["k0"]))
                if not len(points) or _beyond(
                    shape, float(z["x"][loop]), float(z["r"][loop]), abs(c["reach"])
                ):
                    continue
                polygon = Polygon(np.column_stack([points.real, points.imag]))
                assert polygon.contains_point([(v / i).real, (v / i).imag]) == (m < 1), (kind, at, k, loop, m)
                inside, outside = inside + (m < 1), outside + (m > 1)
    assert inside > 12 and outside > 12


def _beyond(shape: dict[str, Any], m: float, r: float, reach: float) -> bool:
    """Near a quadrilateral's border behind, where depth is no measure of how near."""
    return "characteristic" in shape and abs(m + 0.15 + 0.27 * abs(r) / reach) < 0.02


def _loop(x: np.ndarray, loop: int, k0: complex) -> tuple[complex, complex]:
    if loop < 3:
        return complex(x[loop]), complex(x[3 + loop] + k0 * x[3:].sum())
    a, b = loop - 3, (loop - 2) % 3
    return complex(x[a] - x[b]), complex(x[3 + a] - x[3 + b])
