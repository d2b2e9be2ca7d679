"""A relay of a log, run once more over what the log has of it, to see what it knew at each sample.

The estimates are the log's own, the settings those that it was run with, the state before the first sample
is that of the scenario's steady state, as in the run.  That the decision is the same is not taken for
granted: every bit of every sample is compared with the logged ones.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from faultloop.errors import InputError
from faultloop.io.can.authentication import read
from faultloop.io.can.frames import Frame, State
from faultloop.io.can.table import BY_IDENTIFIER, Kind
from faultloop.io.mcap_reader import Log
from faultloop.io.messages import (
    BREAKER_STATUS,
    CAN_FRAME,
    ELEMENTS,
    LOOP_IMPEDANCES,
    PHASORS,
    POLES,
    SAMPLED_VALUES,
    values,
)
from faultloop.loop.recorded import recorded_scenario
from faultloop.loop.replay import turn_of
from faultloop.loop.scenario import Scenario
from faultloop.loop.warm import history, measured
from faultloop.relay import Relay, RelayInputs, RelaySettings
from faultloop.relay.layout import Instance
from faultloop.relay.quantities import WIDE
from faultloop.review.far_sets import COMPARED, FarSets
from faultloop.review.retrace_run import RetraceRun

NEEDED = (SAMPLED_VALUES, PHASORS, LOOP_IMPEDANCES, ELEMENTS)
ALL_POLES = 7
BESIDE_NS = 100_000_000
"""How far the clock of the parallel line's relay may be off."""
RECORD = "record"
BUS_SIDE = ("RSYN", "RREC")
"""Functions that take the voltages of the breaker's other side, which no log has."""
NO_PART = ("bus_fault", "can", "expect")
"""Of a scenario: in the state of the network before the run."""
_DONE: WeakKeyDictionary[Log, dict[str, Retraced]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Retraced:
    """What a relay knew.

    Attributes
    ----------
    name, settings, instances : of the relay.
    constants : its settings as the kernels have them (`faultloop.relay.layout.CONSTANTS`).
    t_ns : (n,) of the samples with something to explain [ns since the run's start].
    shared, zones : (n,) and (n, Z), `faultloop.relay.explain.SHARED` and ``ZONE``.
    differs_ns, differs : first sample, and bit, at which this relay decides otherwise than the log says; None
        where it never does.
    compared : (m,) `faultloop.review.far_sets.COMPARED` of a line differential.
    step : 1 where every such sample is there; else one in so many is, long after each change.
    """

    name: str
    settings: RelaySettings
    instances: tuple[Instance, ...]
    constants: Any
    t_ns: NDArray[np.int64]
    shared: NDArray[np.void]
    zones: NDArray[np.void]
    differs_ns: int | None
    differs: str | None
    compared: NDArray[np.void]
    step: int = 1


def retrace(log: Log, name: str) -> Retraced:
    """Run the relay ``name`` of a log once more; kept for the log.

    Raises InputError where the log does not have what it takes: settings, samples, phasors, loops, elements.
    """
    kept = _DONE.setdefault(log, {})
    if name not in kept:
        kept[name] = _retrace(log, name)
    return kept[name]


def _retrace(log: Log, name: str) -> Retraced:
    for message in NEEDED:
        topic = message.topic_for(name)
        if topic not in log.topics:
            raise InputError(
                f"has no {topic}: what the relay knew cannot be told; {_again(log)}", file=log.path
            )
    relay, scenario = _relay(log, name), _scenario(log)
    far = FarSets(log, scenario, relay) if relay.settings.pdif is not None and scenario is not None else None
    run = RetraceRun(relay, far)
    parallel = None
    if scenario is not None:
        place = [one.name for one in scenario.relay].index(name)
        parallel = scenario.relay[place].parallel
        before = measured(scenario, history(scenario))[place]
        relay.warm_up(np.ascontiguousarray(before[:, :6]) if parallel is None else one_side(before))
    heard, bits = Heard(relay), log.bits(name)["pickup"]
    for at_ns, poles in _positions(log, name):
        heard.take(at_ns, poles)
    differs, next_number, turns = None, None, [(0, 1.0 + 0.0j)]
    for span in log.stretches():
        samples, phasors, loops, elements = (log.array(m.topic_for(name), *span) for m in NEEDED)
        if not len(samples) == len(phasors) == len(loops) == len(elements):
            raise InputError(f"samples, phasors, loops and elements of {name} are not as many", file=log.path)
        if not len(samples):
            continue
        t_ns, numbers = samples["t_ns"], samples["sample_count"].astype(np.int64)
        inputs = heard.inputs(t_ns, elements["pickup"], bits)
        rows = values(samples) if parallel is None else _with_parallel(log, samples, parallel)
        words = np.zeros((len(t_ns), 2), np.uint64)
        pieces = np.split(np.arange(len(t_ns)), np.flatnonzero(np.diff(numbers) != 1) + 1)
        for piece in pieces:
            part, first = slice(int(piece[0]), int(piece[-1]) + 1), int(numbers[piece[0]])
            if first != next_number:
                if next_number is not None:
                    run.restart()
                if scenario is None:
                    turns.append((int(t_ns[piece[0]]), turn_of(relay.settings, first)))
            turned = np.array(values(phasors[part]), order="C")
            turned[:, :12].view(np.complex128)[...] *= turns[-1][1].conjugate()
            given = (np.ascontiguousarray(rows[part]), turned, np.ascontiguousarray(values(loops[part])))
            words[part] = run.take(first, given, inputs[part], t_ns[part])
            next_number = first + len(piece)
        differs = differs or _first_difference(log, name, relay, t_ns, words, elements)
    if next_number is None:
        raise InputError(f"there are no samples of {name}", file=log.path)
    _warn(log, name, differs, run.kept.step)
    for (from_ns, turn), (to_ns, _) in pairwise([*turns, (2**63 - 1, 0)]):
        part = slice(*np.searchsorted(run.kept.t_ns, [from_ns, to_ns]).tolist())
        for key in ("polarizing", "reference"):
            run.kept.shared[key][part] *= turn  # to the reference of the log's phasors
    kept, compared = run.kept, np.zeros(0, COMPARED) if far is None else far.compared
    differs_ns, bit = differs or (None, None)
    args = (name, relay.settings, relay.instances, run.constants, kept.t_ns, kept.shared, kept.zones)
    return Retraced(*args, differs_ns, bit, compared, kept.step)


def _warn(log: Log, name: str, differs: tuple[int, str] | None, step: int) -> None:
    if differs is not None:
        at = f"{differs[0] / 1e6:.3f} ms of the log on ({differs[1]})"
        what = f"{name}: run once more, this version's relay decides otherwise from {at}: what is told is of "
        log.warn(f"{what}this version; {_again(log)}")
    if step > 1:
        what = f"{name}: there is so much to explain that long after each change "
        log.warn(f"{what}one in {step} samples is looked at")


def one_side(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Without the voltages of the breaker's other side, which no log has."""
    rows = rows.copy()
    rows[:, 6:9] = np.nan
    return rows


def _with_parallel(log: Log, samples: np.ndarray, parallel: str) -> NDArray[np.float64]:
    """Samples (n, WIDE): with the residual current that the log has of the parallel line's relay."""
    topic = SAMPLED_VALUES.topic_for(parallel)
    if topic not in log.topics:
        what = f"has no {topic}, whose residual current the relay measures, too; {_again(log)}"
        raise InputError(what, file=log.path)
    near = (int(samples["t_ns"][0]) - BESIDE_NS, int(samples["t_ns"][-1]) + BESIDE_NS)
    other = log.array(topic, *near)
    wide = np.full((len(samples), WIDE), np.nan)
    wide[:, :6] = values(samples)
    place = np.searchsorted(other["sample_count"], samples["sample_count"])
    there = place < len(other)
    there[there] = other["sample_count"][place[there]] == samples["sample_count"][there]
    wide[there, -1] = values(other)[place[there], 3:].sum(axis=1)
    return wide


def _again(log: Log) -> str:
    if "scenario.toml" in log.attachments:
        return "a new run of its scenario logs everything: faultloop run with the attached scenario.toml"
    return "a new run, or a new replay of the record, logs everything"


def _relay(log: Log, name: str) -> Relay:
    """As it was when it was switched on."""
    text = log.metadata.get("settings", {}).get(name)
    try:
        settings = without_user_code(json.loads(text or ""))
    except (ValueError, AttributeError, InputError) as error:
        kind = type(error).__name__
        what = f"its settings of {name} are missing or not of this version ({kind}); {_again(log)}"
        raise InputError(what, file=log.path) from error
    return Relay(settings, name)


def without_user_code(data: Mapping[str, Any]) -> RelaySettings:
    """Settings as they were written, without a user's code, which a log of somebody's must not start."""
    own = {key: value for key, value in data.items() if key != "element"}
    settings = RelaySettings.from_dict(own)
    return RelaySettings.from_dict(own | {"estimator": {}}) if ":" in settings.estimator.method else settings


def _scenario(log: Log) -> Any:
    text = log.metadata.get("scenario", {}).get("json")
    if text is None:
        return None
    try:
        tables = json.loads(text)
        return Scenario.from_dict({key: tables[key] for key in tables if key not in NO_PART})
    except (ValueError, InputError) as error:
        what = f"its scenario is not of this version; {_again(log)}"
        raise InputError(what, file=log.path) from error


class Heard:
    """What a relay heard: closed poles, by its breaker's frames or a record's contacts; of a pilot scheme
    what its own bits say was received, for all poles, and whether the channel was there."""

    def __init__(self, relay: Relay) -> None:
        self._scheme = relay.settings.psch
        self._at_ns: list[int] = []
        self._poles = [RelayInputs().breaker_closed]

    def take(self, t_ns: int, poles: int) -> None:
        """From then on these poles are closed."""
        if poles != self._poles[-1]:
            self._at_ns.append(t_ns)
            self._poles.append(poles)

    def inputs(
        self, t_ns: NDArray[np.int64], pickup: NDArray[np.uint64], bits: Sequence[str]
    ) -> NDArray[np.int64]:
        """Rows of `RelayInputs` (n, 5); ``bits`` name those of ``pickup``."""
        out = np.tile(np.array(RelayInputs(), np.int64), (len(t_ns), 1))
        out[:, 0] = np.array(self._poles)[np.searchsorted(self._at_ns, t_ns, side="right")]

        def on(bit: str) -> NDArray[np.int64]:
            if bit not in bits:
                return np.zeros(len(t_ns), np.int64)
            return (pickup >> np.uint64(bits.index(bit)) & np.uint64(1)).astype(np.int64)

        if self._scheme is not None:
            received = ALL_POLES * on("PSCH1.ProRx")
            if self._scheme.type == "dtt":
                out[:, 3] = received
            else:
                out[:, 1:3] = received[:, None]
            out[:, 4] = 1 - on("PSCH1.LosOfGrd")
        return out


def _positions(log: Log, name: str) -> Iterator[tuple[int, int]]:
    """When its breaker, or the record's contacts, said which poles are closed."""
    scenario = recorded_scenario(log)
    breaker = next((place.get("breaker") for place in scenario["relay"] if place["name"] == name), None)
    if breaker is None:
        for e in log.walk(BREAKER_STATUS):
            if e.source == RECORD:
                yield e.t_ns, sum(e.fields[f"pole_{p.lower()}"] << bit for bit, p in enumerate(POLES))
        return
    for entry in log.walk(CAN_FRAME):
        kind, _ = BY_IDENTIFIER.get(entry.id, (None, 0))
        if kind is not Kind.BREAKER_STATUS or entry.sender != breaker:
            continue
        state = read(Frame(entry.id, entry.data, entry.extended, entry.fd))
        if isinstance(state, State):
            yield entry.t_ns, state.poles


def _first_difference(
    log: Log,
    name: str,
    relay: Relay,
    t_ns: NDArray[np.int64],
    words: NDArray[np.uint64],
    elements: np.ndarray,
) -> tuple[int, str] | None:
    """Where a bit that both have is not the same; none is compared of a user's element, which is not run, and
    of what synchrocheck releases."""
    bits = log.bits(name)["pickup"]
    ours = [bit if "." in bit else f"{bit}.Str" for bit in relay.bits]
    unseen = BUS_SIDE if relay.settings.rsyn is not None else ()
    known = sum(
        1 << k
        for k, (a, b) in enumerate(zip(ours, bits, strict=False))
        if a == b and not a.startswith(unseen)
    )
    logged = np.stack([elements["pickup"], elements["operate"]], axis=1)
    rows, columns = np.nonzero((words ^ logged) & np.uint64(known))
    if not len(rows):
        return None
    row, column = int(rows[0]), int(columns[0])
    place = int(words[row, column] ^ logged[row, column]) & known
    return int(t_ns[row]), relay.bits[(place & -place).bit_length() - 1]
