"""The protection functions: one module each, named after its logical node, and its name in ``FUNCTIONS``."""

from __future__ import annotations

from faultloop.relay.functions.element import ELEMENT
from faultloop.relay.functions.function import Function
from faultloop.relay.functions.lphd import LPHD
from faultloop.relay.functions.pdif import PDIF
from faultloop.relay.functions.pdis import PDIS
from faultloop.relay.functions.pfrc import PFRC
from faultloop.relay.functions.phs import PHS
from faultloop.relay.functions.pioc import PIOC
from faultloop.relay.functions.psch import PSCH
from faultloop.relay.functions.psof import PSOF
from faultloop.relay.functions.ptoc import PTOC
from faultloop.relay.functions.ptof import PTOF
from faultloop.relay.functions.ptov import PTOV
from faultloop.relay.functions.ptrc import PTRC
from faultloop.relay.functions.ptuf import PTUF
from faultloop.relay.functions.ptuv import PTUV
from faultloop.relay.functions.rbrf import RBRF
from faultloop.relay.functions.rdir import RDIR
from faultloop.relay.functions.rflo import RFLO
from faultloop.relay.functions.rpsb import RPSB
from faultloop.relay.functions.rrec import RREC
from faultloop.relay.functions.rsyn import RSYN
from faultloop.relay.functions.tvtr import TVTR
from faultloop.relay.functions.zload import ZLOAD

FUNCTIONS: tuple[Function, ...] = (
    *(TVTR, RPSB, PHS, ZLOAD, RDIR, PDIS, PSOF, PSCH, PDIF),
    *(PIOC, PTOC, PTUV, PTOV, PTUF, PTOF, PFRC, ELEMENT),
    *(RSYN, RBRF, PTRC, RREC, RFLO, LPHD),
)
"""In the order in which a sample goes through them."""
