"""A process has every kernel of its node before the run begins: none is loaded at the first trip."""

from __future__ import annotations

from types import ModuleType

from faultloop.io.can import port
from faultloop.io.can.frames import SampledValues, State, decode
from faultloop.io.can.table import Kind
from faultloop.nodes import BreakerNode, RelayNode, clock, goose, node
from faultloop.nodes.node import rehearse

MS = 1_000_000


def signatures(*modules: ModuleType) -> dict[str, int]:
    return {
        f"{module.__name__}.{name}": len(value.signatures)
        for module in modules
        for name, value in vars(module).items()
        if hasattr(value, "signatures")
    }


def test_nothing_is_left_to_load() -> None:
    modules = (port, goose, node, clock)
    rehearse()
    before = signatures(*modules)
    assert sum(before.values()) > 5
    relay, breaker = RelayNode(0, 0, [1], 1.0, 10.0), BreakerNode(0, [0], 7, 1.0, lambda *_: None)
    for t_ns in range(0, 2000 * MS, 100 * MS):
        if t_ns == 300 * MS:
            relay.set(t_ns, 7, 0, 1)
            breaker.set(t_ns, 3)
        frames = [*relay.poll(t_ns), *breaker.poll(t_ns)]
        for frame in frames:
            breaker.receive(t_ns, frame)
            relay.receive(t_ns, frame)
            decode(frame)
        SampledValues(0, 1, (1.0,) * 6).encode()
        relay.receive(t_ns, State(Kind.PILOT, 1, 1, 1, 0, 0, 0).encode())
        assert (relay.next_ns, breaker.next_ns, relay.shown_ns) != (0, 0, 0)
    assert relay.breaker_closed == 3
    assert signatures(*modules) == before
