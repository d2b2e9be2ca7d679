"""Each filter's docstring has its paper's authors, title, journal and year, as far as the text has them."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import pytest

METHODS = "faultloop.relay.estimators.methods."
PAPERS = "faultloop.study.papers."
ADAPTIVE = (
    "Zhang Zhe, Chen Deshu",
    "Application of the adaptive Kalman filter in computer relaying",
    "neither journal",
)
STF = (
    "Zhou Donghua",
    "A suboptimal multiple fading extended Kalman filter",
    "Acta Automatica Sinica",
    "1991",
)
STUKF = (
    "Wang Xiaoxu",
    "Strong tracking filter based on unscented transformation",
    "Control and Decision",
    "2010",
)
MSTUKF = (
    "Wang Yi, Liu Heng",
    "Transient voltage disturbance detection based on modified strong tracking UKF",
    "Power System Protection and Control",
    "2017",
)
TAYLOR = (
    "Wu Zhili, Zhao Qingsheng",
    "Research on a synchrophasor measurement algorithm based on Kalman filtering at low sampling frequency",
    "Power System Protection and Control",
    "2014",
)
CKMC = (
    "Zhao Zhilei, Huang Jidong, Wang Yi, Yang Zhiwei",
    "Dynamic state estimation of generators based on CKMC-CKF under non-Gaussian noise",
    "Guangdong Electric Power",
    "2024",
)
RLS = (
    "Li Liezhong, Zhou Chao",
    "The application of recursive least squares in microprocessor protection",
    "1993",
    "name the journal",
)
CITED = [
    (METHODS + "adaptive_kalman", ADAPTIVE),
    (PAPERS + "adaptive_kalman", ADAPTIVE),
    (PAPERS + "adaptive_kalman.filter", ADAPTIVE),
    (METHODS + "stf", STF + MSTUKF),
    (METHODS + "stukf", STUKF),
    (METHODS + "mstukf", MSTUKF),
    ("faultloop.relay.estimators.filters.strong_tracking", STF + STUKF + MSTUKF),
    (PAPERS + "mstukf", MSTUKF),
    (PAPERS + "mstukf.cases", MSTUKF),
    (METHODS + "taylor_kalman", TAYLOR),
    (PAPERS + "taylor_kalman", TAYLOR),
    (PAPERS + "taylor_kalman.as_written", TAYLOR),
    (PAPERS + "ckmc", CKMC),
    (PAPERS + "ckmc.cubature", (*CKMC, "Automatic Control", "2009", "Automatica", "2017")),
    (PAPERS + "ckmc.machines.machine", CKMC),
    (PAPERS + "ckmc.generator", CKMC),
    (METHODS + "rls", RLS),
    (PAPERS + "rls", RLS),
]


@pytest.mark.parametrize(("module", "words"), CITED, ids=[module for module, _ in CITED])
def test_a_filter_s_docstring_cites_its_paper(module: str, words: tuple[str, ...]) -> None:
    text = " ".join((import_module(module).__doc__ or "").split())
    assert [word for word in words if word not in text] == []


def test_the_docs_name_the_papers(root: Path) -> None:
    text = (root / "docs" / "estimators.md").read_text(encoding="utf-8")
    rows = {line.split("|")[1].strip(" `"): line for line in text.splitlines() if line.startswith("| `")}
    for method, words in (
        ("adaptive-kalman", ADAPTIVE),
        ("stf", STF),
        ("stukf", STUKF),
        ("mstukf", MSTUKF),
        ("taylor-kalman", TAYLOR),
        ("rls", RLS),
    ):
        row = next(
            line for line in text.splitlines() if line.startswith(f"| `{method}` | ") and words[0] in line
        )
        assert all(word in row for word in words), method
    assert rows
