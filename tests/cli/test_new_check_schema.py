"""`new`, `check`, `schema` and `--no-user-code`."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest
from pydantic import TypeAdapter

import faultloop
from faultloop.cli import call
from faultloop.cli.schema import Kind
from faultloop.review.facts import Summary
from faultloop.review.why import CAUSES
from tests.review.review_logs import write_log

ROOT = Path(__file__).resolve().parents[2]
AG = ROOT / "scenarios" / "ag-zone1.toml"
SETTINGS = sorted((ROOT / "scenarios" / "settings").glob("*.toml"))
Capture = pytest.CaptureFixture[str]
ELEMENT = '\n[[element]]\nname = "MINE"\nfunction = "mine.py:step"\n'


def out_of(capsys: Capture, *arguments: object) -> str:
    assert call([str(a) for a in arguments]) == 0
    return capsys.readouterr().out


def refused(capsys: Capture, *arguments: object) -> str:
    assert call([str(a) for a in arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    return err


def test_new_gives_what_can_be_run(capsys: Capture, tmp_path: Path) -> None:
    target = tmp_path / "deep" / "start"
    assert str(target / "scenarios" / "ag-zone1.toml") in out_of(capsys, "new", target)
    made = {path.relative_to(target).as_posix() for path in target.rglob("*.*") if path.is_file()}
    assert {"scenarios/ag-zone1.toml", "scenarios/settings/ab-mho.toml", "examples/my_breaker.py"} <= made
    for path in (target / "scenarios").rglob("*.toml"):
        out_of(capsys, "check", path)  # the settings are found, too


def test_new_has_a_default_place(capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    out_of(capsys, "new")
    assert (tmp_path / "faultloop-start" / "scenarios" / "ag-zone1.toml").is_file()
    assert "not empty" in refused(capsys, "new")
    assert "not empty" in refused(capsys, "new", ".")
    (tmp_path / "empty").mkdir()
    out_of(capsys, "new", "empty")


def test_new_where_nothing_can_be(capsys: Capture, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    assert "is a file" in refused(capsys, "new", tmp_path / "file")
    assert "cannot be written" in refused(capsys, "new", tmp_path / "file" / "x")
    assert "cannot be written" in refused(capsys, "new", "a" * 300)
    refused(capsys, "new", "/")
    assert (tmp_path / "file").read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize("path", sorted((ROOT / "scenarios").glob("*.toml")), ids=lambda path: path.stem)
def test_check_of_a_scenario(capsys: Capture, path: Path) -> None:
    told = json.loads(out_of(capsys, "check", path, "--json"))
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    assert told["kind"] == "scenario"
    assert told["duration_s"] == data["scenario"]["duration_s"]
    assert told["relays"] == [relay["name"] for relay in data["relay"]]
    assert told["samples_per_relay"] == pytest.approx(4800 * told["duration_s"], abs=1)
    assert told["log_mb"] > 0


@pytest.mark.parametrize("path", SETTINGS, ids=lambda path: path.stem)
def test_check_of_settings(capsys: Capture, path: Path) -> None:
    assert json.loads(out_of(capsys, "check", path, "--json"))["kind"] == "relay settings"
    assert "zones: " in out_of(capsys, "check", path)


def test_check_runs_no_code(capsys: Capture, tmp_path: Path) -> None:
    text = SETTINGS[1].read_text(encoding="utf-8")
    (tmp_path / "mine.py").write_text("raise SystemExit('run')", encoding="utf-8")
    (tmp_path / "s.toml").write_text(text + ELEMENT, encoding="utf-8")
    assert json.loads(out_of(capsys, "check", tmp_path / "s.toml", "--json"))["user_code"] == ["mine.py:step"]


def test_check_finds_what_is_wrong(capsys: Capture, tmp_path: Path) -> None:
    (tmp_path / "x.toml").write_text("[other]\n", encoding="utf-8")
    assert "[scenario]" in refused(capsys, "check", tmp_path / "x.toml")
    text = SETTINGS[1].read_text(encoding="utf-8")
    (tmp_path / "s.toml").write_text(text + '\n[estimator]\nmethod = "furier"\n', encoding="utf-8")
    if "[estimator]" not in text:
        told = refused(capsys, "check", tmp_path / "s.toml")
        assert "s.toml: estimator.method: unknown estimator 'furier': did you mean 'fourier'" in told


@pytest.mark.parametrize(
    ("table", "told"),
    [
        ('[estimator]\nmethod = "furier"', "s.toml: estimator.method: unknown estimator 'furier'"),
        ('[rrec]\nstarts = ["PDIS9"]', "s.toml: rrec.starts: there is no function 'PDIS9'"),
        ("", "ag-zone1.toml: expect[0].function: relay 'RA' has no function 'PDIS9'"),
    ],
)
def test_check_of_a_scenario_refuses_what_a_run_does(
    capsys: Capture, tmp_path: Path, table: str, told: str
) -> None:
    function = "PDIS1" if table else "PDIS9"
    settings = (ROOT / "scenarios" / "settings" / "ab-mho.toml").read_text(encoding="utf-8")
    (tmp_path / "s.toml").write_text(f"{settings}\n{table}\n", encoding="utf-8")
    text = AG.read_text(encoding="utf-8").replace("settings/ab-mho.toml", "s.toml")
    path = tmp_path / AG.name
    path.write_text(text.replace('function = "PDIS1"', f'function = "{function}"'), encoding="utf-8")
    assert told in refused(capsys, "check", path)
    assert call(["run", str(path)]) == 2
    assert told in capsys.readouterr().err.splitlines()[-1]  # after one that says what is compiled, maybe


def test_a_line_end_in_a_name_makes_no_second_line(capsys: Capture, tmp_path: Path) -> None:
    path = tmp_path / "s.toml"
    path.write_text(AG.read_text(encoding="utf-8").replace('name = "QA"', 'name = "Q\\nA"'), encoding="utf-8")
    assert r"breaker[Q\nA].name: " in refused(capsys, "check", path)


@pytest.mark.parametrize("path", sorted((ROOT / "campaigns").glob("*.toml")), ids=lambda path: path.stem)
def test_check_of_a_campaign(capsys: Capture, path: Path) -> None:
    told = json.loads(out_of(capsys, "check", path, "--json"))
    assert told["kind"] == "campaign"
    assert told["core_seconds_about"] > 0
    assert told["file_mb_about"] > 0
    # 6 samples, 14 numbers of phasors, 12 of loops, of four bytes each
    kept = told["keep_mb_at_most"]
    assert kept["phasors"] / kept["samples"] == pytest.approx(14 / 6, rel=0.01)
    first = faultloop.Campaign.load(path).case(0).scenario
    numbers = told["cases"] * 4800 * first.scenario.duration_s * len(told["relays"]) * 6
    assert kept["samples"] == pytest.approx(4 * numbers / 1e6, rel=0.01)
    assert "keep mb at most: samples " in out_of(capsys, "check", path)


@pytest.mark.parametrize("kind", ["scenario", "relay", "campaign"])
def test_schema(capsys: Capture, kind: str) -> None:
    schema = json.loads(out_of(capsys, "schema", kind))
    assert schema["$schema"].endswith("2020-12/schema")
    assert schema["additionalProperties"] is False
    assert kind in schema["properties"]
    campaigns = sorted((ROOT / "campaigns").glob("*.toml"))
    for path in {"scenario": [AG], "relay": SETTINGS, "campaign": campaigns}[kind]:
        assert set(tomllib.loads(path.read_text(encoding="utf-8"))) <= set(schema["properties"])


def test_user_code_can_be_refused(capsys: Capture, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("raise SystemExit('run')", encoding="utf-8")
    text = (ROOT / "scenarios" / "settings" / "ab-mho.toml").read_text(encoding="utf-8")
    own = tmp_path / "s.toml"
    own.write_text(text + ELEMENT, encoding="utf-8")
    override = f"relay.RA.settings={own}"
    log = tmp_path / "x.mcap"
    err = refused(capsys, "run", AG, "--log", log, "--set", override, "--no-user-code")
    assert f"{own}: element[MINE].function" in err
    assert "mine.py:step" in err
    err = refused(capsys, "replay", "no.cfg", "--settings", own, "--log", log, "--no-user-code")
    assert "element[MINE].function" in err
    with pytest.raises(faultloop.InputError, match=r"element\[MINE\]"):
        faultloop.run(AG, overrides=[override], user_code=False)
    assert not log.exists()


def test_an_estimator_that_is_code_is_refused_too(tmp_path: Path) -> None:
    from faultloop.relay.named_code import named_code, refuse_user_code

    data = tomllib.loads((ROOT / "scenarios" / "settings" / "ab-mho.toml").read_text(encoding="utf-8"))
    for method in ("my.py:make", "package.module:make"):
        settings = faultloop.RelaySettings.from_dict(data | {"estimator": {"method": method}})
        assert list(named_code(settings)) == [("estimator.method", method)]
        with pytest.raises(faultloop.InputError):
            refuse_user_code(settings)
    refuse_user_code(faultloop.RelaySettings.from_dict(data))


@pytest.mark.parametrize("kind", ["review", "why"])
def test_schema_of_what_a_command_prints(capsys: Capture, kind: str, tmp_path: Path) -> None:
    """Every key that `review --json` prints is in it; those of `why` are held by its own test."""
    schema = json.loads(out_of(capsys, "schema", kind))
    if kind == "why":
        causes = schema["$defs"]["Reason"]["properties"]["cause"]["enum"]
        assert causes == list(CAUSES)
        return
    printed = json.loads(out_of(capsys, "review", write_log(tmp_path / "known.mcap"), "--json"))
    assert set(printed) == set(schema["properties"])
    TypeAdapter(Summary).validate_json(json.dumps(printed))
    relay = schema["$defs"]["RelayFacts"]["properties"]
    assert set(printed["relays"]["R1"]) == set(relay)


@pytest.mark.parametrize("kind", list(Kind))
def test_every_key_in_a_schema_says_what_it_is(capsys: Capture, kind: str) -> None:
    """And numbers with a unit in their names have it beside them."""
    schema = json.loads(out_of(capsys, "schema", kind))
    for name, model in {"the whole": schema, **schema.get("$defs", {})}.items():
        for key, field in model.get("properties", {}).items():
            assert field.get("description", "").strip(" `[]"), (name, key)
            if kind in ("scenario", "relay", "campaign"):
                assert "default" in field or key in model.get("required", ()) or key == "factor", (name, key)
                assert not key.endswith(("_ms", "_ohm", "_hz", "_pu", "_deg", "_km")) or field["unit"], key
