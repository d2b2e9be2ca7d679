"""A sign that is broken in a filter breaks its transcription: each mutant must fail."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

STUDY, RELAY = "faultloop/study/papers/", "faultloop/relay/estimators/"
HERE = "tests/study/papers/transcriptions/"
MUTANTS = [
    # (file, what is written, what is broken, the test that fails)
    (STUDY + "adaptive_kalman/filter.py", "e * e - predicted", "e * e + predicted",
     "test_adaptive_kalman.py::test_the_study_s_filter"),
    (STUDY + "adaptive_kalman/filter.py", "-np.sin(angle)[:, None]", "np.sin(angle)[:, None]",
     "test_adaptive_kalman.py::test_the_study_s_filter"),
    (RELAY + "methods/adaptive_kalman.py", "max(0.0, e * e - state[", "max(0.0, e * e + state[",
     "test_adaptive_kalman.py::test_the_relay_s_as_written"),
    (RELAY + "filters/strong_tracking.py", "- noise - f.settings", "- noise + f.settings",
     "test_strong_tracking.py::test_the_study_s_filters"),
    (RELAY + "filters/strong_tracking.py", "noise_share(f, s) - soft", "noise_share(f, s) + soft",
     "test_strong_tracking.py::test_the_study_s_filters"),
    (RELAY + "filters/harmonic_model.py", "x[i + 1] = c * b - s * a", "x[i + 1] = c * b + s * a",
     "test_strong_tracking.py::test_the_study_s_filters"),
    (RELAY + "filters/harmonic_model.py", "= -turn * (c * a", "= turn * (c * a",
     "test_strong_tracking.py::test_the_study_s_filters"),
    (STUDY + "taylor_kalman/as_written.py", "(samples[n] - h @ x)", "(samples[n] + h @ x)",
     "test_taylor_kalman.py::test_the_filter_as_written"),
    (STUDY + "taylor_kalman/as_written.py", "(curve - slope**2)", "(curve + slope**2)",
     "test_taylor_kalman.py::test_the_filter_as_written"),
    (RELAY + "methods/taylor_kalman.py", "(curve - slope * slope)", "(curve + slope * slope)",
     "test_taylor_kalman.py::test_the_relay_s_default"),
    (STUDY + "rls.py", "x = x + np.outer(g, z[k] - h @ x)", "x = x + np.outer(g, z[k] + h @ x)",
     "test_recursive_least_squares.py::test_the_study_s_recursion"),
    (RELAY + "methods/rls.py", "row[j + 1] = -s", "row[j + 1] = s",
     "test_recursive_least_squares.py::test_the_relay_s"),
    (STUDY + "ckmc/machines/machine.py", "(p[XQ] - p[XQ1]) * i_q", "(p[XQ] + p[XQ1]) * i_q",
     "test_cubature.py::test_the_model"),
    (STUDY + "ckmc/cubature.py", "1.0 / (1.0 + e * e / bandwidth) ** 2", "1.0 / (1.0 + e * e / bandwidth)",
     "test_cubature.py::test_the_filters"),
    (STUDY + "ckmc/cubature.py", "e -= f.gain[i, k] * f.white[i]", "e += f.gain[i, k] * f.white[i]",
     "test_cubature.py::test_the_filters"),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("mutant", MUTANTS, ids=[f"{Path(m[0]).name}: {m[2]}" for m in MUTANTS])
def test_a_broken_sign_is_seen(mutant: tuple, root: Path, tmp_path: Path) -> None:
    path, written, broken, test = mutant
    for folder in ("faultloop", "tests"):
        shutil.copytree(root / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(root / "pyproject.toml", tmp_path)
    source = (tmp_path / path).read_text(encoding="utf-8")
    assert source.count(written) == 1
    (tmp_path / path).write_text(source.replace(written, broken), encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "FAULTLOOP_CACHE": str(tmp_path / "cache")}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", HERE + test]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stdout + done.stderr  # 0: not seen; above 1: not run
