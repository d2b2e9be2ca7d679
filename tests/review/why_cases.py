"""20 trips and 20 that are none, each with one cause that was set on purpose, and a log of each."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from faultloop.io.mcap_writer import LogWriter
from faultloop.relay import Relay, RelaySettings
from tests.relay import swings
from tests.relay.network import Network, settings_dict

NETWORK = Network()
FAULT_S = 0.2
RATE = NETWORK.sampling_hz
MHO: list[dict[str, Any]] = [{"zone": 1, "reach_pu": 0.8}, {"zone": 2, "reach_pu": 1.3, "delay_ms": 100.0}]
QUAD = [{"zone": 1, "characteristic": "quad", "reach_pu": 0.8, "resistive_reach_ohm": 10.0}]
QUAD[0]["resistive_reach_ground_ohm"] = 30.0


def write(path: Path, tables: dict[str, Any], samples: np.ndarray, truth: str | None) -> Path:
    """A log as a replay leaves it: the relay starts cold at sample 0; ``truth``: the fault's type."""
    data = settings_dict(NETWORK, tables.pop("pdis", MHO), **{"estimator": {}, **tables})
    data["relay"]["nominal_kv"] = 230
    settings = RelaySettings.from_dict(data)
    relay = Relay(settings, "R1")
    with LogWriter(path, 0, {"settings": {"R1": settings.model_dump_json()}}) as log:
        log.add_relay("R1", relay.bits, relay.characteristics())
        if truth is not None:
            gone_ns = (len(samples) - RATE // 10) * 1_000_000_000 // RATE
            log.message("/plant/faults", round(FAULT_S * 1e9), "FaultState", fault=0, on=True, type=truth)
            log.message("/plant/faults", gone_ns, "FaultState", fault=0, on=False, type=truth)
        done = 0
        while done < len(samples):
            m = relay.advance(samples[done:])
            counts = np.arange(done, done + m)
            t_ns = counts * 1_000_000_000 // RATE
            log.relay_block(
                "R1",
                t_ns,
                counts,
                samples[done : done + m],
                relay.phasors,
                relay.loops,
                relay.pickup,
                relay.operate,
            )
            for event in relay.events:
                at_ns = event.sample_count * 1_000_000_000 // RATE
                log.message("/relay/R1/events", at_ns, "foxglove.Log", level=2, message=event.text, name="R1")
                if event.trip is not None:
                    trip = vars(event.trip) | {"sample_count": event.sample_count}
                    log.message("/relay/R1/trips", at_ns, "Trip", **trip)
            done += m
    return path


def fault(kind: str, at: float, lasts_s: float = 0.2, **rest: float) -> np.ndarray:
    """Load, the fault from ``FAULT_S`` on, load again."""
    stages = [(0.0, NETWORK.solve()), (FAULT_S, NETWORK.solve(kind, at, **rest))]
    stages.append((FAULT_S + lasts_s, NETWORK.solve()))
    return NETWORK.samples(stages, FAULT_S + lasts_s + 0.1)


def load(left: dict[str, float], faulted: str = "", seconds: float = 0.5) -> np.ndarray:
    """Load; from ``FAULT_S`` on only a part of some phases' voltages; 0.1 s later a fault."""

    def measured(x: np.ndarray) -> np.ndarray:
        x = x.copy()
        for phase, part in left.items():
            x["ABC".index(phase)] *= part
        return x

    stages = [(0.0, NETWORK.solve()), (FAULT_S, measured(NETWORK.solve()))]
    if faulted:
        stages.append((FAULT_S + 0.1, measured(NETWORK.solve(faulted, 0.4))))
    return NETWORK.samples(stages, seconds)


def energised(kind: str) -> np.ndarray:
    """A dead line, then a fault on it at once."""
    stages = [(0.0, np.zeros(6, complex)), (FAULT_S + 0.1, NETWORK.solve(kind, 0.4))]
    return NETWORK.samples(stages, 0.6)


def at_frequency(hz: float) -> np.ndarray:
    """Load, its frequency moved off at ``FAULT_S`` without a jump of the phase."""
    t = np.arange(round(0.9 * RATE)) / RATE
    turn = 2 * np.pi * (50 * t + (hz - 50) * np.maximum(t - FAULT_S, 0))
    return np.sqrt(2) * np.real(NETWORK.solve() * np.exp(1j * turn)[:, None])


def raised(factor: float) -> np.ndarray:
    """Load, its voltages raised."""
    more = NETWORK.solve()
    more[:3] *= factor
    return NETWORK.samples([(0.0, NETWORK.solve()), (FAULT_S, more)], 0.6)


@dataclass(frozen=True)
class Case:
    """One cause set on purpose, and the function that is asked."""

    name: str
    function: str
    cause: str
    samples: Any
    truth: str | None = None
    loop: str | None = None
    tables: dict[str, Any] = field(default_factory=dict)
    said: str = ""


def _zone(**rest: Any) -> dict[str, Any]:
    return {"pdis": [{"zone": 1, "reach_pu": 0.8} | rest]}


STAGE = {"pdis": []}
TRIPS = [
    Case("ag", "PDIS1", "operated", fault("AG", 0.4), "AG", "AG", said="A-G 0.5"),
    Case("bc", "PDIS1", "operated", fault("BC", 0.3), "BC", "BC"),
    Case("cag", "PDIS1", "operated", fault("CAG", 0.5), "CAG", "CA"),
    Case("abc", "PDIS1", "operated", fault("ABC", 0.2), "ABC", "ABC"),
    Case("zone 2", "PDIS2", "operated", fault("BG", 1.0), "BG", "BG", said="after 100.0 ms"),
    Case("reverse", "PDIS1", "operated", fault("CG", -0.01), "CG", "CG", _zone(direction="reverse")),
    Case("quad", "PDIS1", "operated", fault("AG", 0.4, ground=8.0), "AG", "AG", {"pdis": QUAD}),
    Case("quad phases", "PDIS1", "operated", fault("AB", 0.4, resistance=2.0), "AB", "AB", {"pdis": QUAD}),
    Case("offset", "PDIS1", "operated", fault("AG", -0.01), "AG", "AG", _zone(direction="none")),
    Case(
        "self",
        "PDIS1",
        "operated",
        fault("CA", 0.4),
        "CA",
        "CA",
        _zone(polarization="self"),
        "its own voltage",
    ),
    Case(
        "cross",
        "PDIS1",
        "operated",
        fault("BG", 0.4),
        "BG",
        "BG",
        _zone(polarization="cross"),
        "other phases",
    ),
    Case(
        "instantaneous",
        "PIOC1",
        "operated",
        fault("AG", 0.1),
        "AG",
        None,
        STAGE | {"pioc": [{"pickup_a": 3000.0}]},
    ),
    Case(
        "definite",
        "PTOC1",
        "operated",
        fault("BC", 0.4),
        "BC",
        "BC",
        STAGE | {"ptoc": [{"pickup_a": 1500.0, "delay_ms": 60.0}]},
        "after 60.0 ms",
    ),
    Case(
        "residual",
        "PTOC1",
        "operated",
        fault("AG", 0.4, ground=30.0),
        "AG",
        "AG",
        STAGE
        | {"ptoc": [{"pickup_a": 300.0, "delay_ms": 50.0, "quantity": "residual", "direction": "forward"}]},
    ),
    Case(
        "negative",
        "PTOC1",
        "operated",
        fault("CA", 0.4),
        "CA",
        "CA",
        STAGE | {"ptoc": [{"pickup_a": 500.0, "delay_ms": 50.0, "quantity": "negative-sequence"}]},
    ),
    Case(
        "undervoltage",
        "PTUV1",
        "operated",
        fault("ABC", 0.4),
        "ABC",
        None,
        STAGE | {"ptuv": [{"start_v": 100e3, "delay_ms": 60.0, "phases": "all"}]},
    ),
    Case(
        "overvoltage",
        "PTOV1",
        "operated",
        raised(1.3),
        None,
        None,
        STAGE | {"ptov": [{"start_v": 150e3, "delay_ms": 60.0}]},
    ),
    Case(
        "underfrequency",
        "PTUF1",
        "operated",
        at_frequency(49.0),
        None,
        None,
        STAGE | {"ptuf": [{"start_hz": 49.5, "delay_ms": 100.0}]},
        "set to 49.50 Hz",
    ),
    Case("onto fault", "PSOF1", "operated", energised("ABC"), None, None, STAGE),
    Case(
        "emergency",
        "PTOC1",
        "operated",
        load({"A": 0.0, "B": 0.0, "C": 0.0}, "AG"),
        None,
        None,
        STAGE | {"tvtr": {}, "ptoc": [{"pickup_a": 1500.0, "delay_ms": 50.0, "when": "fuse-failure"}]},
    ),
]
NO_TRIPS = [
    Case("beyond", "PDIS1", "reach", fault("BC", 0.95), "BC", "BC", said="B-C 1.1"),
    Case("far bus", "PDIS1", "reach", fault("ABC", 1.0), "ABC", "ABC"),
    Case("behind", "PDIS1", "direction", fault("AG", -0.01), "AG", "AG", said="RDIR reverse"),
    Case(
        "ahead of a reverse zone",
        "PDIS1",
        "direction",
        fault("BC", 0.2),
        "BC",
        "BC",
        _zone(direction="reverse"),
        "RDIR forward",
    ),
    Case(
        "mho, resistance",
        "PDIS1",
        "resistance",
        fault("AG", 0.3, ground=60.0),
        "AG",
        "AG",
        said="outside by resistance",
    ),
    Case(
        "quad, resistance",
        "PDIS1",
        "resistance",
        fault("AB", 0.3, resistance=20.0),
        "AB",
        "AB",
        {"pdis": QUAD},
        "of 10 ohm",
    ),
    Case("too short", "PDIS2", "timer", fault("AG", 1.0, 0.08), "AG", "AG", said="of 100 ms"),
    Case(
        "stage too short",
        "PTOC1",
        "timer",
        fault("BC", 0.4),
        "BC",
        None,
        STAGE | {"ptoc": [{"pickup_a": 1500.0, "delay_ms": 600.0}]},
    ),
    Case(
        "load",
        "PDIS1",
        "blocked",
        fault("ABC", 0.3, resistance=45.0),
        "ABC",
        "ABC",
        _zone(characteristic="quad", resistive_reach_ohm=80.0) | {"zload": {"resistance_ohm": 35.0}},
        "ZLOAD",
    ),
    Case(
        "no emergency",
        "PTOC1",
        "blocked",
        fault("AG", 0.2),
        "AG",
        None,
        STAGE | {"tvtr": {}, "ptoc": [{"pickup_a": 1500.0, "when": "fuse-failure"}]},
    ),
    Case(
        "ground loops only",
        "PDIS1",
        "phase-selection",
        fault("BC", 0.3),
        "BC",
        "BC",
        _zone(loops="ground"),
        "ground loops only",
    ),
    Case(
        "wrong type",
        "PDIS1",
        "phase-selection",
        fault("AG", 0.3),
        "AG",
        "AG",
        {"phs": {"single_phase_ratio": 1e-6}} | _zone(loops="ground"),
        "phase selection said",
    ),
    Case("onto a fault", "PDIS1", "not-settled", energised("AG"), None, None, said="not ready"),
    Case(
        "wakes in a fault",
        "PDIS1",
        "not-settled",
        NETWORK.samples([(0.0, NETWORK.solve("BC", 0.3))], 0.4),
        None,
        None,
    ),
    Case(
        "current",
        "PDIS1",
        "minimum-current",
        fault("BC", 0.4),
        "BC",
        "BC",
        _zone(minimum_current_a=20e3),
        "minimum_current_a",
    ),
    Case(
        "residual current",
        "PDIS1",
        "minimum-current",
        fault("AG", 0.4),
        "AG",
        "AG",
        _zone(minimum_residual_current_a=20e3),
        "minimum_residual_current_a",
    ),
    Case(
        "slow swing",
        "PDIS1",
        "power-swing",
        swings.samples(NETWORK, swings.slipping(NETWORK, 1.0, 1.8)),
        None,
        None,
        {"rpsb": {"outer_resistance_ohm": 45.0, "inner_resistance_ohm": 22.0}},
        "RPSB",
    ),
    Case(
        "fast swing",
        "PDIS1",
        "power-swing",
        swings.samples(NETWORK, swings.slipping(NETWORK, 3.0, 1.2)),
        None,
        None,
        {"rpsb": {"outer_resistance_ohm": 45.0, "inner_resistance_ohm": 22.0}},
        "RPSB",
    ),
    Case("one fuse", "PDIS1", "fuse-failure", load({"B": 0.0}), None, "BG", {"tvtr": {}}, "TVTR"),
    Case(
        "three fuses",
        "PDIS1",
        "fuse-failure",
        load({"A": 0.0, "B": 0.0, "C": 0.0}),
        None,
        None,
        {"tvtr": {}},
        "TVTR",
    ),
]
