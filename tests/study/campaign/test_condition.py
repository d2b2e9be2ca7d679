"""`[[only]]`: what a condition may say, and that it can do nothing else."""

from __future__ import annotations

import pytest

from faultloop.errors import InputError
from faultloop.study.campaign.condition import Condition

VALUES = {
    "fault.F1.at_pu": 0.7,
    "fault.F1.type": "AG",
    "relay.RA.pdis.1.reach_pu": 0.85,
    "relay.RA.pdis.1.reach_pu2": 3,
    "line.A-B.length_km": 100,
}


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("fault.F1.at_pu < 0.8", True),
        ("fault.F1.at_pu < relay.RA.pdis.1.reach_pu", True),
        ("relay.RA.pdis.1.reach_pu > 0.9", False),
        ("relay.RA.pdis.1.reach_pu2 == 3", True),
        ("fault.F1.at_pu-0.7 == 0", True),
        ("line.A-B.length_km*fault.F1.at_pu >= 70", True),
        ("0.5 < fault.F1.at_pu <= 0.6", False),
        ("fault.F1.type in ['AG', 'BG'] and not fault.F1.at_pu > 0.75", True),
        ("fault.F1.type not in ('AG', 'BG') or fault.F1.type == \"AG\"", True),
        ("fault.F1.type == 'fault.F1.type'", False),
        ("abs(-fault.F1.at_pu) == max(0.1, fault.F1.at_pu, min(1, 2) - 1)", True),
        ("  fault.F1.at_pu % 0.5 < 0.21  ", True),
        ("(fault.F1.at_pu > 0.8) == False", True),
    ],
)
def test_conditions(text: str, holds: bool) -> None:
    assert Condition(text, list(VALUES), "only[0].when").holds(VALUES) is holds


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "only[0].when"),
        ("fault.F1.at", "did you mean 'fault.F1.at_pu'"),
        ("x < 1", "not a varied key"),
        ("__import__('os').system('true')", "no place"),
        ("open('x')", "no place"),
        ("fault.F1.at_pu.__class__", "cannot be judged"),
        ("fault.F1.type.upper()", "cannot be judged"),
        ("[x for x in (1,)]", "no place"),
        ("(lambda: 1)()", "no place"),
        ("2 ** 9999999999", "no place"),
        ("fault.F1.at_pu if 1 else 2", "no place"),
        ("f'{fault.F1.at_pu}'", "cannot be judged"),
        ("fault.F1.at_pu <", "cannot be judged"),
        ("_k0_ < 1", "not a varied key"),
        ("abs()", "no place"),
        ("min(*[1])", "no place"),
        ("fault.F1.at_pu = 1", "cannot be judged"),
        ("(" * 500 + "1" + ")" * 500, "cannot be judged"),
        ("-" * 3000 + "1", "cannot be judged"),
        ("b'x' == 1", "no place"),
        ("...", "no place"),
    ],
)
def test_what_is_no_condition(text: str, words: str) -> None:
    with pytest.raises(InputError) as error:
        Condition(text, list(VALUES), "only[0].when")
    assert words in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "text",
    [
        "fault.F1.type < 1",
        "fault.F1.at_pu / 0 > 1",
        "'x' * 100 == 'y'",
        "1 in fault.F1.at_pu",
        "abs('x') > 1",
    ],
)
def test_what_cannot_be_calculated(text: str) -> None:
    with pytest.raises(InputError, match="cannot be judged"):
        Condition(text, list(VALUES), "only[0].when").holds(VALUES)
