"""Instrument transformers in the plant: their steady start, their step, save and restore, wrong input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from faultloop.config.cvt_circuit import CvtCircuit, named_circuit
from faultloop.errors import InputError
from faultloop.plant import Plant
from faultloop.plant.ct import Ct, core_constants
from faultloop.plant.vt import Vt
from faultloop.study.suites.functions import plant_checks as checks
from faultloop.study.suites.functions.cases import tables
from tests.plant.record import record
from tests.plant.reference import build, network, phasors

CT = {"name": "T", "ratio": [1000, 1], "model": "saturating", "vs_v": 200.0, "burden_ohm": [5.0, 1.0]}
VT = {"name": "V", "ratio": [220e3, 110.0], "model": "cvt", "circuit": "A1"}
OWN = {"ce_nf": 60.0, "burden_va": 40.0, "power_factor": 0.7, "rf_ohm": 2e5, "lf_h": 800.0, "cf_nf": 13.0}
OWN |= {"tap_kv": 11.0, "lc_h": 170.0, "rc_ohm": 700.0}


def given(table: dict[str, Any]) -> dict[str, Any]:
    """Without the keys that are None."""
    return {key: value for key, value in table.items() if value is not None}


def measured(model: str = "rl", ct: Any = None, vt: Any = None, **tables: Any) -> Plant:
    """The relay at A behind the transformers, the one at B without any."""
    relays = network(model)["relay"]
    if ct is not None:
        relays[0]["ct"], tables["ct"] = "T", [given(CT | ct)]
    if vt is not None:
        relays[0]["vt"], tables["vt"] = "V", [given(VT | vt)]
    return Plant(build(model, relay=relays, **tables))


@pytest.mark.parametrize("hz", [50.0, 60.0])
@pytest.mark.parametrize("circuit", ["P1", "P2", "A1", "A2", OWN])
def test_a_circuits_modes_are_its_impedances(hz: float, circuit: Any) -> None:
    """H from poles and residues against the divider of plain complex impedances."""
    vt = Vt.model_validate(VT | {"circuit": circuit})
    c = named_circuit(circuit, hz) if isinstance(circuit, str) else CvtCircuit.model_validate(circuit)
    at = np.array([0.5, 3.0, 16.7, 45.0, hz, 75.0, 150.0, 400.0, 1500.0, 9000.0])
    s, omega, base = 2j * np.pi * at, 2 * np.pi * hz, (c.tap_kv * 1e3) ** 2
    lc = c.lc_h or 1 / (omega**2 * c.ce_nf * 1e-9)
    rc = c.rc_ohm or omega * lc / 100
    z = base / c.burden_va
    burden = z * c.power_factor + s / omega * z * np.sqrt(1 - c.power_factor**2)
    suppression = np.full(len(s), c.rf_ohm, dtype=complex)
    if c.lf_h is not None:
        cf = 1 / (omega**2 * c.lf_h) if c.cf_nf is None else c.cf_nf * 1e-9
        suppression += 1 / (s * cf + 1 / (omega * c.lf_h / 50 + s * c.lf_h))
    node = 1 / burden + 1 / suppression + 30 / base * omega / s + 20 / base
    series = 1 / (s * c.ce_nf * 1e-9) + rc + s * lc
    assert checks.response(vt, hz, at) == pytest.approx(1 / (1 + series * node), rel=1e-9)


def test_at_60_hz_the_same_per_unit_values_give_nearly_the_same_gain() -> None:
    """The class at nominal frequency is the circuit's, not the frequency's."""
    for name in ("P1", "P2", "A1", "A2"):
        vt = Vt.model_validate(VT | {"circuit": name})
        gains = [checks.response(vt, hz, np.array([hz]))[0] for hz in (50.0, 60.0)]
        assert abs(gains[0] - gains[1]) < 1e-3
        assert abs(gains[1] - 1) < 3e-3


@pytest.mark.parametrize("circuit", ["P1", "P2", "A1", "A2", OWN])
@pytest.mark.parametrize("core", [{}, {"class": "TPY"}, {"class": "TPZ"}])
def test_the_run_starts_in_the_steady_state_behind_both(circuit: Any, core: dict[str, Any]) -> None:
    """From the first sample on one sinusoid, history and second frequency included, and the phasors that the
    formulas say."""
    plant = measured(ct=core, vt={"circuit": circuit}, front_end={"antialias_hz": 900.0})
    before = plant.history(96)
    x, _ = record(plant, 960)
    assert np.abs(x[:96] - x[-96:]).max() < 1e-9 * np.abs(x).max()
    assert np.abs(before - x[:96]).max() < 1e-9 * np.abs(x).max()
    ideal, _ = record(measured(front_end={"antialias_hz": 900.0}), 960)
    ratio = phasors(x, 0, 4800)[0] / phasors(ideal, 0, 4800)[0]
    vt = Vt.model_validate(VT | {"circuit": circuit})
    assert ratio[:3] == pytest.approx(checks.response(vt, 50.0, np.full(3, 50.0)), abs=3e-5)
    ct, omega = Ct.model_validate(CT | core), 2 * np.pi * 50
    ts = {"TPX": np.inf, "TPY": 1.0, "TPZ": 0.06}[ct.core]
    lb = 1.0 / omega
    flux = (5.0 + 1j * omega * lb) / (1j * omega)  # of one secondary ampere
    assert ratio[3:] == pytest.approx(np.full(3, 1 / (1 + flux / (ts * 5.0 - lb))), abs=3e-5)


def test_ideal_transformers_change_no_bit() -> None:
    plant = measured(ct={"model": "ideal"}, vt={"model": "ideal", "circuit": None})
    x, _ = record(plant, 480)
    assert np.array_equal(x, record(measured(), 480)[0])


def test_only_the_relay_that_names_them_is_behind_them() -> None:
    fault = [{"name": "F", "line": "L", "at_pu": 0.2, "type": "AG", "start_s": 0.02}]
    x, _ = record(measured("bergeron", ct={"vs_v": 30.0}, vt={}, fault=fault), 960)
    ideal, _ = record(measured("bergeron", fault=fault), 960)
    assert np.array_equal(x[:, 1], ideal[:, 1]), "and the network does not feel them"
    apart = np.abs(x[:, 0] - ideal[:, 0]).max(axis=0) / np.abs(ideal[:, 0]).max(axis=0)
    assert apart[0] > 0.05 and apart[3] > 0.2


@pytest.mark.parametrize("case", ["V0", "V1", "V2"])
@pytest.mark.parametrize(("rate", "worst"), [(19200, 2e-3), (4800, 2e-2)])
def test_the_cores_step_is_stable_and_near_at_the_plants_own(case: str, rate: int, worst: float) -> None:
    """The golden cases at 52 and 208 us against 1 us; part of sqrt2 Ip/N."""
    table = next(own.input for _, cases in tables().values() for own in cases if own.name.startswith(case))
    ct = Ct.model_validate({"name": "T", "model": "saturating", **table["ct"]})
    hz, flux = table["frequency_hz"], ct.remanence_pu * ct.flux_at_vs(table["frequency_hz"])
    found = []
    for steps in (960_000, rate):
        _, ideal = checks.offset_current(table, ct.turns, steps)
        current, _ = checks.run_core(np.array(core_constants(ct, hz, steps)), flux, ideal)
        found.append(current)
    crest = np.sqrt(2) * table["primary_a"] / ct.turns
    fine, coarse = found[0][:: 960_000 // rate], found[1]
    assert np.abs(fine[: len(coarse)] - coarse).max() < worst * crest


@pytest.mark.parametrize(
    ("ct", "message"),
    [
        ({"vs_v": None}, r"ct\[T\]: model = \"saturating\" needs vs_v"),
        ({"burden_ohm": [-1.0, 0.0]}, r"ct\[T\]: burden_ohm must be \[r, x\] with r >= 0, x >= 0"),
        ({"burden_ohm": [0.0, 1.0]}, "some resistance"),
        ({"remanence_pu": 1.2}, r"ct\[T\]: remanence_pu of class TPX must be from -1 to 1, not 1.2"),
        ({"class": "TPY", "remanence_pu": 0.3}, "remanence_pu of class TPY must be from -0.1 to 0.1"),
        ({"class": "TPZ", "remanence_pu": -0.1}, "remanence_pu of class TPZ must be 0, not -0.1"),
        ({"class": "TPS"}, r"ct\[T\].class: input should be 'TPX', 'TPY' or 'TPZ'"),
        ({"time_constant_s": 0.1}, 'time_constant_s belongs to class = "TPY" or "TPZ"'),
        ({"class": "TPY", "time_constant_s": 1e-6}, r"time_constant_s must be at least 0.02 s .*, not 1e-06"),
        (
            {"class": "TPY", "time_constant_s": 0.02, "burden_ohm": [0.1, 5.0]},
            r"ct\[T\].time_constant_s: 0.02 s is no more than",
        ),
        (
            {"model": None},
            r'ct\[T\]: vs_v, burden_ohm without model = "saturating"; give it',
        ),
        ({"model": None, "vs_v": None, "burden_ohm": None, "rw_ohm": 1.0}, "rw_ohm without model"),
        ({"vs_v": 0.05}, r"ct\[T\].vs_v: the load alone needs .* times the flux at vs_v; give a higher vs_v"),
        ({"ratio": [1000]}, r"ct\[T\].ratio: needs 2 numbers"),
        ({"ratio": [1000, 0]}, r"ct\[T\].ratio"),
    ],
)
def test_wrong_current_transformers(ct: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        measured(ct=ct)


def test_an_ideal_one_may_keep_what_a_core_of_it_would_have() -> None:
    """So a campaign varies the model alone."""
    measured(ct={"model": "ideal"})
    measured(ct={"model": None, "vs_v": None, "burden_ohm": None})


@pytest.mark.parametrize(
    ("vt", "message"),
    [
        ({"circuit": "A3"}, r"vt\[V\].circuit: .*'P1', 'P2', 'A1' or 'A2'"),
        ({"circuit": None}, r"vt\[V\]: model = \"cvt\" needs circuit"),
        ({"model": "ideal"}, r'vt\[V\]: circuit and burden_va belong to model = "cvt"'),
        ({"model": "inductive"}, r"vt\[V\].model: input should be 'ideal' or 'cvt'"),
        ({"burden_va": -5.0}, r"vt\[V\].burden_va: input should be greater than or equal to 0"),
        (
            {"circuit": OWN | {"burden_va": -5.0}},
            r"vt\[V\].circuit.burden_va: input should be greater than or equal to 0",
        ),
        ({"circuit": {"ce_nf": 10.0, "rf_ohm": 1e5, "cf_nf": 3.0}}, "cf_nf needs lf_h"),
        ({"circuit": OWN | {"rf": 1.0}}, r"vt\[V\].circuit.rf: unknown key; did you mean 'rf_ohm'"),
        (
            {"burden_va": 1e9},
            r"vt\[V\].circuit: passes 0.00 of the voltage at .* see ce_nf, lc_h and burden_va",
        ),
        (
            {"circuit": {"ce_nf": 100.0, "lc_h": 1.0, "rf_ohm": 1e6}},
            r"vt\[V\].circuit: lc_h and ce_nf are tuned to 503.3 Hz, not 50; lc_h = 101.3 is in tune",
        ),
        (
            {"circuit": {"ce_nf": 100.0, "rf_ohm": 1.7e5, "lf_h": 500.0, "cf_nf": 1.0}},
            r"vt\[V\].circuit: lf_h and cf_nf are tuned to 225.1 Hz, not 50",
        ),
        ({"circuit": OWN | {"ce_nf": 1e9}}, r"vt\[V\].circuit.ce_nf: .* less than or equal to 10000"),
        ({"circuit": OWN | {"tap_kv": 13e3}}, r"vt\[V\].circuit.tap_kv: .* less than or equal to 100"),
        ({"circuit": {"rf_ohm": 1e5}}, r"vt\[V\].circuit.ce_nf: missing"),
    ],
)
def test_wrong_voltage_transformers(vt: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        measured(vt=vt)


def test_a_relay_names_transformers_that_exist() -> None:
    relays = [r | {"ct": "X"} for r in network("rl")["relay"]]
    with pytest.raises(InputError, match=r"relay\[RA\].ct: there is no ct 'X'"):
        build("rl", relay=relays)
    relays = [r | {"vt": "X"} for r in network("rl")["relay"]]
    with pytest.raises(InputError, match=r"relay\[RA\].vt: there is no vt 'X'"):
        build("rl", relay=relays)
