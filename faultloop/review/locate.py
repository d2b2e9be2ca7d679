"""Two-ended fault location from two logs, with or without a common clock.

The voltage along the line follows from either end (Johns and Jamali 1990)

    V(x) = V cosh(gamma x) - Zc I sinh(gamma x)

and is the same at the fault whatever its resistance is and whatever feeds it.  With a common clock the fault
is where both agree; without one (Novosel, Hart, Udren and Garitty 1996) where their magnitudes do.  Negative
sequence where the fault is unbalanced, for it has no load in it; else positive sequence.

Without a common clock two faults agree in magnitude somewhere, too.  What was not used to find the place
then tells whether it is one fault: the clocks' angle follows from what was used (from before the fault where
that is balanced), and with it the positive-sequence voltages agree, and a balanced fault is a resistance.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError
from faultloop.io.mcap_reader import Log
from faultloop.loop.recorded import recorded_scenario
from faultloop.review.facts import Summary
from faultloop.review.relay_summary import line_impedance
from faultloop.review.rows import relay_rows
from faultloop.review.summary import summarize

A = cmath.exp(2j * math.pi / 3)
SEQUENCES = {"positive": np.array([1, A, A**2]) / 3, "negative": np.array([1, A**2, A]) / 3}
UNBALANCED = 0.1
"""I2 over I1 at both ends: above it the fault is unbalanced."""
SETTLED_CYCLES, MOST_CYCLES = 0.25, 3.0
"""After the inception, before what is looked at begins; and how long it may be."""
EARLY_MS = 2.0
"""So long before the first pole opens it ends."""
POINTS = 4001
AGREE, DOUBTED, ANOTHER = 0.1, 0.03, 0.2
"""Parts of the ends' voltage: by which they may differ at the place; the second look, from where on it is
told, and from where on it is no fault of both.  Eleven faults came to 0.025 at most, pairs of two of them to
0.06 or more, but A-G at 40 and at 80 % of one line, from the same load and at the same angle, to 0.011."""
BEFORE_CYCLES = (2.25, 0.25)
"""Before the inception, what is looked at of the load."""


@dataclass(frozen=True)
class Line:
    """Positive sequence of the whole line: propagation and surge impedance; length [km] where known."""

    gamma: complex
    surge_ohm: complex
    length_km: float | None

    def voltage(self, v: complex, i: complex, part: NDArray[np.float64]) -> NDArray[np.complex128]:
        """What an end's voltage and current into the line make of the voltage at a part of the line."""
        x = self.gamma * part
        return v * np.cosh(x) - self.surge_ohm * i * np.sinh(x)

    def current(self, v: complex, i: complex, part: float) -> complex:
        """The same of the current there, away from the end."""
        x = self.gamma * part
        return i * cmath.cosh(x) - v / self.surge_ohm * cmath.sinh(x)


@dataclass(frozen=True)
class Location:
    """Where the fault is.

    Attributes
    ----------
    part : of the line, from the first relay.
    km : the same, None where the length is not known.
    sequence, synchronised : how it was found.
    mismatch : of the two voltages there, of the greater of the ends' own.
    second_mismatch : the same of what was not used to find the place; None where there is nothing: of a
        balanced fault from the record's first instant on, without a common clock.
    from_ms, to_ms : what of the records was used, after the inception.
    """

    part: float
    km: float | None
    sequence: str
    synchronised: bool
    mismatch: float
    second_mismatch: float | None
    from_ms: float
    to_ms: float


@dataclass(frozen=True)
class _End:
    log: Log
    summary: Summary
    relay: str

    @property
    def zero_ns(self) -> int:
        t_ns = self.summary.inception.t_ns
        if t_ns is None:
            raise InputError("has no fault and no pickup", file=self.log.path)
        return t_ns

    @property
    def stop_ms(self) -> float:
        """When the first pole opens, or the record ends [ms after the inception]."""
        facts = self.summary.relays[self.relay]
        opened = [(t - self.zero_ns) / 1e6 for trip in facts.trips for t in trip.poles_opened_ns.values()]
        last = ((facts.last_ns or 0) - self.zero_ns) / 1e6
        return min([last, *(ms for ms in opened if ms > 0)])

    def phasors(self, from_ms: float, to_ms: float, hz: float) -> NDArray[np.complex128]:
        """(6,) RMS between two times after the inception; angles count from the log's own time zero.

        By least squares over the whole of it, which waves that run to and fro on the line disturb less than
        one cycle; a parabola beside the fundamental takes the decaying offset.
        """
        start, stop = (self.zero_ns + round(1e6 * ms) for ms in (from_ms, to_ms))
        rows = relay_rows(self.log, self.relay, start, stop)
        count = len(rows)
        whole = count > 8 and (stop - start) / count < 1.2 * rows.interval_ns
        if not whole or not np.isfinite(rows.samples).all():
            raise InputError("samples are missing in the fault", file=self.log.path, key=self.relay)
        angle = 2 * np.pi * hz * (self.log.start_ns % 10**9 + rows.t_ns) / 1e9
        along = np.linspace(-1.0, 1.0, count)
        terms = np.column_stack([np.cos(angle), np.sin(angle), np.ones(count), along, along**2])
        found = np.linalg.lstsq(terms, rows.samples, rcond=None)[0]
        return (found[0] - 1j * found[1]) / math.sqrt(2)


def locate(
    one: Log,
    other: Log,
    relays: tuple[str | None, str | None] = (None, None),
    synchronised: bool | None = None,
) -> Location:
    """Where the fault on the line between two relays is.

    Parameters
    ----------
    one, other : logs of the two ends; the same twice where both relays are in one.
    relays : their names; each may be left out where its log has only one (two, in one log: in its order).
    synchronised : the logs have a common clock; None: they have where both are of one run, by their start
        and their scenario.

    Raises
    ------
    InputError : a relay, a fault, a line impedance is missing, there is no place at which both ends agree, or
        they agree there by chance, being of two faults.
    """
    same = one.path == other.path
    names = tuple(
        _relay(log, name, place if same else 0)
        for place, (log, name) in enumerate(zip((one, other), relays, strict=True))
    )
    if same and names[0] == names[1]:
        raise InputError(f"both are relay {names[0]}: two ends are needed", file=one.path)
    ends = [_End(log, summarize(log), name) for log, name in zip((one, other), names, strict=True)]
    hertz = {end.summary.log.nominal_hz for end in ends}
    if len(hertz) > 1:
        raise InputError(f"the two logs are of {' and '.join(f'{f:g}' for f in sorted(hertz))} Hz")
    hz = hertz.pop()
    common = synchronised if synchronised is not None else same or _of_one_run(one, other)
    line = _line(one, names[0])
    stop_ms = min(end.stop_ms for end in ends) - EARLY_MS
    cycle_ms = 1e3 / hz
    if stop_ms < (1 + SETTLED_CYCLES) * cycle_ms:
        raise InputError(f"the fault is over after {stop_ms + EARLY_MS:.1f} ms: too short for a cycle of it")
    from_ms = max(SETTLED_CYCLES * cycle_ms, stop_ms - MOST_CYCLES * cycle_ms)
    six = [end.phasors(from_ms, stop_ms, hz) for end in ends]
    shares = [abs(SEQUENCES["negative"] @ x[3:]) / abs(SEQUENCES["positive"] @ x[3:]) for x in six]
    sequence = "negative" if max(shares) > UNBALANCED else "positive"
    turn = SEQUENCES[sequence]
    (va, ia), (vb, ib) = ((complex(turn @ x[:3]), complex(turn @ x[3:])) for x in six)
    parts = np.linspace(0.0, 1.0, POINTS)
    from_a, from_b = line.voltage(va, ia, parts), line.voltage(vb, ib, 1.0 - parts)
    scale = max(abs(va), abs(vb), 1e-9)
    if common:
        miss = np.abs(from_a - from_b)
        best = int(miss.argmin())
    else:
        miss = np.abs(np.abs(from_a) - np.abs(from_b))
        # Two places may have the same magnitude.  At the fault negative sequence, which it feeds, is
        # greatest, and positive sequence smallest.
        crossing = np.flatnonzero(np.diff(np.sign(np.abs(from_a) - np.abs(from_b))))
        places = crossing if len(crossing) else np.array([miss.argmin()])
        there = np.abs(from_a)[places]
        best = int(places[there.argmax() if sequence == "negative" else there.argmin()])
    if miss[best] > AGREE * scale:
        raise InputError(
            f"at no place of the line do the two ends agree (they differ by {100 * miss[best] / scale:.0f} %"
            " at least): is the fault on it, and are these its two ends?"
        )
    part = float(parts[best])
    turn_of_clocks = 1.0 + 0.0j if common else _clocks(line, part, ends, six, sequence, hz)
    second = None if turn_of_clocks is None else _second_look(line, part, six, turn_of_clocks, sequence)
    if second is not None and second > ANOTHER:
        at = f"at {100 * part:.1f} % of the line"
        raise InputError(
            f"{at} the two ends agree in the {sequence} sequence alone, and differ by {100 * second:.0f} %"
            " otherwise: are both of the same fault, and are these its two ends?"
        )
    if second is not None and second > DOUBTED:
        one.warn(
            f"at {100 * part:.1f} % of the line the two ends differ by {100 * second:.0f} % in what was not"
            " used to find it: are both of the same fault, and is the line's impedance right?"
        )
    km = None if line.length_km is None else part * line.length_km
    mismatch = float(miss[best] / scale)
    return Location(part, km, sequence, bool(common), mismatch, second, from_ms, stop_ms)


def _both(
    line: Line, part: float, six: list[NDArray[np.complex128]], sequence: str
) -> tuple[complex, complex]:
    """The voltage at a part of the line, as either end makes it."""
    turn, parts = SEQUENCES[sequence], (part, 1.0 - part)
    a, b = (
        line.voltage(complex(turn @ x[:3]), complex(turn @ x[3:]), np.array([at]))[0]
        for x, at in zip(six, parts, strict=True)
    )
    return complex(a), complex(b)


def _clocks(
    line: Line, part: float, ends: list[_End], six: list[NDArray[np.complex128]], sequence: str, hz: float
) -> complex | None:
    """What turns the first end's phasors to the second's clock; None where nothing tells it."""
    if sequence == "positive":
        from_ms, to_ms = (-1e3 * cycles / hz for cycles in BEFORE_CYCLES)
        try:
            six = [end.phasors(from_ms, to_ms, hz) for end in ends]
        except InputError:  # it begins later
            return None
    a, b = _both(line, part, six, sequence)
    return b / a * abs(a) / abs(b) if a and b else None


def _second_look(
    line: Line, part: float, six: list[NDArray[np.complex128]], clocks: complex, sequence: str
) -> float:
    """By how much the positive sequence of the ends differs at the place, and of a balanced fault how much of
    its voltage no resistance explains; of the greater of the ends' own."""
    turn = SEQUENCES["positive"]
    scale = max(abs(turn @ x[:3]) for x in six)
    a, b = _both(line, part, six, "positive")
    apart = abs(a * clocks - b)
    if sequence == "positive":
        into = sum(
            line.current(complex(turn @ x[:3]), complex(turn @ x[3:]), at) * by
            for x, at, by in zip(six, (part, 1.0 - part), (clocks, 1.0 + 0.0j), strict=True)
        )
        across = (a * clocks + b) / 2 * np.conj(into) / max(abs(into), 1e-9)
        apart = max(apart, abs(across - max(across.real, 0.0)))
    return float(apart / max(scale, 1e-9))


def _relay(log: Log, name: str | None, place: int) -> str:
    names = list(log.relays)
    if name is None:
        if len(names) <= place:
            raise InputError(f"has {len(names)} relays, and two are needed", file=log.path)
        return names[place]
    if name not in names:
        raise InputError(f"has no relay '{name}'; it has {', '.join(names) or 'none'}", file=log.path)
    return name


def _of_one_run(one: Log, other: Log) -> bool:
    return one.start_ns == other.start_ns and (
        one.metadata.get("scenario", {}).get("json")
        == other.metadata.get("scenario", {}).get("json")
        is not None
    )


def _line(log: Log, relay: str) -> Line:
    """By the scenario, with its capacitance; else by the relay's settings, without."""
    scenario = recorded_scenario(log)
    place = next((r for r in scenario["relay"] if r["name"] == relay), {})
    own = next((line for line in scenario["line"] if line.get("name") == place.get("line")), {})
    if {"length_km", "r1_ohm_per_km", "x1_ohm_per_km"} <= set(own):
        km = own["length_km"]
        z = complex(own["r1_ohm_per_km"], own["x1_ohm_per_km"]) * km
        y = complex(0.0, own.get("b1_us_per_km", 0.0) * 1e-6) * km
        return Line(cmath.sqrt(z * y), cmath.sqrt(z / y), km) if y else _lumped(z, km)
    z1 = line_impedance(log, relay)
    if z1 is None:
        raise InputError("tells no impedance of the line", file=log.path, key=relay)
    return _lumped(z1, None)


def _lumped(z1: complex, km: float | None) -> Line:
    """No capacitance: gamma so small that cosh is 1 and Zc sinh is the impedance."""
    small = 1e-6
    return Line(complex(small), z1 / small, km)
