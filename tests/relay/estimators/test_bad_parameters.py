"""What no estimator can do is refused in one line that names the key and the limit."""

from __future__ import annotations

import math

import pytest

from faultloop.errors import InputError
from faultloop.relay.estimators import estimator_methods, estimator_parameters, make_estimator

each_method = pytest.mark.parametrize("method", estimator_methods())

EVERY_PARAMETER = [
    (method, key) for method in estimator_methods() for key in sorted(estimator_parameters(method))
]
WRONG = (math.nan, math.inf, -math.inf, -1e9, "1", True, [1.0])


def refused(method, sampling_hz=4800, **parameters):
    """The message's one line."""
    with pytest.raises(InputError) as caught:
        make_estimator(method, sampling_hz, 50.0, **parameters)
    message = str(caught.value)
    assert "\n" not in message
    return message


@pytest.mark.parametrize("value", WRONG, ids=str)
@pytest.mark.parametrize(("method", "key"), EVERY_PARAMETER)
def test_no_parameter_takes_what_is_no_number_of_its_kind(method, key, value):
    if isinstance(estimator_parameters(method)[key], str) and value == "1":
        value = "no such choice"
    assert refused(method, **{key: value}).startswith(f"{key}: ")


@pytest.mark.parametrize(
    ("method", "key"), [(m, k) for m, k in EVERY_PARAMETER if k.endswith(("variance", "covariance", "floor"))]
)
def test_a_variance_is_above_zero(method, key):
    assert "should be" in refused(method, **{key: 0.0})


@each_method
def test_an_unknown_parameter_is_named(method):
    assert refused(method, no_such=1.0).startswith(f"no_such: '{method}' has no such parameter")


@each_method
@pytest.mark.parametrize("sampling_hz", [0, -4800, 60, 100, math.nan, 4800.5, "4800"])
def test_a_sampling_rate_that_is_none_or_too_low_names_the_least(method, sampling_hz):
    message = refused(method, sampling_hz)
    assert message.startswith("sampling_hz: ")
    if sampling_hz in (60, 100):
        assert "at least" in message


# least-squares has its window as a parameter, and it is refused by that name.
@pytest.mark.parametrize("method", sorted(set(estimator_methods()) - {"least-squares"}))
def test_the_least_rate_that_is_named_is_taken(method):
    """The limit in the message is the limit."""
    least = int(refused(method, 60).split()[-1])
    make_estimator(method, least, 50.0)
    refused(method, least - 1)


@pytest.mark.parametrize("method", ["ekf", "ukf", "stf", "stukf", "mstukf"])
def test_nine_states_need_more_than_twice_their_seventh_harmonic(method):
    """Of 50 Hz at 400 samples per second the 7th, 350 Hz, would be the fundamental."""
    assert refused(method, 400) == (
        "sampling_hz: 8 samples per cycle are too few for 'harmonics = 4': at 50 Hz it needs sampling_hz of "
        "at least 800"
    )
    make_estimator(method, 400, 50.0, harmonics=2)


def test_a_window_is_not_shorter_than_the_state():
    for message in (
        refused("taylor-kalman", 200, window_ms=40.0),
        refused("least-squares", window_cycles=0.01),
    ):
        assert "shorter than the" in message
    assert "at least 50 ms" in refused("taylor-kalman", 200, window_ms=40.0)
