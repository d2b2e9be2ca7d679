"""Where a fault is, seen from a relay: every place of four networks, by hand."""

from __future__ import annotations

from typing import Any

import pytest

from faultloop.loop.scenario import Scenario
from faultloop.study.campaign.where import where_of


def network(lines: dict[str, str], relay: tuple[str, str], fault: dict[str, Any] | None) -> Scenario:
    """``lines`` by name with their two buses, as in ``{"L1": "AB"}``; 50 km each but those in lower case."""
    data: dict[str, Any] = {
        "scenario": {"name": "x", "duration_s": 0.3},
        "system": {"frequency_hz": 50, "base_kv": 110},
        "source": [{"name": "S", "bus": next(iter(lines.values()))[0], "sir": 1.0}],
        "line": [
            {
                "name": name, "from": buses[0], "to": buses[1], "length_km": 10 if name.islower() else 50,
                "model": "rl", "r1_ohm_per_km": 0.1, "x1_ohm_per_km": 0.4, "r0_ohm_per_km": 0.3,
                "x0_ohm_per_km": 1.2,
            }
            for name, buses in lines.items()
        ],
        "relay": [{"name": "R", "line": relay[0], "end": relay[1], "settings": "none.toml"}],
        "fault": [] if fault is None else [{"type": "AG", "start_s": 0.1} | fault],
    }  # fmt: skip
    return Scenario.from_dict(data)


RADIAL = {"L1": "AB", "L2": "BC", "L3": "CD"}
DOUBLE = {"L1": "AB", "L2": "AB", "L3": "BC", "L0": "ZA"}
RING = {"L1": "AB", "L2": "BC", "L3": "CA"}
ROUND = {"L1": "AB", "a": "AM", "b": "MB", "L3": "BC"}


@pytest.mark.parametrize(
    ("lines", "relay", "fault", "where"),
    [
        (RADIAL, ("L2", "from"), None, "none"),
        (RADIAL, ("L2", "from"), {"line": "L2", "at_pu": 0.3}, "inside"),
        (RADIAL, ("L2", "from"), {"line": "L2", "at_km": 49.9}, "inside"),
        (RADIAL, ("L2", "from"), {"line": "L2", "at_pu": 0.0}, "behind"),
        (RADIAL, ("L2", "from"), {"line": "L2", "at_pu": 1.0}, "beyond"),
        (RADIAL, ("L2", "to"), {"line": "L2", "at_pu": 0.0}, "beyond"),
        (RADIAL, ("L2", "to"), {"line": "L2", "at_pu": 1.0}, "behind"),
        (RADIAL, ("L2", "from"), {"bus": "B"}, "behind"),
        (RADIAL, ("L2", "from"), {"bus": "C"}, "beyond"),
        (RADIAL, ("L2", "from"), {"bus": "A"}, "behind"),
        (RADIAL, ("L2", "from"), {"bus": "D"}, "beyond"),
        (RADIAL, ("L2", "to"), {"bus": "D"}, "behind"),
        (RADIAL, ("L2", "from"), {"line": "L1", "at_pu": 0.5}, "behind"),
        (RADIAL, ("L2", "from"), {"line": "L1", "at_pu": 1.0}, "behind"),
        (RADIAL, ("L2", "from"), {"line": "L3", "at_pu": 0.0}, "beyond"),
        (RADIAL, ("L2", "from"), {"line": "L3", "at_pu": 0.5}, "beyond"),
        (DOUBLE, ("L1", "from"), {"line": "L2", "at_pu": 0.1}, "beyond"),
        (DOUBLE, ("L1", "to"), {"line": "L2", "at_pu": 0.1}, "beyond"),
        (DOUBLE, ("L1", "from"), {"line": "L3", "at_pu": 0.1}, "beyond"),
        (DOUBLE, ("L1", "from"), {"line": "L0", "at_pu": 0.1}, "behind"),
        (DOUBLE, ("L1", "from"), {"bus": "A"}, "behind"),
        (DOUBLE, ("L1", "from"), {"bus": "B"}, "beyond"),
        (RING, ("L1", "from"), {"line": "L3", "at_pu": 0.9}, "behind"),
        (RING, ("L1", "from"), {"line": "L2", "at_pu": 0.1}, "beyond"),
        (RING, ("L1", "to"), {"line": "L2", "at_pu": 0.1}, "behind"),
        (ROUND, ("L1", "from"), {"line": "a", "at_pu": 0.4}, "behind"),
        (ROUND, ("L1", "from"), {"line": "b", "at_pu": 0.6}, "beyond"),
        (ROUND, ("L1", "from"), {"line": "L3", "at_pu": 0.5}, "beyond"),
    ],
)
def test_where(
    lines: dict[str, str], relay: tuple[str, str], fault: dict[str, Any] | None, where: str
) -> None:
    scenario = network(lines, relay, fault)
    assert where_of(scenario, scenario.relay[0]) == where


def test_of_several_faults_the_first() -> None:
    data = {"line": "L2", "at_pu": 0.5}
    scenario = network(RADIAL, ("L2", "from"), data)
    first = scenario.fault[0].model_copy(update={"name": "F0", "line": "L1", "start_s": 0.05})
    both = scenario.model_copy(update={"fault": (*scenario.fault, first)})
    assert where_of(both, both.relay[0]) == "behind"
