"""The protection functions: one module each, named after its logical node, and its name in ``FUNCTIONS``."""

from __future__ import annotations

from faultloop.relay.functions.element import ELEMENT
from faultloop.relay.functions.function import Function
from faultloop.relay.functions.lphd import LPHD
from faultloop.relay.functions.pdis import PDIS
from faultloop.relay.functions.phs import PHS
from faultloop.relay.functions.psof import PSOF
from faultloop.relay.functions.ptoc import PTOC
from faultloop.relay.functions.ptrc import PTRC
from faultloop.relay.functions.rdir import RDIR
from faultloop.relay.functions.rflo import RFLO

FUNCTIONS: tuple[Function, ...] = (PHS, RDIR, PDIS, PSOF, PTOC, ELEMENT, PTRC, RFLO, LPHD)
"""In the order in which a sample goes through them."""
