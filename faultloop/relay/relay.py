"""The relay: estimator, loops, elements, decision, in blocks that stop at an output change."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from faultloop.config.user_code import entry_point_names, load
from faultloop.errors import InputError
from faultloop.relay import layout
from faultloop.relay.chain import decide
from faultloop.relay.cvt import estimator_in_front
from faultloop.relay.estimators import ROW, Estimator, build_estimator, estimator_methods, make_estimator
from faultloop.relay.events import Event, Outputs
from faultloop.relay.functions.function import Polygon
from faultloop.relay.loops import MEASURE_CONSTANTS, MEASURE_STATE, measure
from faultloop.relay.quantities import INPUTS, LOOPS, OUTPUTS, WIDE
from faultloop.relay.settings import RelaySettings
from faultloop.relay.step import block_runner, step_address
from faultloop.relay.texts import Teller, Words
from faultloop.relay.users import load_elements

Array = NDArray[np.float64]
Notices = Sequence[tuple[int, NDArray[np.void]]]
FIRST_CAPACITY = 512
LEAST_AHEAD = 16
ESTIMATORS = "faultloop.estimators"
"""Group of entry points."""


class RelayInputs(NamedTuple):
    """Binary inputs: masks of the poles that are closed as the breaker reports them, of the pilot signals of
    any far end and of every one, of a trip from a far end; 1 while every channel works."""

    breaker_closed: int = 7
    pilot: int = 0
    pilot_all: int = 0
    transfer: int = 0
    linked: int = 1


class Relay:
    """A distance relay that runs over blocks of samples.

    Parameters
    ----------
    settings : validated settings.
    name : for messages.
    estimator : in place of the one that the settings name.

    Attributes
    ----------
    inputs : `RelayInputs`, constant during a block.
    instances : its functions in the order of their bits.
    bits : name of each bit of ``pickup`` and ``operate``: bit i of pickup is ``<bits[i]>.Str``, of operate
        ``<bits[i]>.Op`` (``PTRC1.Tr``); a name with a dot (``RDIR1.DirFwd``, ``PHS1.AG``) is whole.
    phasors (m, 14), loops (m, 12), pickup (m,) uint64, operate (m,) uint64 : of the last `advance`, and
        overwritten by the next.
    events : of the last `advance`.
    """

    def __init__(
        self, settings: RelaySettings, name: str = "R1", *, estimator: Estimator | None = None
    ) -> None:
        self.settings = settings
        self.name = name
        self.inputs = RelayInputs()
        self.estimator = _in_front(settings, estimator or estimator_of(settings))
        self._elements = load_elements(settings)
        self.instances = layout.instances(settings, self._elements)
        self._constants = layout.constants(settings, self.estimator.settling_samples, self.instances)
        self._state = layout.initial_state()
        self._measure_constants, self._measure_state = _measuring(settings, self._constants["shared"][0])
        self._face()
        self._estimator_state = self.estimator.state.copy()
        self._estimate = block_runner(self.estimator.step)
        self.bits = tuple(name for instance in self.instances for name in instance.bits)
        self._teller = Teller(settings, self.instances, self.bits, self._state)
        self.events: list[Event] = []
        self._polygons: dict[str, tuple[Polygon, Polygon]] | None = None
        self.bank: Any = None
        self.place = 0
        """In a bank, where it is in one."""
        self.sample_count = 0
        self._last_outputs = [0] * (len(OUTPUTS) - 1)
        self._ahead, self._changed = FIRST_CAPACITY, 0
        self._capacity = 0
        self._reserve(FIRST_CAPACITY)
        self.phasors, self.loops = self._phasors[:0], self._loops[:0]
        self.pickup, self.operate = self._words[:0, 0], self._words[:0, 1]

    @property
    def outputs(self) -> Outputs:
        """The outputs at the last sample done."""
        return Outputs(*self._outputs[:6].tolist())

    @property
    def fault_location(self) -> float:
        """Distance of the last fault that was located, per unit of the line; NaN where there is none."""
        return float(self._state["rflo"]["value"][0, 0])

    def characteristics(self) -> dict[str, tuple[Polygon, Polygon]]:
        """Per zone the closed polygons of ground and phase loops, (k, 2), primary ohm, for the R-X plane."""
        if self._polygons is None:
            self._polygons = {
                instance.name: instance.function.polygons(self.settings, instance.table)
                for instance in self.instances
                if instance.function.polygons is not None
            }
        return self._polygons

    def advance(self, samples: Array) -> int:
        """Run over ``samples`` (n, 6), volts and amperes primary, instantaneous, or (n, `WIDE`).

        Stops after the first sample at which an output changed and returns the number m of samples done,
        1 <= m <= n.  The results do not depend on how the samples are cut into blocks.
        """
        if samples.ndim != 2 or samples.shape[1] not in (6, WIDE) or len(samples) == 0:
            raise ValueError(f"samples must be (n, 6) or (n, {WIDE}) with n >= 1, not {samples.shape}")
        samples = np.ascontiguousarray(samples, np.float64)
        self._reserve(len(samples))
        self.set_inputs(self.inputs)
        outputs = self._outputs.tolist()[:-1]
        done = self._changed = 0
        # The estimates run ahead of the decision: twice as far each time that all of them were taken, and as
        # far as the last stop after one.
        while done < len(samples):
            begin, end = done, min(done + self._ahead, len(samples))
            done = self._run(samples, begin, end)
            if done < end or self._outputs.tolist()[:-1] != outputs:
                self._ahead = max(done, LEAST_AHEAD)
                break
            if end - begin == self._ahead:
                self._ahead *= 2
        self.phasors, self.loops = self._phasors[:done], self._loops[:done]
        self.pickup, self.operate = self._words[:done, 0], self._words[:done, 1]
        self._tell(done)
        self.sample_count += done
        return done

    def warm_up(self, samples: Array) -> None:
        """Run over the samples before sample 0: the relay has been in service when a run begins.

        ``n`` must be whole cycles, as the phasors' reference begins with the first sample that a relay sees.
        A trip that stands at the end is none of the run's: the relay then begins with empty filters.
        """
        if len(samples) * self.settings.relay.frequency_hz % self.settings.relay.sampling_hz:
            raise ValueError(f"{len(samples)} samples are no whole number of cycles")
        new, samples = self.save(), np.ascontiguousarray(samples, np.float64)
        self._reserve(len(samples))
        self.set_inputs(self.inputs)
        self._estimate_rows(samples, slice(len(samples)))
        done = 0
        while done < len(samples):
            done += self._decide(samples, slice(done, len(samples)))
        self.phasors, self.loops = self._phasors[:done], self._loops[:done]
        self._teller.changes(0, self._words[:done])  # so that it is known what changes after it
        self._teller.notices(0, self._state)
        self._last_outputs, self.events = self._outputs.tolist()[:-1], []
        if self.outputs.trip_poles:
            self.restore(new)
            text = "would have tripped before the run began: begins anew, with empty filters"
            self.events = [Event(0, "warning", text)]
        self.sample_count = 0

    def save(self) -> Any:
        """Everything that changes while it runs."""
        rest = (self.sample_count, self._last_outputs, self._teller.save(), self.inputs)
        own = [element.state.copy() for element in self._elements]
        return (self._state_bytes.copy(), self._save_ahead(), own, rest)

    def restore(self, state: Any) -> None:
        """Go back to what `save` gave; the same samples then give the same bits."""
        self._state_bytes[:] = state[0]
        self._restore_ahead(state[1])
        for element, own in zip(self._elements, state[2], strict=True):
            element.state[:] = own
        self.sample_count, self._last_outputs, told, self.inputs = state[3]
        self._teller.restore(told)

    # -- in a bank (`faultloop.relay.bank`) -----------------------------------------------------------------

    @property
    def step_address(self) -> int:
        """Of the estimator's compiled step; 0 where it is plain Python."""
        return step_address(self._estimate)

    @property
    def tells_apart(self) -> bool:
        """Whether a function of the user's tells events, from a state that is not in `STATE`."""
        return any(i.user is not None and i.function.tell is not None for i in self.instances)

    def settle_in(
        self,
        constants: NDArray[np.void],
        state: NDArray[np.void],
        measure_constants: NDArray[np.void],
        measure_state: NDArray[np.void],
        estimator: Array,
    ) -> None:
        """Its constants and its state are in these arrays from now on, each of shape (1,) but the last."""
        new = (constants, state, measure_constants, measure_state)
        old = (self._constants, self._state, self._measure_constants, self._measure_state)
        for to, of in zip(new, old, strict=True):
            to.view(np.uint8)[:] = of.view(np.uint8)
        estimator[:] = self._estimator_state
        self._constants, self._measure_constants, self._estimator_state = (
            constants,
            measure_constants,
            estimator,
        )
        self._state, self._measure_state = state, measure_state
        self._face()

    def set_inputs(self, inputs: RelayInputs) -> None:
        """From the next sample on."""
        self._inputs[:] = (*inputs, self.sample_count - 1)

    def estimate(self, samples: Array, phasors: Array, loops: Array) -> None:
        """What the decision then takes, of the next samples (n, 6), into (n, 14) and (n, 12)."""
        self._estimate(self._estimator_state, samples, phasors)
        measure(self._measure_constants, self._measure_state, phasors, loops)

    def told(self, first: int, words: Words, notices: Notices, *, texts: bool = True) -> list[Event]:
        """Events of samples from number ``first`` on: where one of ``words`` (n, 2) differs from the one
        before, and what the functions tell at the samples of ``notices``, from the relay's state then.
        Without ``texts`` only trips."""
        events = self._teller.changes(first, words) if texts else []
        for sample, state in notices:
            events += self._teller.notices(sample, state, texts=texts)
        return sorted(events, key=attrgetter("sample_count"))  # of one sample the changes first

    def check_elements(self) -> None:
        """Raises InputError where a function of the user's has failed."""
        for element in self._elements:
            if (error := element.error) is not None:  # whatever a user's function raises
                what = f"failed near sample {self.sample_count}: {type(error).__name__}: {error}"
                key = f"element[{element.name}].function"
                raise InputError(what, file=self.settings.path, key=key) from error

    def _face(self) -> None:
        """What looks into the arrays of its state: to copy bytes takes 1 us, field by field 17."""
        self._inputs = layout.neighbours(self._state, (*INPUTS, "number"))
        self._outputs = layout.neighbours(self._state, OUTPUTS)
        self._state_bytes = self._state.view(np.uint8)
        self._measure_bytes = self._measure_state.view(np.uint8)

    def _save_ahead(self) -> tuple[Array, NDArray[np.uint8]]:
        return self._estimator_state.copy(), self._measure_bytes.copy()

    def _restore_ahead(self, state: tuple[Array, NDArray[np.uint8]]) -> None:
        self._estimator_state[:] = state[0]
        self._measure_bytes[:] = state[1]

    def _run(self, samples: Array, begin: int, end: int) -> int:
        """Samples of these numbers, until an output changes; returns the number of the next."""
        before = self._save_ahead()
        self._estimate_rows(samples, slice(begin, end))
        done = begin + self._decide(samples, slice(begin, end))
        if done < end:  # what ran ahead of the decision goes back and follows it
            self._restore_ahead(before)
            self._estimate_rows(samples, slice(begin, done))
        return done

    def _estimate_rows(self, samples: Array, rows: slice) -> None:
        self.estimate(_six(samples[rows]), self._phasors[rows], self._loops[rows])

    def _decide(self, samples: Array, rows: slice) -> int:
        made = self._phasors[rows], self._loops[rows], self._words[rows]
        done = decide(self._constants, self._state, samples[rows], *made)
        self._changed += int(self._outputs[-1])
        self.check_elements()
        return done

    def _reserve(self, n: int) -> None:
        if n <= self._capacity:
            return
        self._capacity = n
        self._phasors = np.zeros((n, ROW))
        self._loops = np.zeros((n, 2 * len(LOOPS)))
        self._words = np.zeros((n, 2), np.uint64)

    def _tell(self, done: int) -> None:
        """Events of the samples just done: where a bit changed, and what the functions have to tell."""
        *outputs, _ = self._outputs.tolist()
        words = self._words[:done]
        self.events = self._teller.changes(self.sample_count, words) if self._changed else []
        if outputs != self._last_outputs:
            self._last_outputs = outputs
            # the block has stopped at that sample
            self.events += self._teller.notices(self.sample_count + done - 1, self._state)


def _six(samples: Array) -> Array:
    """The channels that the estimator sees."""
    return samples if samples.shape[1] == 6 else np.ascontiguousarray(samples[:, :6])


def _in_front(settings: RelaySettings, estimator: Estimator) -> Estimator:
    """Of the voltages in front of a transformer whose circuit is known."""
    return estimator if settings.inverse_vt is None else estimator_in_front(estimator, settings.inverse_vt)


def estimator_of(settings: RelaySettings) -> Estimator:
    """The estimator that settings name.  Raises InputError, with their file and key."""
    wanted, header = settings.estimator, settings.relay
    rates = (header.sampling_hz, float(header.frequency_hz))
    try:
        if _is_users(wanted.method):
            return _users_estimator(settings, *rates)
        return make_estimator(wanted.method, *rates, **wanted.parameters)
    except InputError as error:
        key = "relay.sampling_hz" if error.key == "sampling_hz" else f"estimator.{error.key or 'method'}"
        raise InputError(error.what, file=settings.path, key=key) from error


def _users_estimator(settings: RelaySettings, sampling_hz: int, frequency_hz: float) -> Estimator:
    wanted = settings.estimator
    make: Any = load(wanted.method, settings.path.parent if settings.path else Path(), ESTIMATORS)
    if not inspect.isroutine(make):
        raise InputError(f"'{wanted.method}' is no function make(sampling_hz, frequency_hz, *, ...)")
    try:
        made: Any = build_estimator(make, wanted.method, sampling_hz, frequency_hz, **wanted.parameters)
    except InputError:
        raise
    except Exception as error:  # whatever a user's function raises
        raise InputError(f"'{wanted.method}' failed: {type(error).__name__}: {error}") from error
    if not isinstance(made, Estimator):
        raise InputError(f"'{wanted.method}' gives no Estimator but {type(made).__name__}")
    return made


def _is_users(method: str) -> bool:
    """Whether a method is a file's, a module's or an installed package's, and none of the estimators here."""
    if method in estimator_methods():
        return False
    return ":" in method or method in entry_point_names(ESTIMATORS)


def _measuring(settings: RelaySettings, c: np.void) -> tuple[NDArray[np.void], NDArray[np.void]]:
    constants = np.zeros(1, MEASURE_CONSTANTS)
    constants["k0"] = settings.residual_compensation_factor
    for key in ("minimum_current", "minimum_voltage", "frequency", "snapshot", "settling"):
        constants[key] = c[key]
    constants["interval"] = c["snapshot"] / c["sampling"]
    constants["snapshots"] = max(round(c["cycle"] / c["snapshot"]), 1)
    state = np.zeros(1, MEASURE_STATE)
    for key in ("f", "frequency", "rocof"):
        state[key] = np.nan  # nothing measured yet
    return constants, state


def records_of(relay: Relay) -> tuple[NDArray[np.void], NDArray[np.void]]:
    """A relay's ``CONSTANTS`` and ``STATE``, each of shape (1,), for who hands differential data over."""
    return relay._constants, relay._state
