"""What the components' tables in ``cases/`` are checked with: each from a case's input to named numbers.

Nothing here knows an expected value; a check drives the plant, or one component's kernel, and measures.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from faultloop.jit import njit
from faultloop.plant import Plant
from faultloop.plant.ct import FLUX, Ct, core_constants, core_step
from faultloop.plant.vt import MODES, Vt, settle_vt, vt_constants, vt_step
from faultloop.study.suites.functions.two_ended import (
    BASE_KV,
    KM,
    LINE,
    SOURCES,
    A,
    build,
    network,
    phasors,
    record,
)

Case = dict[str, Any]
Floats = NDArray[np.float64]
LIMITS = {  # IEC 61869-5: largest residual in % at 10, 20, 40, 60, 90 ms
    "3PT3": (4.0, 2.0, 2.0, 2.0, 2.0),
    "3PT2": (25.0, 10.0, 2.0, 0.6, 0.2),
    "3PT1": (100.0, 10.0, 10.0, 10.0, 10.0),
}


def core(case: Case) -> Case:
    """One core, 0.12 s at 1 us, from rest."""
    hz = case["frequency_hz"]
    ct = Ct.model_validate({"name": "T", "model": "saturating", **case["ct"]})
    t, ideal = offset_current(case, ct.turns, 1e6)
    current, flux = run_core(
        np.array(core_constants(ct, hz, 1e6)), ct.remanence_pu * ct.flux_at_vs(hz), ideal
    )
    at = np.rint(np.array(case["at_ms"]) * 1e3).astype(int)
    apart = np.abs(ideal - current) > 0.1 * math.sqrt(2) * case["primary_a"] / ct.turns
    peak = np.abs(flux).argmax()
    return {
        "curve": ct.curve(hz),
        "i1": ideal[at],
        "secondary": current[at],
        "flux": flux[at],
        "peak_flux": abs(flux[peak]),
        "peak_flux_ms": t[peak] * 1e3,
        "ten_percent_ms": t[apart.argmax()] * 1e3 if apart.any() else -1.0,
        "largest": current.max(),
        "least": current.min(),
    }


def gapped_core(case: Case) -> Case:
    """A gapped core far from saturation, at 1 us; largest error against the closed form, of the crest.

    ``x' + x/Ts = Rt i1`` with i1 a cosine and an exponential has both as particular solutions."""
    omega = 2 * math.pi * case["frequency_hz"]
    ct = Ct.model_validate({"name": "T", "model": "saturating", **case["ct"]})
    t, ideal = offset_current(case, ct.turns, 1e6)
    constants = core_constants(ct, case["frequency_hz"], 1e6)
    current, _ = run_core(np.array(constants), 0.0, ideal)
    assert ct.burden_ohm is not None
    resistance, ts = ct.rw_ohm + ct.burden_ohm[0], ct.time_constant_s or 0.06
    tau, crest = case["x_over_r"] / omega, math.sqrt(2) * case["primary_a"] / ct.turns
    share = resistance * crest
    decaying = share * case["offset"] / (1 / ts - 1 / tau)
    turning = -share * np.exp(-1j * math.acos(case["offset"])) / (1j * omega + 1 / ts)
    x = decaying * np.exp(-t / tau) + (turning * np.exp(1j * omega * t)).real
    x -= (decaying + turning.real) * np.exp(-t / ts)
    return {"error": np.abs(current - (ideal - x / (resistance * ts))).max() / crest}


def offset_current(case: Case, turns: float, rate: float) -> tuple[Floats, Floats]:
    """Times [s] and ideal secondary current [A] of 0.12 s."""
    t = np.arange(int(0.12 * rate)) / rate
    omega, offset = 2 * math.pi * case["frequency_hz"], case["offset"]
    decay = offset * np.exp(-t * omega / case["x_over_r"])
    crest = math.sqrt(2) * case["primary_a"] / turns
    return t, crest * (decay - np.cos(omega * t - math.acos(offset)))


@njit
def _steps(constants: Floats, state: Floats, ideal: Floats, out: Floats) -> None:
    for k in range(1, len(ideal)):
        out[k, 0] = core_step(constants, state, ideal[k])
        out[k, 1] = state[FLUX]


def run_core(constants: Floats, flux: float, ideal: Floats) -> tuple[Floats, Floats]:
    """Secondary current and flux; at rest but for the flux before."""
    state, out = np.array([flux, 0.0]), np.zeros((len(ideal), 2))
    out[0, 1] = flux
    _steps(constants, state, ideal, out)
    return out[:, 0], out[:, 1]


def cvt(case: Case) -> Case:
    """A circuit's modes, its response, and what is left when the primary is shorted, at 19200 steps/s."""
    hz = float(case["frequency_hz"])
    vt = Vt.model_validate({"name": "T", "ratio": [1.0, 1.0], "model": "cvt", "circuit": case["circuit"]})
    poles, _ = vt.modes(hz)
    poles = poles[np.argsort(-np.abs(poles.real))]
    gain = response(vt, hz, np.array([hz]))[0]
    others = response(vt, hz, np.array(case["at_hz"], dtype=float))
    zero, peak = (shorted(vt, hz, angle) for angle in (-90.0, 0.0))
    at = np.array([10, 20, 40, 60, 90]) * 192 // 10
    largest = np.array([np.abs(zero[k:]).max() for k in at])
    return {
        "poles": np.stack([poles.real, poles.imag], axis=1),
        "gain": abs(gain),
        "angle_deg": np.degrees(np.angle(gain)),
        "gains": np.abs(others / gain),
        "angles_deg": np.degrees(np.angle(others)),
        "zero": zero[at],
        "peak": peak[at],
        "largest": largest,
        "class": next((c for c, limits in LIMITS.items() if np.all(largest <= limits)), "none"),
    }


def response(vt: Vt, nominal_hz: float, hz: Floats) -> NDArray[np.complex128]:
    """H at frequencies, from the modes."""
    poles, residues = vt.modes(nominal_hz)
    s = 2j * np.pi * hz[:, None]
    pairs = poles.imag > 0
    upper = np.where(pairs, residues / 2, residues) / (s - poles)
    lower = np.where(pairs, np.conj(residues) / 2, 0) / (s - np.conj(poles))
    return (upper + lower).sum(axis=1)


def shorted(vt: Vt, hz: float, angle_deg: float) -> Floats:
    """Secondary voltage in % of its crest before, for 0.2 s, when the primary is shorted at ``angle_deg``.

    By the kernel that the plant steps.  A short is a ramp of one step there: its middle has the angle, and
    times count from it."""
    rate, count = 19200, 3841
    turn = 2 * np.pi * hz / rate
    angle = math.radians(angle_deg) - turn / 2
    vts = vt_constants([(0, vt)], hz, rate)
    state, x = np.zeros((1, 3, MODES + 1, 2)), np.full((1, 6), np.exp(1j * angle))
    settle_vt(vts, state, x, turn)
    out = np.zeros(count)
    for k in range(count):
        sample = np.full((1, 6), math.cos(angle) if k == 0 else 0.0)
        vt_step(vts, state, sample)
        out[k] = sample[0, 0]
    return 50 * (out[1:] + out[:-1]) / abs(x[0, 0])


def load(case: Case) -> Case:
    """What the plant's samples say of a load at the far bus of a line from one source."""
    data = network("rl", load=[{"name": "P", "bus": "B", **case["load"]}])
    data["source"] = data["source"][:1]
    x, _ = record(Plant(build_from(data)), 480)
    v, i = phasors(x, 0, 4800)[1, :3], -phasors(x, 0, 4800)[1, 3:]
    z1 = v[0] / i[0]
    fault = {"name": "F", "line": "L", "at_pu": 0.5, "type": "AG", "start_s": 0.01, "resistance_ohm": 10.0}
    x, _ = record(Plant(build_from(data | {"fault": [fault]})), 4800)
    unbalanced = phasors(x, 0, 4800)[1]
    v0, i0 = unbalanced[:3].sum() / 3, -unbalanced[3:].sum() / 3
    z0 = v0 / i0
    return {
        "z1_ohm": np.array([z1.real, z1.imag]),
        "z0_ohm": np.array([z0.real, z0.imag]),
        "y0_us": abs(1e6 / z0),
    }


def closing(case: Case) -> Case:
    """An open breaker at the head of the line closes onto line and load."""
    data = network(
        "rl",
        load=[{"name": "P", "bus": "B", **case["load"]}],
        breaker=[{"name": "Q", "line": "L", "end": "from", "closed": False}],
        switching=[{"breaker": "Q", "operation": "close", "at_s": case["at_s"]}],
    )
    data["source"] = data["source"][:1]
    x, changes = record(Plant(build_from(data)), 960)
    omega = 2 * np.pi * 50
    at = round(case["at_s"] * 19200) / 19200
    assert [(c.kind, c.value) for c in changes] == [("pole", 7)]
    power = complex(case["load"]["mw"], -case["load"]["mvar"])
    z = SOURCES["A"][1] + complex(LINE["r1"], LINE["x1"]) * KM + BASE_KV**2 / power
    current = BASE_KV * 1e3 * math.sqrt(2 / 3) / z * np.array([1, A**2, A])
    t = np.arange(960)[:, None] / 4800
    decay = np.exp(-(t - at) * z.real / (z.imag / omega))
    exact = (current * np.exp(1j * omega * t)).real - (current * np.exp(1j * omega * at)).real * decay
    exact = np.where(t > at, exact, 0.0)
    before = x[: int(at * 4800), 0, 3:]
    return {
        "error": np.abs(x[:, 0, 3:] - exact).max() / np.abs(current[0]),
        "before_a": np.abs(before).max(),
    }


SWINGING = ((1.0, 10.0), (6.0, 40.0), (2.0, 20.0))
"""[ohm] behind A, the line, behind B."""


def between_two(k: float, at_s: list[float], angle_deg: list[float], share: float = 1.0) -> Plant:
    """Two sources over a line without capacitance; that at A is ``k`` of the other.

    It takes its share of the swing, that at B the rest."""
    behind_a, line, behind_b = SWINGING
    own = network("rl")["line"][0] | {"length_km": 1.0}
    own |= {"r1_ohm_per_km": line[0], "x1_ohm_per_km": line[1]}
    sources = [
        {"name": bus, "bus": bus, "voltage_pu": pu, "z1_ohm": list(z), "z0_ohm": list(z)}
        for bus, pu, z in (("A", k, behind_a), ("B", 1.0, behind_b))
    ]
    swing = [
        {"source": bus, "at_s": at_s, "angle_deg": [part * angle for angle in angle_deg]}
        for bus, part in (("A", share), ("B", share - 1.0))
    ]
    return Plant(build("rl", line=[own], source=sources, swing=swing, scenario={"duration_s": 5.0}))


def swing_locus(case: Case) -> Case:
    """The impedance at A once the source stands at its angle."""
    x, _ = record(between_two(case["k"], [0.1, 0.6], [0.0, case["d_deg"]]), 6720)
    at_a = phasors(x, 0, 4800)[0]
    z = at_a[0] / at_a[3]
    return {"z_ohm": np.array([z.real, z.imag])}


def swing_speed(case: Case) -> Case:
    """How fast the impedance of the space vectors moves where the angle has its values.

    Each source takes half of the slip."""
    slip = case["slip_hz"]
    x, _ = record(between_two(1.0, [0.0, 0.9 / slip], [0.0, 324.0], share=0.5), round(0.9 / slip * 4800))
    vectors = x[:, 0].reshape(-1, 2, 3) @ np.array([1, A, A**2])
    z = vectors[:, 0] / vectors[:, 1]
    speed = []
    for d in case["d_deg"]:
        first, last = (round((d + side) / 360 / slip * 4800) for side in (-1, 1))
        speed.append(abs(z[last] - z[first]) * 4800 / (last - first))
    return {"ohm_per_s": np.array(speed)}


def build_from(data: Case) -> Any:
    return type(build("rl")).from_dict(data)


CHECKS: dict[str, Callable[[Case], Case]] = {
    "core": core,
    "gapped core": gapped_core,
    "cvt": cvt,
    "load": load,
    "closing": closing,
    "swing locus": swing_locus,
    "swing speed": swing_speed,
}
