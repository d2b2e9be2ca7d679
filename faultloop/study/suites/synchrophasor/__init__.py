"""Class tests of IEC/IEEE 60255-118-1 over the estimators, reports at f0: `docs/synchrophasor.md`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from faultloop.relay.estimators import estimator_methods
from faultloop.study.report import Check, Report, Table, cell
from faultloop.study.suites.synchrophasor.classes import CLASSES, Outcome, PerformanceClass, class_tests
from faultloop.study.suites.synchrophasor.figures import figures
from faultloop.study.suites.synchrophasor.measure import SAMPLING_HZ, Subject, subject

PARTS = {"p-50": ("p", 50.0), "p-60": ("p", 60.0), "m-50": ("m", 50.0), "m-60": ("m", 60.0)}

# The estimators that must hold every limit of a class.  Those that report frequency come along, and for
# comparison one that has a relay's.
REQUIRED = {"p": "p-class", "m": "m-class"}
COMPARISON = "fourier"
DRAWN = ("p-class", "m-class", "taylor-kalman", COMPARISON)


def run(parts: Sequence[str], *, quick: bool, progress: Callable[[float], Any]) -> list[Report]:
    """One report for each class and nominal frequency."""
    reports = []
    for place, part in enumerate(parts):
        kind, frequency_hz = PARTS[part]
        reports.append(
            report(
                part, CLASSES[kind], frequency_hz, quick, lambda p, k=place: progress((k + p) / len(parts))
            )
        )
    return reports


def subjects(required: str, frequency_hz: float, quick: bool) -> list[Subject]:
    """The required estimator, then every other that reports frequency, then the comparison."""
    others = DRAWN if quick else estimator_methods()
    tested = [subject(method, frequency_hz) for method in others if method not in (required, COMPARISON)]
    own = [s for s in tested if s.own_frequency]
    return [subject(required, frequency_hz), *own, subject(COMPARISON, frequency_hz)]


def report(
    name: str, kind: PerformanceClass, frequency_hz: float, quick: bool, progress: Callable[[float], Any]
) -> Report:
    """A class at a nominal frequency: checks for the estimator that must hold them, a table for all."""
    required = REQUIRED[kind.name.lower()]
    tested = subjects(required, frequency_hz, quick)
    results: list[list[Outcome]] = []
    for place, one in enumerate(tested):
        # The sigma-point filters cost a hundred times the class filters: on the full grids an hour's quarter.
        results.append(class_tests(one, kind, quick or one.name not in DRAWN))
        progress((place + 1) / len(tested))
    done = Report(name, f"IEC/IEEE 60255-118-1 class {kind.name}, {frequency_hz:g} Hz")
    done.text.append(
        f"{frequency_hz:g} reports per second, {SAMPLING_HZ} samples per second, no noise. {required} must "
        "hold every limit; the others are shown beside it. Every sample's estimate is judged, not only the "
        "reports."
    )
    sparse = "the ends and the middle of each range, one polarity and one point on the wave."
    done.text.append(f"Quick: {sparse}" if quick else f"All but {', '.join(DRAWN)}: {sparse}")
    done.checks = [Check(f"{required}: {o.row}: {o.quantity}", o.value, o.limit, o.unit) for o in results[0]]
    done.tables = [all_rows(tested, results), delays(tested, kind)]
    done.figures = figures(tested[:1] if quick else [one for one in tested if one.name in DRAWN], kind)
    return done


def all_rows(tested: Sequence[Subject], results: Sequence[Sequence[Outcome]]) -> Table:
    """One line a row, one column an estimator; what misses its limit is marked."""
    rows = []
    for outcomes in zip(*results, strict=True):
        first = outcomes[0]
        shown = [cell(o.value) + ("" if o.value <= o.limit else " !") for o in outcomes]
        rows.append((first.row, first.quantity, cell(first.limit), *shown, first.unit))
    missed = [str(sum(not o.value <= o.limit for o in outcomes)) for outcomes in results]
    rows.append(("limits missed", "", str(len(results[0])), *missed, ""))
    names = [f">{s.name}" + ("" if s.own_frequency else " *") for s in tested]
    note = (
        "! beyond the limit. * frequency and ROCOF as a relay takes them from the positive sequence. Without "
        "noise a recursive filter settles a step within a few samples; with noise it takes longer."
    )
    return Table("Every estimator that reports frequency", ("row", "", ">limit", *names, "unit"), rows, note)


def delays(tested: Sequence[Subject], kind: PerformanceClass) -> Table:
    """How old a time stamp is when its row is known."""
    rows = [(s.name, 1000.0 * s.delay_s, s.estimator.settling_samples) for s in tested]
    allowed = 1000.0 * kind.latency_reports / tested[0].frequency_hz
    note = (
        "From the time stamp to the sample that ends the estimate. The 2014 amendment of C37.118.1 allows "
        f"{kind.latency_reports} reports, {allowed:.4g} ms, to the message itself. An estimator without a "
        "delay stamps the newest sample."
    )
    return Table("Latency", ("estimator", ">latency [ms]", ">settling [samples]"), rows, note)
