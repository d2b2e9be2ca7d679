"""IEC-style protection relay simulator: EMT plant, distance relay, trips over CAN, every sample in MCAP.

>>> import faultloop
>>> result = faultloop.run("scenarios/ag-zone1.toml")
>>> [trip.loop for trip in result.trips]
['AG', 'AG']
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from faultloop.api import replay, run
    from faultloop.errors import InputError
    from faultloop.io.mcap_reader import Log, open_log
    from faultloop.loop.result import Result
    from faultloop.loop.scenario import Scenario, load_scenario
    from faultloop.relay.settings import RelaySettings, load_settings
    from faultloop.study.campaign import Campaign

# Loaded on first use: numba and numpy take most of a second, and `faultloop --help` needs neither.
_PLACES = {
    "Campaign": "faultloop.study.campaign",
    "InputError": "faultloop.errors",
    "Log": "faultloop.io.mcap_reader",
    "open_log": "faultloop.io.mcap_reader",
    "RelaySettings": "faultloop.relay.settings",
    "load_settings": "faultloop.relay.settings",
    "Result": "faultloop.loop.result",
    "Scenario": "faultloop.loop.scenario",
    "load_scenario": "faultloop.loop.scenario",
    "run": "faultloop.api",
    "replay": "faultloop.api",
}

__all__ = [
    "Campaign",
    "InputError",
    "Log",
    "RelaySettings",
    "Result",
    "Scenario",
    "load_scenario",
    "load_settings",
    "open_log",
    "replay",
    "run",
]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'faultloop' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_PLACES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
