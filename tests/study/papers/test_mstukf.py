"""Seed paper 001: its waveforms, what is measured on them, and a small run of the cases."""

from __future__ import annotations

import numpy as np
import pytest

from faultloop.study.papers import mstukf
from faultloop.study.papers.mstukf import cases, readings
from faultloop.study.report import check_table
from faultloop.study.suites import run_suite

pytestmark = pytest.mark.xdist_group("mstukf")  # the report is made once


def test_waveforms_are_the_papers():
    """Eq. 45 to 47, and the peak that section 4.2 computes."""
    sag, impulse, harmonics = (cases.waveform(case) for case in cases.LENGTH)
    assert impulse.max() == pytest.approx(cases.IMPULSE_PEAK, abs=1e-4)
    assert impulse.argmax() + 1 == 771
    cycle = slice(1200 - 1, 1328 - 1)  # one cycle within the sag, and within the harmonics
    spectrum = np.fft.rfft(harmonics[cycle]) / 64
    np.testing.assert_allclose(np.abs(spectrum[[1, 3, 5, 7]]), [1, 0.4, 0.3, 0.2], atol=1e-9)
    inside = np.fft.rfft(sag[cycle])[1] / np.fft.rfft(np.sin(2 * np.pi * np.arange(1200, 1328) / 128))[1]
    assert abs(inside) == pytest.approx(0.5)
    assert np.degrees(np.angle(inside)) == pytest.approx(-30.0)
    for wave, (start, end) in ((sag, cases.SAG), (impulse, cases.IMPULSE), (harmonics, cases.HARMONIC)):
        undisturbed = np.cos if wave is impulse else np.sin
        changed = np.flatnonzero(
            np.abs(wave - undisturbed(2 * np.pi * np.arange(1, len(wave) + 1) / 128)) > 1e-9
        )
        assert (changed[0] + 1, changed[-1] + 1) == (start + 1, end)


def test_the_noise_is_30_db_below_the_fundamental():
    noise = np.array([cases.noisy("sag", seed) - cases.waveform("sag") for seed in range(20)])
    assert 10 * np.log10(0.5 / noise.var()) == pytest.approx(30.0, abs=0.1)
    assert np.abs(np.corrcoef(noise) - np.eye(20)).max() < 0.1


def test_sag_figures_of_a_known_track():
    """A magnitude that crosses 0.9 after 16 samples and stays from sample 44 on; a phase 0.5 degrees off."""
    k = np.arange(1, cases.LENGTH["sag"] + 1)
    found = np.ones((len(k), 7))
    found[700:744, 0] = np.where(np.arange(44) < 16, 1.0, 0.6)
    found[744:1400, 0] = 0.51
    found[1400:1430, 0] = 0.7
    angle = 2 * np.pi * 50 * k / 6400 - np.where((k > 700) & (k <= 1400), np.pi / 6, 0.0)
    found[:, cases.PHASE] = angle + np.radians(0.5)
    found[[400, 401, 500, 700, 1410], cases.FADING] = 2.0
    t1, t2, back1, back2, magnitude, phase, *found_at = cases.measure_sag(found)
    assert (t1, t2, back1, back2) == pytest.approx((16 / 6.4, 44 / 6.4, 30 / 6.4, 30 / 6.4))
    assert magnitude == pytest.approx(0.01 * 500 / 1500)
    assert phase == pytest.approx(0.5)
    assert found_at == [2 * 16.0, 1.0, 0.0, 0.0, 10.0]  # two alarms in 400 samples; the end 10 late


def test_never_is_infinite():
    assert cases.stay_ms(np.array([True, False])) == np.inf
    assert cases.first_ms(np.zeros(3, bool)) == np.inf
    assert cases.stay_ms(np.ones(3, bool)) == 0.0


def test_modified_and_three_transform_filters_agree():
    """MSTUKF differs from STUKF in the share of Q only: 1e-8 of variances of 1e-5."""
    samples = cases.noisy("harmonics", 3)
    one, three = (cases.track(cases.Setting(name, 8.0), samples) for name in ("MSTUKF", "STUKF"))
    assert np.abs(one[1100:1400, :4] - three[1100:1400, :4]).max() < 5e-3


@pytest.fixture(scope="module")
def report():
    return run_suite("seeds", ["mstukf"], quick=True)[0]


def test_ours_is_at_least_as_good_as_published(report):
    checks = [check for check in report.checks if not check.what.startswith("Cost")]
    missed = [check.what for check in checks if not check.held and not check.out_of_reach]
    assert missed == [], check_table(report)
    # Nobody can find this one in that noise without false alarms: the report says why.
    (beyond,) = [check for check in checks if check.out_of_reach]
    assert beyond.what.startswith("End of the sag") and beyond.bound < 10


def test_two_readings_find_the_sag_s_end_at_1401(report):
    """The "- 30" of eq. 45 in radians, and V without memory: lambda is then one in the steady state."""
    table = next(t for t in report.tables if t.title.startswith("The sag by every reading"))
    end, alarms = (table.columns.index(name) for name in (">1401 exact [%]", ">false alarms per s"))
    rows = {(row[0], row[1]): row for row in table.rows}
    for name in ("STF", "MSTUKF"):
        assert float(rows[name, "degrees, 30 dB"][end]) < 50
        assert float(rows[name, "radians, noise of 1e-5"][end]) == 100
        assert float(rows[name, "degrees, no noise, V without memory"][end]) == 100
        assert float(rows[name, "degrees, no noise, V without memory"][alarms]) == 0
        assert rows[name, "radians, 30 dB"][2] == "runs away"
        both = rows[name, "radians, noise of 1e-4, V without memory"]
        assert [float(both[column]) for column in (end - 1, end, alarms)] == [100, 100, 0]
        assert float(both[3]) == pytest.approx(44 / 6.4, abs=1 / 6.4)  # t2 as table 2 has it, but a sample
    assert float(rows["STF", "radians, 30 dB"][end]) >= 80
    assert float(rows["MSTUKF", "radians, noise of 1e-5"][2]) == pytest.approx(2.5, abs=0.01)


def test_the_jumps_at_1401():
    assert readings.jump_at_end(cases.DEGREES) == pytest.approx(0.044, abs=5e-4)
    assert readings.jump_at_end(cases.RADIANS) == pytest.approx(0.776, abs=5e-4)


def test_the_best_test_of_one_sample():
    """Against counting, at one false alarm in a hundred samples."""
    noise = np.random.default_rng(1).normal(size=200_000)
    threshold = np.quantile(noise, 0.99)
    found = 100 * np.mean(noise + 2.0 > threshold)
    assert readings.best_detection(2.0, 1.0, cases.SAMPLING_HZ / 100) == pytest.approx(found, abs=0.5)


def test_eq_43_is_the_phase_and_the_printed_quotient_its_complement():
    k = np.arange(1.0, 500)
    angle = 2 * np.pi * 50 * k / cases.SAMPLING_HZ
    found = np.zeros((len(k), 7))
    found[:, 0], found[:, cases.PHASE] = 0.7, angle + np.radians(25.0)
    phase, printed = cases.phase_dq(found, angle)
    assert np.degrees(phase) == pytest.approx(25.0)
    assert np.degrees(printed) == pytest.approx(65.0)


def test_every_published_figure_stands_beside_ours(report):
    for table, published in (
        ("Sag to", mstukf.SAG_PAPER),
        ("Impulse", mstukf.IMPULSE_PAPER),
        ("Harmonics of", mstukf.HARMONIC_PAPER),
    ):
        rows = next(t.rows for t in report.tables if t.title.startswith(table))
        for row, figures in zip(rows, published, strict=False):
            assert [float(str(cell)) for cell in row[1 : 1 + len(figures)]] == pytest.approx(
                figures, rel=1e-3
            )
        assert len(rows) > 6
    numbered = [title.split(":")[0] for title, _ in report.figures if title.startswith("Figure")]
    assert numbered == [f"Figure {n}" for n in range(1, 6)]


def test_every_published_figure_has_a_status(report):
    """Nine seeds: a median may be a sample off.  That all are reached as written: the full size, below."""
    table = report.tables[0]
    assert table.title.startswith("What was published")
    assert len(table.rows) == 32
    assert {row[-1] for row in table.rows} <= {"reached", "reached by ours only"}


@pytest.mark.slow
def test_every_published_figure_is_reached_as_written():
    full = mstukf.report(quick=False)
    assert {row[-1] for row in full.tables[0].rows} == {"reached"}
    assert full.held


def test_figure_3_has_the_fading_factor_of_its_caption(report):
    title, figure = next(each for each in report.figures if each[0].startswith("Figure 3"))
    assert "fading factors" in title
    assert [panel.text for panel in figure.layout.annotations] == ["signal [pu]", "lambda", "magnitude [pu]"]
