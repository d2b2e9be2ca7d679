"""A run shares nothing with another of its process, ends as it is told to, and takes settings as objects."""

from __future__ import annotations

import signal
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

import faultloop
from faultloop.cli import call
from faultloop.errors import InputError
from faultloop.io.can.transport import open_bus
from faultloop.loop.runner import Interrupted

SCENARIOS = Path(__file__).resolve().parents[2] / "scenarios"
AG = SCENARIOS / "ag-zone1.toml"
MHO = SCENARIOS / "settings" / "ab-mho.toml"


def told(result: faultloop.Result) -> tuple[Any, ...]:
    return (
        result.trips,
        result.events,
        result.can_frames,
        result.bus_load,
        str(result.fault_locations),
        result.phasors("RA").tobytes(),
        result.elements("RB").tobytes(),
    )


def test_runs_in_threads_give_what_each_gives_alone() -> None:
    paths = [
        SCENARIOS / f"{name}.toml" for name in ("ag-zone1", "bc-60-percent", "lossy-bus", "abc-close-in")
    ]
    alone = [told(faultloop.run(path)) for path in paths]
    with ThreadPoolExecutor(4) as pool:
        together = [told(result) for result in pool.map(faultloop.run, paths * 2)]
    for i, (one, other) in enumerate(zip(alone * 2, together, strict=True)):
        assert one == other, paths[i % len(paths)]


def test_a_bus_that_is_asked_for_by_name_is_shared_and_no_other(request: pytest.FixtureRequest) -> None:
    heard = {}
    for name, can in (("faultloop", None), (request.node.nodeid, f"virtual:{request.node.nodeid}")):
        bus = open_bus(channel=name)
        try:
            result = faultloop.run(
                AG, can=can, overrides=["scenario.duration_s=0.02", "fault.F1.after_s=0.01"]
            )
            heard[name] = sum(1 for _ in iter(lambda bus=bus: bus.recv(0), None))
        finally:
            bus.shutdown()
    assert heard == {"faultloop": 0, request.node.nodeid: result.can_frames}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_in_a_script_closes_the_log_and_is_raised(number: int, tmp_path: Path) -> None:
    before = signal.getsignal(number)
    log = tmp_path / "run.mcap"

    def press(part: float) -> None:
        if part > 0.3:
            signal.raise_signal(number)

    with pytest.raises(KeyboardInterrupt) as ended:
        faultloop.run(AG, log=log, progress=press)
    assert isinstance(ended.value, Interrupted)
    result = ended.value.result
    assert result.interrupted and 0.1 < result.simulated_s < 0.3
    rows = faultloop.open_log(log).samples("RA")
    assert rows["t_ns"][-1] / 1e9 == pytest.approx(result.simulated_s - 1 / 4800, abs=1e-8)
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]
    assert signal.getsignal(number) is before


def reaches(result: faultloop.Result) -> set[str]:
    return {trip.function for trip in result.trips if trip.relay == "RA"}


def test_settings_as_objects_dicts_and_overrides_are_the_same() -> None:
    """Zone 1 shortened to 5 %: RA waits for its zone 2; RB is as it was."""
    whole = faultloop.run(AG)
    settings = faultloop.load_settings(MHO)
    short = settings.model_dump(mode="json", exclude_unset=True)
    short["pdis"][0]["reach_pu"] = 0.05
    by = [
        faultloop.run(AG, settings={"RA": faultloop.RelaySettings.from_dict(short)}),
        faultloop.run(AG, settings={"RA": short}),
        faultloop.run(AG, overrides=["relay.RA.pdis.1.reach_pu=0.05"]),
        faultloop.run(AG, overrides=["relay.0.pdis.1.reach_pu=0.05"]),
        faultloop.run(AG, settings={"RA": settings}, overrides=["relay.RA.pdis.1.reach_pu=0.05"]),
    ]
    assert "PDIS1" in reaches(whole)
    for result in by:
        assert "PDIS1" not in reaches(result)
        assert told(result) == told(by[0])
    kept = [trip for trip in by[0].trips if trip.relay == "RB"]
    assert [trip.function for trip in kept] == [t.function for t in whole.trips if t.relay == "RB"]


def test_more_parts_than_the_scenarios_key_mean_the_setting() -> None:
    twice = ["relay.RA.line.z1_ohm=[12.0, 80.0]", "relay.RA.line.z0_ohm=[48.0, 240.0]"]
    result = faultloop.run(AG, overrides=twice)
    assert result.scenario.relay[0].line == "AB"
    # a line twice as long in the settings: the fault is at half the place
    usual = faultloop.run(AG).fault_locations["RA"]
    assert result.fault_locations["RA"] == pytest.approx(usual / 2, rel=1e-3)
    with_filter = faultloop.run(AG, overrides=["relay.RA.front_end.adc_bits=0"])  # a table of the scenario's
    assert with_filter.scenario.relay[0].front_end is not None


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("relay.RA.pdis.1.reach_pu=-1", r"^--set: .*ab-mho.toml: pdis\[1\].reach_pu: .*greater than 0"),
        ("relay.RA.pdis.1.reech_pu=1", r"^--set: .*pdis\[1\].reech_pu: unknown key; did you mean 'reach_pu'"),
        ("relay.RA.pdis.9.reach_pu=1", "^--set: .*no pdis '9'"),
        ("relay.RX.pdis.1.reach_pu=1", "^--set: .*there is no relay 'RX'"),
        ("relay.RA.estimator.method=fuorier", r"^--set: .*estimator.method: .*did you mean 'fourier'"),
        ("fault.F1.at_pu=7", r"^--set: fault\[F1\].at_pu: .*less than or equal to 1"),
        ("relay.RA.sett=x.toml", r"^--set: .*sett"),
    ],
)
def test_what_an_override_makes_wrong_is_told_of_it(override: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        faultloop.run(AG, overrides=[override])


def test_what_is_wrong_without_it_is_told_of_the_file(tmp_path: Path) -> None:
    broken = tmp_path / "broken.toml"
    broken.write_text(AG.read_text().replace('type = "AG"', 'type = "AX"'))
    with pytest.raises(InputError, match=r"broken.toml: fault\[F1\].type"):
        faultloop.run(broken, overrides=["relay.RA.pdis.1.reach_pu=0.5"])


def test_settings_of_a_relay_that_is_not_there() -> None:
    with pytest.raises(InputError, match="settings: there is no relay 'RC'; "):
        faultloop.run(AG, settings={"RC": faultloop.load_settings(MHO)})
    with pytest.raises(InputError, match=r"settings of relay 'RA': .*unknown key"):
        faultloop.run(AG, settings={"RA": {"rellay": {}}})


def test_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["run", str(AG), "--log", str(tmp_path / "x.mcap"), "--set", "relay.RA.pdis.1.reach_pu=0.05"]
    assert call(arguments) == 3  # the scenario expects zone 1
    assert "RA" in capsys.readouterr().out
    overrides = faultloop.open_log(tmp_path / "x.mcap").metadata["scenario"]["overrides"]
    assert overrides == "relay.RA.pdis.1.reach_pu=0.05"
