"""The secondary system: from six sampled values to a trip.

from faultloop.relay import Relay, load_settings

relay = Relay(load_settings("line.toml"), name="R1")
done = relay.advance(samples)     # (n, 6) primary; stops where an output changes
relay.outputs.trip_poles
"""

from __future__ import annotations

from faultloop.relay.events import Event, Outputs, Trip
from faultloop.relay.relay import Relay, RelayInputs
from faultloop.relay.settings import RelaySettings, load_settings

__all__ = [
    "Event",
    "Outputs",
    "Relay",
    "RelayInputs",
    "RelaySettings",
    "Trip",
    "load_settings",
]
