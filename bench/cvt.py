"""Zone 1 of 80 % behind capacitive voltage transformers: what it does beyond the line and how soon inside.

    python bench/cvt.py [--circuits ideal,P1,P2,A1,A2] [--sir 0.5,1,5,10,18,30] [--at 0.1,0.3,0.5,0.7,0.9,1]
                        [--angles 12] [--kind none|ideal|cvt] [--burden 100] [--noise 0] [--zone mho|quad]
                        [--types AG,BC,BCG,ABC] [--frequency 50] [--order 2] [--within MS]
                        [--markdown] [--keep]

A 220 kV Bergeron line of 100 km with 80 km behind its far end, a source of SIR times the line, 8 degrees of
load, bolted A-G, B-C, B-C-G and A-B-C, 1500 Hz low-pass.  ``--kind`` is what the relay is told of its VT:
nothing, that it is ideal, or its circuit with 100 VA; ``--burden`` [VA] of the plant's circuit, which nobody
tells it; ``--noise`` of the voltages, of their RMS.  ``--within``: how many start within so many ms, and the
slowest, in place of median and worst; ``--markdown``: a table for docs/relay.md.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from faultloop.loop.scenario import Scenario
from faultloop.plant import Plant
from faultloop.relay import Relay, RelaySettings

RATE, WARM, DURATION_S = 4800, 1920, 0.2
Z1, Z0 = 6 + 40j, 24 + 120j
LINE = {"model": "bergeron", "r1_ohm_per_km": 0.06, "x1_ohm_per_km": 0.4, "b1_us_per_km": 4.4,
        "r0_ohm_per_km": 0.24, "x0_ohm_per_km": 1.2, "b0_us_per_km": 2.6}  # fmt: skip
TYPES = ("AG", "BC", "BCG", "ABC")


def samples(
    circuit: str,
    sir: float,
    at: float,
    kind: str,
    angle: float,
    burden: float,
    hz: float = 50,
    order: int = 2,
) -> tuple[np.ndarray, int]:
    """(n, 6) at the line's beginning, and the number of the first one of the fault."""
    zs = sir * abs(Z1) * Z1 / abs(Z1)
    zs0 = 1.5 * sir * abs(Z1) * Z0 / abs(Z0)
    place = {"line": "AB", "at_pu": at} if at <= 1 else {"line": "BC", "at_pu": (at - 1) / 0.8}
    vt = {"name": "V", "ratio": [220000, 100], "model": "cvt", "circuit": circuit, "burden_va": burden}
    relay = {"name": "R", "line": "AB", "end": "from", "settings": "none"}
    data = {
        "scenario": {"name": "cvt", "duration_s": DURATION_S},
        "system": {"frequency_hz": hz, "base_kv": 220, "sampling_hz": RATE},
        "source": [
            {
                "name": "SA",
                "bus": "A",
                "angle_deg": 8.0,
                "z1_ohm": [zs.real, zs.imag],
                "z0_ohm": [zs0.real, zs0.imag],
            },
            {"name": "SC", "bus": "C", "z1_ohm": [2.0, 20.0], "z0_ohm": [3.0, 30.0]},
        ],
        "line": [
            {"name": "AB", "from": "A", "to": "B", "length_km": 100, **LINE},
            {"name": "BC", "from": "B", "to": "C", "length_km": 80, **LINE},
        ],
        "fault": [{**place, "type": kind, "angle_deg": angle, "after_s": 0.02}],
        "relay": [relay if circuit == "ideal" else relay | {"vt": "V"}],
        "front_end": {"antialias_hz": 1500, "antialias_order": order},
    }
    if circuit != "ideal":
        data["vt"] = [vt]
    plant = Plant(Scenario.from_dict(data))
    blocks, begin = [plant.history(WARM)[:, 0]], 0
    total = round(DURATION_S * RATE)
    while plant.sample_count < total:
        done = plant.advance(total - plant.sample_count)
        blocks.append(plant.samples[:done, 0].copy())
        for change in plant.changes:
            if change.kind == "fault" and change.value:
                begin = begin or WARM - (-change.t_ns * RATE // 10**9)
    return np.concatenate(blocks), begin


def settings(told: str, zone: str, estimator: str, circuit: str = "ideal", hz: float = 50) -> RelaySettings:
    shape = {"characteristic": "quad", "resistive_reach_ohm": 20.0} if zone == "quad" else {}
    data = {
        "relay": {"frequency_hz": hz, "nominal_kv": 220},
        "estimator": {"method": estimator, "unsafe": True},
        "line": {"z1_ohm": [Z1.real, Z1.imag], "z0_ohm": [Z0.real, Z0.imag]},
        "pdis": [{"zone": 1, "reach_pu": 0.8, **shape}],
    }
    if told == "ideal" or (told == "cvt" and circuit == "ideal"):
        data["vt"] = {"kind": "ideal"}
    elif told == "cvt":
        data["vt"] = {"kind": "cvt", "circuit": circuit}
    return RelaySettings.from_dict(data)


def start_ms(relay: Relay, x: np.ndarray, begin: int) -> float:
    """Of zone 1, after the fault; NaN if it does not start."""
    done = 0
    while done < len(x):
        m = relay.advance(x[done:])
        on = np.flatnonzero(relay.pickup[:m] & np.uint64(1))
        if len(on):
            return 1e3 * (done + on[0] - begin) / RATE
        done += m
    return math.nan


def cell(times: np.ndarray, within: float) -> str:
    """How many started, and how soon; or how many did in time."""
    if within < math.inf:
        return f"{(times <= within).sum()}/{len(times)} ({np.nanmax(times):.0f})"
    started = times[~np.isnan(times)]
    return f"{len(started)}" + (f" {np.median(started):.0f}/{started.max():.0f}" if len(started) else "")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--circuits", default="ideal,P1,P2,A1,A2")
    parser.add_argument("--sir", default="0.5,1,5,10,18,30")
    parser.add_argument("--at", default="0.1,0.3,0.5,0.7,0.85,0.9,1,1.1")
    parser.add_argument("--angles", type=int, default=12)
    parser.add_argument("--kind", choices=("none", "ideal", "cvt"), default="none")
    parser.add_argument("--burden", type=float, default=100.0)
    parser.add_argument("--noise", type=float, default=0.0)
    parser.add_argument("--zone", choices=("mho", "quad"), default="mho")
    parser.add_argument("--estimator", default="kalman-bank")
    parser.add_argument("--types", default=",".join(TYPES))
    parser.add_argument("--frequency", type=float, default=50.0)
    parser.add_argument("--order", type=int, choices=(2, 4), default=2, help="of the low-pass")
    parser.add_argument("--within", type=float, default=math.inf)
    parser.add_argument("--markdown", action="store_true")
    parser.add_argument("--keep", action="store_true", help="leave the figures for docs/evidence.md")
    given = parser.parse_args()
    rows: list[tuple[str, str]] = []
    rng = np.random.default_rng(1)
    types, places = given.types.split(","), [float(at) for at in given.at.split(",")]
    print(f"told: {given.kind}; {given.zone}; {given.estimator}; {given.burden:g} VA; starts of"
          f" {len(types) * given.angles}: median/worst ms")  # fmt: skip
    if given.markdown:
        print("| circuit, SIR | " + " | ".join(f"{at:.0%}" for at in places) + " |")
        print("|" + "---|" * (len(places) + 1))
    for circuit in given.circuits.split(","):
        for sir in map(float, given.sir.split(",")):
            cells = []
            for at in places:
                times = []
                for kind in types:
                    for k in range(given.angles):
                        angle, hz = 180.0 * k / given.angles, given.frequency
                        x, begin = samples(circuit, sir, at, kind, angle, given.burden, hz, given.order)
                        x[:, :3] += given.noise * 220e3 / math.sqrt(3) * rng.standard_normal((len(x), 3))
                        relay = Relay(settings(given.kind, given.zone, given.estimator, circuit, hz))
                        times.append(start_ms(relay, x, begin))
                cells.append(cell(np.array(times), given.within))
            what = f"Zone 1 of 80 % ({given.zone}) behind {circuit}, told: {given.kind}, SIR {sir:g}"
            shown = f"within {given.within:g} ms (slowest)" if given.within < math.inf else "median/worst ms"
            what += f", low-pass of order {given.order}, {given.burden:g} VA, {given.frequency:g} Hz"
            figures = "; ".join(f"{at:.0%}: {text}" for at, text in zip(places, cells, strict=True))
            rows.append((f"{what}; starts of {len(types) * given.angles}, {shown}", figures))
            if given.markdown:
                print(f"| {circuit}, {sir:g} | " + " | ".join(cells) + " |", flush=True)
            else:
                told = (f"{at:g}: {text}" for at, text in zip(places, cells, strict=True))
                print(f"{circuit:6s} SIR {sir:<4g} " + "  ".join(told), flush=True)
    if given.keep:
        from results import keep  # a test loads this file from elsewhere

        keep("Security and instrument transformers", rows, beside=True)


if __name__ == "__main__":
    main()
