"""What a primary system can be made up of; a new component is a file and its name here."""

from __future__ import annotations

from faultloop.plant.breaker import Breaker
from faultloop.plant.component import Component
from faultloop.plant.ct import Ct
from faultloop.plant.fault import Fault
from faultloop.plant.inverter import Inverter
from faultloop.plant.line import Line
from faultloop.plant.load import Load
from faultloop.plant.mutual import Mutual
from faultloop.plant.series_capacitor import SeriesCapacitor
from faultloop.plant.source import Source
from faultloop.plant.swing import Swing
from faultloop.plant.switching import Switching
from faultloop.plant.transformer import Transformer
from faultloop.plant.vt import Vt

COMPONENTS: tuple[type[Component], ...] = (
    Breaker,
    Source,
    Swing,
    Mutual,
    SeriesCapacitor,
    Line,
    Load,
    Transformer,
    Inverter,
    Fault,
    Switching,
    Ct,
    Vt,
)
"""In the order in which they are built: a breaker makes a line's end, a line the node of a fault on it, and
coupled lines are laid in equal sections."""
