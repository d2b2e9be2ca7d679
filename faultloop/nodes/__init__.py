"""The nodes on the bus, each with nothing but frames and its own clock.

A node takes frames (`receive`) and gives frames (`poll`, due at `next_ns`); it shares no memory with the
other nodes, and it does not know whether the bus is simulated or real.
"""

from faultloop.nodes.breaker import BreakerNode, Command
from faultloop.nodes.clock import FOREVER
from faultloop.nodes.follower import BreakerFollower, Movement, with_followed_breakers
from faultloop.nodes.master import TimeMaster
from faultloop.nodes.refusals import Refusals, Report
from faultloop.nodes.relay import RelayNode
from faultloop.nodes.roster import breaker_follower, breaker_node, relay_node, time_master

__all__ = [
    "FOREVER",
    "BreakerFollower",
    "BreakerNode",
    "Command",
    "Movement",
    "Refusals",
    "RelayNode",
    "Report",
    "TimeMaster",
    "breaker_follower",
    "breaker_node",
    "relay_node",
    "time_master",
    "with_followed_breakers",
]
