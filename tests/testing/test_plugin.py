"""The pytest plugin, by pytest."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from faultloop.jit import cache_root

pytest_plugins = ["pytester"]

COMPILED = cache_root()  # pytester changes the home folder
NUMBER = re.compile(r"\d+\.\d+")
"""Times in the documented output: the relay's, not the plugin's."""
QUIET = ("-n", "0", "-p", "no:cacheprovider", "-q")


@pytest.fixture
def project(pytester: pytest.Pytester, root: Path, monkeypatch: pytest.MonkeyPatch) -> pytest.Pytester:
    """A user's project: a scenario, its settings, the example's breaker."""
    monkeypatch.setenv("FAULTLOOP_CACHE", str(COMPILED))
    for folder, pattern in (("scenarios", "ag-zone1.toml"), ("scenarios/settings", "*.toml")):
        for file in (root / folder).glob(pattern):
            place = pytester.path / Path(folder).relative_to("scenarios") / file.name
            place.parent.mkdir(exist_ok=True)
            place.write_bytes(file.read_bytes())
    (pytester.path / "my_breaker.py").write_bytes((root / "examples" / "my_breaker.py").read_bytes())
    pytester.syspathinsert()
    return pytester


def test_the_documented_example_passes(project: pytest.Pytester, root: Path) -> None:
    text = (root / "docs" / "testing.md").read_text(encoding="utf-8")
    example = next(iter(re.findall(r"```python\n(.*?)```", text, re.DOTALL)))
    assert len([line for line in example.splitlines() if line.strip()]) <= 11
    project.makepyfile(test_mine=example)
    project.runpytest_subprocess(*QUIET).assert_outcomes(passed=1)


def test_what_a_run_can_be_asked(project: pytest.Pytester) -> None:
    project.makepyfile(
        test_mine="""
        import math
        import pytest
        import faultloop

        QUIET = ["fault.F1.resistance_ohm=1e6"]

        def test_run(faultloop_bus):
            run = faultloop_bus.run("ag-zone1.toml", pace=math.inf)
            assert [t.relay for t in run.trips] == ["RA", "RB"]
            trip = run.trip("RA", zone=1, loop="AG", within_ms=30)
            assert trip.poles == "ABC" and trip.decided_ms < trip.received_ms < trip.opened_ms
            assert [v.held for v in run.verdicts] == [True, True]
            run.check()
            sent = run.frames("TRIP", number=0)
            assert {f.sender for f in sent} == {"RA"} and [sent[0].poles, sent[-1].poles] == ["", ""]
            first = next(f for f in sent if f.poles == "ABC")
            assert first.t_ms == pytest.approx(run.result.fault_start_ns / 1e6 + trip.received_ms, abs=1e-3)
            assert run.frames("BREAKER_STATUS", number=1)[-1].poles == ""
            assert len(run.frames()) == run.result.can_frames
            assert faultloop.open_log(run.log).trips
            with pytest.raises(AttributeError, match="HEARTBEAT has no poles"):
                run.frames("HEARTBEAT")[0].poles

        def test_no_fault(faultloop_bus):
            with faultloop_bus.run("ag-zone1.toml", pace=math.inf, overrides=QUIET) as run:
                pass
            run.no_trip("RA")

        @pytest.mark.faultloop_can("socketcan:nocan7")
        def test_skipped(faultloop_bus):
            raise AssertionError

        def test_skipped_in_it(faultloop_bus):
            faultloop_bus.run("ag-zone1.toml", can="socketcan:nocan7")

        def test_abandoned(faultloop_bus):
            faultloop_bus.run("ag-zone1.toml", pace=0.001)  # 400 s: ended with the test
        """
    )
    done = project.runpytest_subprocess(*QUIET, "-rs")
    done.assert_outcomes(passed=3, skipped=2)
    done.stdout.fnmatch_lines(["*needs socketcan:nocan7: *"])


def test_a_failure_says_what_happened_instead(project: pytest.Pytester, root: Path) -> None:
    text = (root / "docs" / "testing.md").read_text(encoding="utf-8")
    documented = text[text.index("    AssertionError: ") :].split("\n\n")[0].splitlines()
    assert len(documented) == 3
    project.makepyfile(
        test_mine="""
        import math

        def test_zone(faultloop_bus):
            faultloop_bus.run("ag-zone1.toml", pace=math.inf).trip("RA", zone=2)

        def test_none(faultloop_bus):
            faultloop_bus.run("ag-zone1.toml", pace=math.inf).no_trip("RB")

        def test_check(faultloop_bus):
            overrides = ["expect.0.within_ms=1"]
            faultloop_bus.run("ag-zone1.toml", pace=math.inf, overrides=overrides).check()

        def test_name(faultloop_bus):
            faultloop_bus.run("ag-zone1.toml", pace=math.inf).trip("RC")

        def test_message(faultloop_bus):
            faultloop_bus.run("ag-zone1.toml", pace=math.inf).frames("TRIPS")

        def test_file(faultloop_bus):
            faultloop_bus.run("nowhere.toml")

        def test_device(faultloop_bus):
            faultloop_bus.serve(lambda: 1 / 0)
        """
    )
    done = project.runpytest_subprocess(*QUIET)
    done.assert_outcomes(failed=6, passed=1, errors=1)
    done.stdout.fnmatch_lines(
        [
            *[f"*{NUMBER.sub('*', line.strip())}" for line in documented],
            "*faultloop: A-G in zone 1*",
            "*QA open poles ABC received from RA",
        ]
    )
    for words in (
        "*AssertionError: relay RB tripped",
        "*expected otherwise: relay RA: after * ms, not within 1 ms*",
        "*there is no relay 'RC': did you mean*",
        "*no message is called 'TRIPS': did you mean 'TRIP'?",
        "*nowhere.toml: no such scenario in *",
        "*ZeroDivisionError*",
    ):
        done.stdout.fnmatch_lines([words])


def test_the_plugin_costs_nothing_where_it_is_not_used() -> None:
    code = "import sys, faultloop.testing.plugin; print(sorted(m for m in sys.modules if 'faultloop' in m))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "['faultloop', 'faultloop.testing', 'faultloop.testing.plugin']"


def test_a_bus_that_is_no_bus(project: pytest.Pytester) -> None:
    project.makepyfile(test_mine="def test_it(faultloop_bus): pass")
    done = project.runpytest_subprocess(*QUIET, "--faultloop-can", "vcan0")
    done.assert_outcomes(errors=1)
    done.stdout.fnmatch_lines(["*'vcan0' is not INTERFACE:CHANNEL*"])
