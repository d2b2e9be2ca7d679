"""Scenario files: what is accepted, and what the one line says where it is not."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import pytest

from faultloop.config.override import PLACE_TABLES, apply_override
from faultloop.config.place import RelayPlace
from faultloop.errors import InputError
from faultloop.loop.scenario import Scenario, load_scenario
from tests.examples import scenario


def test_ready_scenarios_are_valid(root: Path) -> None:
    files = sorted((root / "scenarios").glob("*.toml"))
    assert len(files) >= 8
    for file in files:
        loaded = load_scenario(file)
        assert loaded.text.startswith("#"), "each is commented"
        for relay in loaded.relay:
            assert loaded.settings_path(relay).is_file()


def test_defaults_and_units() -> None:
    s = Scenario.from_dict(scenario())
    assert s.scenario.start_ns == 1_577_836_800_000_000_000  # 2020-01-01T00:00:00Z
    assert s.fault[0].name == "F1"
    assert s.line[0].z1_ohm == pytest.approx(6 + 40j)
    assert s.can.interface == "virtual"
    assert s.system.sampling_hz == 4800


@pytest.mark.parametrize(
    ("change", "key", "words"),
    [
        (lambda d: d["line"][0].update(length_km="100"), "line[AB].length_km", "valid number"),
        (lambda d: d["line"][0].update(length_km=-3), "line[AB].length_km", "greater than 0"),
        (lambda d: d["line"][0].update(length_km=True), "line[AB].length_km", "valid number"),
        (lambda d: d["line"][0].update(lenght_km=3), "line[AB].lenght_km", "did you mean 'length_km'"),
        (lambda d: d["line"][0].pop("length_km"), "line[AB].length_km", "missing"),
        (lambda d: d["line"][0].update(to="A"), "line[AB]", "same bus"),
        (lambda d: d["line"][0].update(b1_us_per_km=0), "line[AB]", "bergeron"),
        (lambda d: d["fault"][0].update(type="AGX"), "fault[F1].type", "'AG', 'BG'"),
        (lambda d: d["fault"][0].update(at_pu=float("nan")), "fault[F1].at_pu", "finite"),
        (lambda d: d["fault"][0].update(line="AC"), "fault[F1].line", "did you mean 'AB'"),
        (lambda d: d["fault"][0].update(at_km=3), "fault[F1]", "either at_km or at_pu"),
        (lambda d: d["fault"][0].update(start_s=2), "fault[F1].start_s", "end of the run"),
        (lambda d: d.update(fault=[{"bus": "Q", "type": "AG", "start_s": 0}]), "fault[F1].bus", "no bus"),
        (lambda d: d["system"].update(frequency_hz=55), "system.frequency_hz", "50 or 60"),
        (lambda d: d["source"][0].update(z1_ohm=[1]), "source[SA].z1_ohm", "needs 2 numbers"),
        (lambda d: d["source"][0].update(z1_ohm=[0, 0]), "source[SA]", "not both zero"),
        (lambda d: d["source"][0].update(sir=3), "source[SA]", "either z1_ohm"),
        (lambda d: d["source"][0].update(bus="C"), "source[SA].bus", "no line at bus"),
        (lambda d: d["relay"][0].update(line="L9"), "relay[RA].line", "no line 'L9'"),
        (lambda d: d["relay"][0].update(breaker="Q9"), "relay[RA].breaker", "no breaker 'Q9'"),
        (lambda d: d["breaker"][1].update(end="from"), "breaker[QB].end", "already"),
        (lambda d: d["relay"][1].update(name="RA"), "relay[RA].name", "two of them"),
        (lambda d: d.update(relais=[]), "relais", "did you mean 'relay'"),
        (lambda d: d.update(relay={"name": "R"}), "relay", "[[relay]]"),
        (lambda d: d.update(expect=[{"relay": "RX", "trip": True}]), "expect[0].relay", "no relay"),
        (lambda d: d.update(expect=[{"relay": "RA", "trip": False, "zone": 1}]), "expect[0]", "trip = false"),
    ],
)  # fmt: skip
def test_wrong_scenarios(change: Callable[[dict[str, Any]], Any], key: str, words: str) -> None:
    data = scenario()
    change(data)
    with pytest.raises(InputError) as caught:
        Scenario.from_dict(data, path=Path("s.toml"))
    text = str(caught.value)
    assert text.startswith(f"s.toml: {key}: ")
    assert words in text
    assert "\n" not in text


@pytest.mark.parametrize(
    ("text", "words"),
    [("a = [", "not valid TOML"), (None, "no such file"), (b"\xff\xfe", "not UTF-8")],
)
def test_unreadable_files(tmp_path: Path, text: str | bytes | None, words: str) -> None:
    file = tmp_path / "s.toml"
    if isinstance(text, bytes):
        file.write_bytes(text)
    elif text is not None:
        file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=words):
        load_scenario(file)


def test_overrides() -> None:
    data = scenario()
    for item in ("fault.0.type=BC", "line.AB.length_km=50", "scenario.duration_s=.5", "can.fd=true"):
        apply_override(data, item)
    assert data["fault"][0]["type"] == "BC"
    assert data["line"][0]["length_km"] == 50
    assert data["scenario"]["duration_s"] == 0.5
    assert data["can"] == {"fd": True}


@pytest.mark.parametrize(
    "item", ["x", "x=1", "fault.F9.type=BC", "fault.type=BC", "scenario.name.x=1", ".=1"]
)
def test_wrong_overrides(item: str) -> None:
    with pytest.raises(InputError, match="--set"):
        apply_override(scenario(), item)


def test_every_key_is_documented(root: Path) -> None:
    text = (root / "docs" / "scenario.md").read_text(encoding="utf-8")
    for name, field in Scenario.model_fields.items():
        assert f"[{name}]" in text
        table = next(
            (a for a in (*get_args(field.annotation), field.annotation) if hasattr(a, "model_fields")), None
        )
        assert table is not None
        for key, inner in table.model_fields.items():
            assert f"`{inner.alias or key}`" in text, f"{name}.{key}"


def test_tables_of_a_relays_place_are_no_settings() -> None:
    """`relay.RA.front_end.adc_bits` is a key of the scenario; what is one is listed once."""
    tables = {name for name, field in RelayPlace.model_fields.items() if "FrontEnd" in str(field.annotation)}
    assert tables == set(PLACE_TABLES)
