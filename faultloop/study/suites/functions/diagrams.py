"""What the suite of functions draws: curves, discs, the reach on parallel lines, breaker failure."""

from __future__ import annotations

import math

import numpy as np

from faultloop.relay.functions.ptoc import PTOC
from faultloop.study.diagram import Curve, Diagram, Limit
from faultloop.study.suites.functions import parallel_lines, relay_checks
from faultloop.study.suites.functions.cases import cases_of
from faultloop.study.suites.functions.kernel import Kernel


def curves(quick: bool) -> list[Diagram]:
    """Every curve by its kernel's function with the published times, its way back, and discs under currents
    that change."""
    given = list(cases_of("curves"))
    forwards, backwards, discs = [], [], []
    multiples, parts = np.geomspace(1.1, 20, 60), np.linspace(0, 0.95, 40)
    for number, case in enumerate(case for case in given if case.check == "curve"):
        name = case.input["curve"]
        operates, resets = relay_checks.equation(name)
        forwards.append(Curve(name, multiples, [operates(m) for m in multiples], "smooth", number))
        points = case.expected["times_s"]
        own = {"colour": number, "in_legend": False, "group": name}
        forwards.append(Curve(f"{name}: published", relay_checks.MULTIPLES, points, "points", **own))
        if "resets_s" in case.expected:
            backwards.append(Curve(name, parts, [resets(m) for m in parts], "smooth", number))
            points = case.expected["resets_s"]
            backwards.append(Curve(f"{name}: published", relay_checks.PARTS, points, "points", **own))
    for number, case in enumerate(case for case in given if case.check == "disc"):
        t, progress = disc(case.input)
        discs.append(Curve(case.name, t, progress, "smooth", number))
        at = case.expected["operates_s"]
        discs.append(Curve(f"{case.name}: by hand", [at], [1.0], "points", number, in_legend=False))
    pickup = "current over the pickup"
    return [
        Diagram(
            "Operating time, time multiplier 1", pickup, "s", forwards, log_x=True, log_y=True,
            x_ticks=(1.1, 2, 5, 10, 20), y_range=(0.03, 300), note="Points: published times.",
        ),
        Diagram(
            "The disc's way back, time multiplier 1", pickup, "s", backwards, log_y=True,
            note="Points: published times.",
        ),
        Diagram(
            "The disc's way under a current that changes", "s", "part of the whole way", discs,
            [Limit("operates", 1.0)], wide=True, note="Points: by hand, from the integral.",
        ),
    ]  # fmt: skip


def disc(given: dict) -> tuple[np.ndarray, np.ndarray]:
    """Times and the kernel's progress."""
    table = {"pickup_a": relay_checks.AMPERES, "reset": "disc"}
    k = Kernel(PTOC, table | {key: given[key] for key in ("curve", "time_multiplier")})
    progress: list[float] = []
    for multiple, seconds in [*given["steps"], [given["last"], 2.0]]:
        for n in range(round(seconds * relay_checks.SAMPLING)):
            k.step(relay_checks.currents(multiple) if n == 0 else None)
            progress.append(float(np.max(k.w["progress"])))
            if k.w["operated"].any():
                break
    return np.arange(len(progress)) / relay_checks.SAMPLING, np.minimum(progress, 1.0)


def parallel_lines_reach(quick: bool) -> Diagram:
    """How far zone 1 operates: by the relay, and by the closed form."""
    names, by_relay, by_form = [], {False: [], True: []}, {False: [], True: []}
    for name, (fed, earthed) in parallel_lines.CASES.items():
        names.append(name)
        for compensated in (False, True):
            by_relay[compensated].append(
                100 * parallel_lines.reach(fed, earthed, compensated, 4 if quick else 7)
            )
            by_form[compensated].append(100 * parallel_lines.expected_reach(fed, earthed, compensated))
    x = list(range(len(names)))
    lines = []
    for colour, compensated in enumerate((False, True)):
        said = "compensated" if compensated else "not compensated"
        beside = [place + 0.08 * (2 * colour - 1) for place in x]
        lines.append(Curve(f"{said}: relay", beside, by_relay[compensated], "points", colour))
        lines.append(Curve(f"{said}: closed form", beside, by_form[compensated], "points", colour + 2))
    return Diagram(
        "How far zone 1 of 80 % operates", "parallel line, far source", "% of the line", lines,
        [Limit("the setting", 80.0)], x_ticks=x, x_names=names, y_range=(60, 105), wide=True,
        note="100 %: beyond the line. The transformers of an earthed line are beyond its earthing switch and "
        "measure nothing: there is nothing to compensate with, and zone 1 must be set for it.",
    )  # fmt: skip


def parallel_lines_loop() -> Diagram:
    """What the ground loop measures over the place of the fault."""
    places = np.linspace(0.02, 1.0, 50)
    drawn = []
    for colour, (name, (fed, earthed)) in enumerate(parallel_lines.CASES.items()):
        z = np.array([parallel_lines.apparent(float(x), fed, earthed)[0] for x in places])
        drawn.append(Curve(name, 100 * places, 100 * np.real(z), "smooth", colour))
        points = (0.2, 0.5, 0.8, 0.95)
        found = [parallel_lines.measured(x, fed, earthed) for x in points]
        own = {"colour": colour, "in_legend": False, "group": name}
        x = [100 * p for p in points]
        drawn.append(Curve(f"{name}: plant", x, [100 * f[0].real for f in found], "points", **own))
        if not earthed:
            said = f"{name}: compensated"
            drawn.append(Curve(said, x, [100 * f[1].real for f in found], "line", colour, "dash"))
    return Diagram(
        "What the ground loop measures", "place of the fault, % of the line", "% of the line", drawn,
        [Limit("zone 1", 80.0)], wide=True,
        note="Lines: closed form; points: the plant; dashed: compensated by the other line.",
    )  # fmt: skip


def parallel(quick: bool) -> list[Diagram]:
    """Of parallel lines."""
    return [parallel_lines_loop(), parallel_lines_reach(quick)]


def functions(quick: bool) -> list[Diagram]:
    """The current after a breaker has opened, with subsidence, and the detector."""
    case = next(case for case in cases_of("functions") if case.check == "detector" and case.input["left"] > 0)
    wave, zero = relay_checks.opened(case.input, math.radians(30))
    on = relay_checks.detector(wave)
    t = (np.arange(len(wave)) - zero) / relay_checks.SAMPLING * 1e3
    shown = (t > -40) & (t < 60)
    scale = np.abs(wave).max()
    drawn = [
        Curve("current, of its crest", t[shown], wave[shown] / scale, "smooth", 0),
        Curve("RBRF1: current flows", t[shown], np.array(on, float)[shown], "steps", 1),
    ]
    title = "The detector of breaker failure after the last zero"
    return [Diagram(title, "ms", "", drawn, [Limit("15 ms", 15.0, "x")], wide=True)]
