"""What a scenario's relays are set to do that nobody may have meant: told, and run all the same."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant
from faultloop.relay import RelaySettings
from faultloop.relay.coordination import Doubt, load_doubts

LEAST_LOAD_A = 1.0
"""Less current is no load: a line that is open, or charges a little."""
TURN = np.exp(2j * np.pi / 3 * np.arange(3)) / 3


def settings_doubts(settings: RelaySettings, relay: str = "") -> list[str]:
    """One line each: file, key, what it does and what would be right."""
    return _told(settings, relay, settings.doubts)


def scenario_doubts(scenario: Scenario, settings: Mapping[str, RelaySettings], plant: Plant) -> list[str]:
    """The same of every relay of a scenario, with the load that ``plant`` begins with."""
    found = []
    samples = plant.history(round(scenario.system.sampling_hz / scenario.system.frequency_hz))
    for number, place in enumerate(scenario.relay):
        own = settings[place.name]
        load = _load_ohm(samples[:, number])
        found += settings_doubts(own, place.name)
        found += _told(own, place.name, [] if load is None else load_doubts(own, load))
    return found


def _load_ohm(samples: np.ndarray) -> complex | None:
    """Positive-sequence voltage over current of one cycle (n, 6); None without a load."""
    turn = np.exp(-2j * np.pi * np.arange(len(samples)) / len(samples)) * np.sqrt(2) / len(samples)
    v1, i1 = ((turn @ samples).reshape(2, 3) * TURN).sum(axis=1)
    return None if abs(i1) < LEAST_LOAD_A else complex(v1 / i1)


def _told(settings: RelaySettings, relay: str, doubts: list[Doubt]) -> list[str]:
    where = settings.path or (f"settings of relay '{relay}'" if relay else "settings")
    return [f"{where}: {key}: {text}" for key, text in doubts]
