"""The same circuit in DPsim: a phase-to-ground fault at the end of a pi line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from faultloop.plant import Plant
from tests.measured import Measured
from tests.plant.record import record
from tests.plant.reference import build

dpsimpy = pytest.importorskip("dpsimpy", reason="DPsim (PyPI dpsim) is not installed here")

RATE = 100_000
FAULT = 0.5
END = 0.56
KM = 60.0
OMEGA = 2 * np.pi * 50


def three(zero: float, positive: float) -> np.ndarray:
    return np.eye(3) * positive + (zero - positive) / 3


def dpsim(folder: Path) -> np.ndarray:
    """(steps, 7): time, bus voltages, currents from the source."""
    emt = dpsimpy.emt
    ground = emt.SimNode.gnd
    n1, n2, n3 = (emt.SimNode(name, dpsimpy.PhaseType.ABC) for name in ("n1", "n2", "n3"))
    source = emt.ph3.VoltageSource("source")  # takes RMS line to line
    source.set_parameters(dpsimpy.Math.single_phase_variable_to_three_phase(220e3 + 0j), 50)
    source.connect([ground, n1])
    behind = emt.ph3.PiLine("behind")
    behind.set_parameters(three(8.0, 6.0), three(11.0, 14.0) / OMEGA)
    behind.connect([n1, n2])
    line = emt.ph3.PiLine("line")
    line.set_parameters(
        three(0.24, 0.06) * KM, three(1.2, 0.4) * KM / OMEGA, three(1.8e-6, 2.8e-6) * KM / OMEGA
    )
    line.connect([n2, n3])
    switch = emt.ph3.Switch("fault")
    switch.set_parameters(np.eye(3) * 1e9, np.diag([10.0, 1e9, 1e9]), False)
    switch.connect([ground, n3])
    simulation = dpsimpy.Simulation("fault", dpsimpy.LogLevel.off)
    simulation.set_system(dpsimpy.SystemTopology(50, [ground, n1, n2, n3], [source, behind, line, switch]))
    simulation.set_domain(dpsimpy.Domain.EMT)
    simulation.set_time_step(1 / RATE)
    simulation.set_final_time(END)
    simulation.add_event(dpsimpy.event.SwitchEvent3Ph(FAULT, switch, True))
    logger = dpsimpy.Logger("fault")
    logger.log_attribute("v", n2.attr("v"))
    logger.log_attribute("i", behind.attr("i_intf"))
    simulation.add_logger(logger)
    simulation.run()
    table = np.genfromtxt(folder / "logs" / "fault.csv", delimiter=",", names=True)
    return np.stack([table[n] for n in ("time", "v_0", "v_1", "v_2", "i_0", "i_1", "i_2")], axis=1)


def ours(start: float) -> np.ndarray:
    """(samples, 6) at the bus, the fault beginning at ``start`` [s]."""
    line = {"name": "L", "from": "A", "to": "B", "length_km": KM, "model": "pi", "sections": 1}
    line |= {"r1_ohm_per_km": 0.06, "x1_ohm_per_km": 0.4, "b1_us_per_km": 2.8}
    line |= {"r0_ohm_per_km": 0.24, "x0_ohm_per_km": 1.2, "b0_us_per_km": 1.8}
    plant = Plant(
        build(
            "pi",
            system={"sampling_hz": RATE, "steps_per_sample": 1},
            source=[{"name": "A", "bus": "A", "z1_ohm": [6.0, 14.0], "z0_ohm": [8.0, 11.0]}],
            line=[line],
            fault=[{"name": "F", "bus": "B", "type": "AG", "start_s": start, "resistance_ohm": 10.0}],
            relay=[{"name": "R", "line": "L", "end": "from", "settings": "none.toml"}],
        )
    )
    return record(plant, round(END * RATE))[0][:, 0]


def test_same_waveforms_as_dpsim(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, measured: Measured) -> None:
    """DPsim solves the step that ends at the event with the switch closed, by the trapezoidal rule: as if it
    closed in the middle of that step, between two of ours, whose mean is that to second order."""
    monkeypatch.chdir(tmp_path)  # it writes ./logs
    theirs = dpsim(tmp_path)
    mine = (ours(FAULT) + ours(FAULT - 1 / RATE)) / 2
    rows = np.round(theirs[:, 0] * RATE).astype(int)
    keep = (rows >= round((FAULT - 0.02) * RATE)) & (rows < len(mine))
    theirs, mine = theirs[keep], mine[rows[keep]]
    volts = np.abs(mine[:, :3] - theirs[:, 1:4]).max() / np.abs(theirs[:, 1:4]).max()
    # DPsim counts the current behind the bus, towards the source; no other branch is at the bus
    amperes = np.abs(mine[:, 3:] + theirs[:, 4:]).max() / np.abs(theirs[:, 4:]).max()
    measured("voltages differ by", 100 * volts, "% of the peak")
    measured("currents differ by", 100 * amperes, "% of the peak")
    assert volts < 0.005 and amperes < 0.005
