"""Records as they come: played where they can be, refused where not, and told what to doubt."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import faultloop
from faultloop.errors import InputError
from faultloop.io.comtrade import AnalogChannel, Rate, Record, write_comtrade
from faultloop.io.comtrade.record import StatusChannel, times_of
from faultloop.loop.replay import ReplayResult, replay
from faultloop.relay import RelaySettings, load_settings
from tests.measured import Measured
from tests.relay.test_not_ready import ALLOWED

MHO = Path(__file__).resolve().parents[2] / "scenarios" / "settings" / "ab-mho.toml"
NAMES = ("VA", "VB", "VC", "IA", "IB", "IC")
READ = ("cff-bom", "empty-min-max", "infinite-value", "negative-stamps", "nul-padding", "stop-zero",
        "time-base-7digits", "time-base-dots", "time-not-understood", "units-amps")  # fmt: skip


@pytest.fixture(scope="module")
def settings() -> RelaySettings:
    return load_settings(MHO)


def case(shared: Path, name: str) -> Path:
    return next(p for p in (shared / "cases" / name).iterdir() if p.suffix in (".cfg", ".cff"))


@pytest.mark.parametrize("name", READ)
def test_cases_that_are_played(shared: Path, settings: RelaySettings, name: str) -> None:
    """All are the same A-G fault."""
    result = replay(case(shared, f"comtrade-{name}"), settings)
    assert [(t.function, t.loop) for t in result.trips] == [("PDIS1", "AG")]
    assert result.trips[0].t_ns == pytest.approx(0.2075e9, abs=2e6)
    assert result.duration_ns == pytest.approx(0.5e9, rel=1e-3)
    assert not result.warnings


def test_red_yellow_blue(shared: Path, settings: RelaySettings) -> None:
    result = replay(case(shared, "comtrade-ryb-phases"), settings)
    assert [t.loop for t in result.trips] == ["BG"]
    assert "channels: va = VR, vb = VY, vc = VB, ia = IR, ib = IY, ic = IB" in result.notes


def test_line_voltages_are_not_taken(shared: Path, settings: RelaySettings) -> None:
    result = replay(case(shared, "comtrade-line-voltages"), settings)
    assert not result.trips
    assert result.warnings == ("no phase voltages ('UAB', 'UBC', 'UCA': between two phases, by its name)",)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("binary32-called-binary", "rows of 34 bytes do"),
        ("status-word-0D", "rows of 22 bytes do"),
        ("shorter-than-a-sample", r"r\.cfg: lasts 0\.13 ms, less than two samples of a relay at 4800 Hz"),
    ],
)
def test_cases_that_are_refused(shared: Path, settings: RelaySettings, name: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        replay(case(shared, f"comtrade-{name}"), settings)


# -- stretches too slow for a relay -----------------------------------------------------------------------


@pytest.mark.parametrize("method", ALLOWED)
@pytest.mark.parametrize("name", ["d50", "d200"])
def test_a_decimated_stretch_is_blank(
    shared: Path, tmp_path: Path, name: str, method: str, measured: Measured
) -> None:
    folder = shared / "cases" / "record-decimated"
    given = load_settings(folder / "relay.toml")
    own = given.model_copy(update={"estimator": given.estimator.model_copy(update={"method": method})})
    log = tmp_path / "log.mcap"
    result = replay(folder / f"{name}.cfg", own, log=log)
    assert [(t.zone, t.loop) for t in result.trips] == [(1, "AG")]
    assert (
        1.338e9 < result.trips[0].t_ns < 1.338e9 + (40e6 if method == "cosine" else 30e6)
    )  # its window is longer
    measured(f"trip of {method} after the fault", result.trips[0].t_ns / 1e6 - 1338, "ms")
    assert not [t for t in result.first_operate_ns.values() if t < 1.338e9]
    assert result.fault_location == pytest.approx(0.6, abs=0.01)
    (told,) = result.warnings
    assert told.startswith("blank from 0.399687 to 1.12 s: ") and f"{name[1:]} samples/s" in told
    assert (faultloop.open_log(log).start_ns - 1_577_836_800 * 10**9) == 0  # 1970 is no time of a record
    rows = faultloop.open_log(log).samples("replay")
    (gap,) = np.flatnonzero(np.diff(rows["t_ns"]) > 1e6).tolist()
    assert rows["t_ns"][gap] < 0.4e9 and 1.12e9 <= rows["t_ns"][gap + 1] < 1.1205e9
    assert (np.diff(rows["sample_count"])[[gap - 1, gap + 1]] == 1).all()
    assert (rows["t_ns"] == rows["sample_count"].astype(np.int64) * 10**9 // 4800).all()
    steady = faultloop.open_log(log).phasors("replay")
    angle = np.angle(steady["va_re"] + 1j * steady["va_im"])  # one reference before the gap and after it
    for t_s in (0.39, 1.2, 1.33):
        k = np.searchsorted(steady["t_ns"], t_s * 1e9)
        assert abs(np.angle(np.exp(1j * (angle[k] - angle[1500])))) < 0.02


def record_of(samples: int = 4800, hz: float = 4800.0, **more: object) -> Record:
    """Healthy 220 kV at 50 Hz, 400 A."""
    rates = (Rate(hz, samples),)
    t_ns = times_of(rates, np.arange(samples))
    lag = np.radians([0, 120, 240, 20, 140, 260])
    peak = np.array([220e3 * np.sqrt(2 / 3)] * 3 + [400 * np.sqrt(2)] * 3)
    f0 = float(more.pop("f0", 50.0))  # type: ignore[arg-type]
    values = peak * np.cos(2 * np.pi * f0 * t_ns[:, None] / 1e9 - lag)
    units = ("V",) * 3 + ("A",) * 3
    analog = [AnalogChannel(n, values[:, i], units[i], **more) for i, n in enumerate(NAMES)]  # type: ignore[arg-type]
    return Record(t_ns, analog, rates=rates, frequency_hz=50.0, start_ns=1_700_000_000 * 10**9)


def played(tmp_path: Path, record: Record, settings: RelaySettings, **more: object) -> ReplayResult:
    write_comtrade(tmp_path / "x.cfg", record, "2013", "FLOAT32")
    return replay(tmp_path / "x.cfg", settings, **more)  # type: ignore[arg-type]


def test_samples_left_out_and_long_gaps_are_blank(tmp_path: Path, settings: RelaySettings) -> None:
    """A gap is a gap, whoever made it: rows left out by their stamps, or a channel's values missing."""
    record = record_of()
    keep = np.ones(4800, bool)
    keep[1000:1100] = False
    record.t_ns, record.rates = record.t_ns[keep], ()
    for channel in record.analog:
        channel.values = channel.values[keep]
    record.analog[2].values[3000:3100] = np.nan
    record.analog[2].values[4000:4003] = np.nan
    result = played(tmp_path, record, settings)
    assert not result.trips
    assert len(result.warnings) == 2
    assert all("blank from" in warning for warning in result.warnings)
    counts = result.samples()["sample_count"].astype(int)
    gaps = np.flatnonzero(np.diff(counts) > 1)
    assert len(gaps) == 2 and abs(len(counts) - 4600) < 10
    assert np.isfinite(result.samples()["vc"]).all()


def test_a_record_that_is_too_slow_throughout(tmp_path: Path, settings: RelaySettings) -> None:
    with pytest.raises(InputError, match=r"200 samples/s.*a relay needs 400"):
        played(tmp_path, record_of(1200, 200.0), settings)
    with pytest.raises(InputError, match="a relay needs 400"):
        played(tmp_path, record_of(1200, 1e-3), settings)


@pytest.mark.parametrize("hz", [400.0, 1e6, 1e7])
def test_rates_at_the_ends_of_what_is_played(tmp_path: Path, settings: RelaySettings, hz: float) -> None:
    result = played(tmp_path, record_of(int(hz / 20), hz), settings)
    assert not result.trips
    assert len(result.samples()) == pytest.approx(240, abs=15)


# -- a part of a record -----------------------------------------------------------------------------------


def test_a_window(shared: Path, settings: RelaySettings) -> None:
    record = case(shared, "comtrade-stop-zero")
    whole, part = replay(record, settings), replay(record, settings, from_s=0.1, to_s=0.25)
    assert part.trips[0].t_ns == pytest.approx(whole.trips[0].t_ns, abs=1e6)
    rows, all_rows = part.samples(), whole.samples()
    assert rows["t_ns"][0] == 100_000_000 and len(rows) == 720
    assert rows["sample_count"][0] == 480
    np.testing.assert_allclose(rows["va"], all_rows["va"][480:1200], atol=1.0)
    ours, theirs = part.phasors()[400:480], whole.phasors()[880:960]  # settled, before the fault
    for name in ("va_re", "va_im", "ib_re", "ib_im"):
        np.testing.assert_allclose(ours[name], theirs[name], atol=1e-3 * np.abs(theirs["va_re"]).max())
    assert not replay(record, settings, to_s=0.2).trips
    for wrong in ({"from_s": 9.0}, {"from_s": 0.2, "to_s": 0.1}, {"from_s": -1.0}, {"from_s": np.nan}):
        with pytest.raises(InputError, match="--from, --to"):
            replay(record, settings, **wrong)


def test_a_window_that_begins_within_a_cycle_keeps_the_reference(
    tmp_path: Path, settings: RelaySettings
) -> None:
    result = played(tmp_path, record_of(), settings, from_s=0.103)
    row = result.phasors()[600]
    angle = np.degrees(np.angle(row["va_re"] + 1j * row["va_im"]))
    assert abs(angle) < 0.2  # VA is a cosine from the record's first sample


# -- what cannot be ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("stated", [50.0, 60.0, 0.0])
def test_another_line_frequency_is_refused(tmp_path: Path, settings: RelaySettings, stated: float) -> None:
    record = record_of(f0=60.0)
    record.frequency_hz = stated
    said = f"its .cfg says {stated:g} Hz" if stated else "its .cfg says nothing of it"
    with pytest.raises(InputError, match=rf"relay.frequency_hz: is 50, .* have 60\.. Hz \({said}\)"):
        played(tmp_path, record, settings)


@pytest.mark.parametrize("f0", [47.0, 50.0, 52.5])
def test_a_frequency_off_the_nominal_is_played(tmp_path: Path, settings: RelaySettings, f0: float) -> None:
    record = record_of(f0=f0)
    record.frequency_hz = 60.0  # wrong: the signals decide
    result = played(tmp_path, record, settings)
    assert any(note.startswith("the record says 60 Hz, its signals have") for note in result.notes)


def test_a_frequency_that_cannot_be_measured_is_told(tmp_path: Path, settings: RelaySettings) -> None:
    record = record_of(200)  # two cycles
    record.frequency_hz = 60.0
    (warning,) = played(tmp_path, record, settings).warnings
    assert "its .cfg says 60 Hz, the relay is one of 50 Hz" in warning


@pytest.mark.parametrize(
    ("factor", "more", "words"),
    [
        (1 / 1100, {}, "115.5 V RMS .* 1.27e.05 V: they look secondary, or are in kV; give --vt-ratio"),
        (1e-3, {}, "the voltages have 127 V RMS as primary"),
        (1e3, {}, "the voltages have 1.27e.08 V RMS as primary .*: too much"),
        (1.0, {"scale": "S", "ratio": (1100.0, 1.0)}, "declared secondary and have 1.27e.05 V RMS"),
        (1.0, {}, None),
        (1 / 1100, {"scale": "S", "ratio": (1100.0, 1.0)}, None),
    ],
)  # fmt: skip
def test_voltages_that_cannot_be(
    tmp_path: Path, settings: RelaySettings, factor: float, more: dict[str, object], words: str | None
) -> None:
    record = record_of(960)
    for channel in record.analog[:3]:
        channel.values = channel.values * factor
        for key, value in more.items():
            setattr(channel, key, value)
    warnings = " ".join(played(tmp_path, record, settings).warnings)
    if words is None:
        assert not warnings
    else:
        assert re.search(words, warnings), warnings


def test_what_is_overruled_is_not_doubted(tmp_path: Path, settings: RelaySettings) -> None:
    record = record_of(960)
    for channel in record.analog[:3]:
        channel.values = channel.values / 1100
    whole = played(tmp_path, record, settings, vt_ratio=1100.0)
    assert not whole.warnings
    assert np.abs(whole.samples()["va"]).max() == pytest.approx(220e3 * np.sqrt(2 / 3), rel=1e-3)
    scaled = replay(tmp_path / "x.cfg", settings, scale={"va": 1100.0, "vb": 1100.0, "vc": 1100.0})
    np.testing.assert_array_equal(scaled.samples()["va"], whole.samples()["va"])
    units = replay(tmp_path / "x.cfg", settings, unit={"va": "kV", "vb": "kV", "vc": "kV"})
    np.testing.assert_allclose(units.samples()["va"], whole.samples()["va"] / 1.1, rtol=1e-12)
    for wrong in ({"vt_ratio": 0.0}, {"ct_ratio": -1.0}, {"vt_ratio": np.inf}, {"scale": {"va": np.nan}}):
        with pytest.raises(InputError, match=r"--vt-ratio|--ct-ratio|--scale"):
            replay(tmp_path / "x.cfg", settings, **wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        ("va=VB,vb=VA", ["voltages"]),
        ("ia=IC,ic=IA", ["currents"]),
        ("vb=VC,vc=VB,ib=IC,ic=IB", ["voltages", "currents"]),
        ("va=VB,vb=VC,vc=VA", []),  # turned on, not swapped: nothing tells
    ],
)
def test_swapped_phases_are_told(
    tmp_path: Path, settings: RelaySettings, mapping: str, words: list[str]
) -> None:
    warnings = played(tmp_path, record_of(960), settings, mapping=mapping).warnings
    assert [warning.split()[1] for warning in warnings] == words
    assert all("turn A-C-B" in warning for warning in warnings)


def test_one_of_three_phases_that_is_not_found_is_asked_for(tmp_path: Path, settings: RelaySettings) -> None:
    record = record_of(960)
    record.analog[2].name = "third"
    with pytest.raises(
        InputError, match=r"vc not found .* it has no phase.*map it, or say that there is none"
    ):
        played(tmp_path, record, settings)
    assert replay(tmp_path / "x.cfg", settings, mapping="vc=2").samples()["vc"].any()
    assert np.isnan(replay(tmp_path / "x.cfg", settings, mapping="vc=-").samples()["vc"]).all()


# -- digital channels -------------------------------------------------------------------------------------


def with_digital(record: Record, **channels: tuple[float, float]) -> Record:
    """Digital channels that are on between two times [s]."""
    t_s = record.t_ns / 1e9
    record.status = [StatusChannel(name, (t_s >= a) & (t_s < b)) for name, (a, b) in channels.items()]
    return record


def test_digital_channels_are_in_the_log(tmp_path: Path, settings: RelaySettings) -> None:
    record = with_digital(record_of(), trip=(0.25, 0.5), alarm=(0.0, 9.0), never=(8.0, 9.0))
    played(tmp_path, record, settings, log=tmp_path / "l.mcap")
    log = faultloop.open_log(tmp_path / "l.mcap")
    assert [(e.t_ns, e.name, e.on) for e in log.digital] == [
        (0, "trip", False), (0, "alarm", True), (0, "never", False),
        (250_000_000, "trip", True), (500_000_000, "trip", False),
    ]  # fmt: skip
    part = played(tmp_path, record, settings, log=tmp_path / "m.mcap", from_s=0.3, to_s=0.6)
    assert [(e.t_ns, e.name, e.on) for e in faultloop.open_log(tmp_path / "m.mcap").digital] == [
        (300_000_000, "trip", True), (300_000_000, "alarm", True), (300_000_000, "never", False),
        (500_000_000, "trip", False),
    ]  # fmt: skip
    assert part.duration_ns == 300_000_000


@pytest.mark.parametrize(
    ("mapping", "states"),
    [
        ("52a=a", [(0, 0b111), (400_000_000, 0)]),
        ("52b=b", [(0, 0b111), (410_000_000, 0)]),
        ("52a=a,52b=b", [(0, 0b111), (410_000_000, 0)]),  # on its way in between: it stays
        ("52a_b=a", [(0, 0b111), (400_000_000, 0b101)]),
        ("52a=0,52b_c=b", [(0, 0b111), (400_000_000, 0b100), (410_000_000, 0)]),
    ],
)
def test_contacts_are_the_breakers_position(
    tmp_path: Path, settings: RelaySettings, mapping: str, states: list[tuple[int, int]], monkeypatch
) -> None:
    seen: list[tuple[int, int]] = []
    original = faultloop.relay.Relay.advance

    def advance(self, samples: np.ndarray) -> int:
        seen.append((self.sample_count, self.inputs.breaker_closed))
        return original(self, samples)

    monkeypatch.setattr(faultloop.relay.Relay, "advance", advance)
    record = with_digital(record_of(), a=(-1.0, 0.4), b=(0.41, 9.0))
    played(tmp_path, record, settings, mapping=mapping, log=tmp_path / "l.mcap")
    poles = [
        (e.t_ns, e.pole_a | e.pole_b << 1 | e.pole_c << 2)
        for e in faultloop.open_log(tmp_path / "l.mcap").breaker_states
    ]
    assert poles == states
    for count, closed in seen:
        t_ns = count * 10**9 // 4800
        assert closed == [mask for since, mask in states if since <= t_ns][-1]
    assert {closed for _, closed in seen} == {mask for _, mask in states}
