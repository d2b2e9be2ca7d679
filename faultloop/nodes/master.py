"""Who tells the time on a bus: the plant."""

from __future__ import annotations

from faultloop.config.time_sync import TimeSync
from faultloop.io.can.table import PLANT_NODE
from faultloop.nodes.clock import Cyclic
from faultloop.nodes.node import Node
from faultloop.nodes.refusals import Report, unheard
from faultloop.nodes.time_sync import set_master


class TimeMaster(Node):
    """Sends SYNC, and where that has ended on the bus the follow-up.

    Parameters
    ----------
    table : the scenario's.
    seed : of the jitter of its stamps.
    report : told of frames that it refuses.
    start_ns : the first SYNC is not before this, run time [ns].
    """

    def __init__(self, table: TimeSync, seed: int, report: Report = unheard, *, start_ns: int = 0) -> None:
        super().__init__(PLANT_NODE, [], [], 0, report, start_ns=start_ns, strict=False)
        master = self.nodes.node["master"]
        set_master(master, table, seed)
        Cyclic(1 / table.period_s, start_ns, record=master["period"])
