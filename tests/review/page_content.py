"""What a page's data come to, taken apart by NumPy and not by the page's own script."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np


def numbers(text: str, kind: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), kind)


def drawn(relay: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) [ms] and samples (n, 6) [V, A]."""
    waves = []
    for greatest, text in relay["samples"]:
        counts = numbers(text, "<i2").astype(float)
        counts[counts == -(2**15)] = np.nan
        waves.append(counts * greatest / 32767)
    return numbers(relay["t"], "<f8"), np.stack(waves, axis=1)


def estimates(relay: dict[str, Any], key: str) -> np.ndarray:
    """Complex (n, 6)."""
    pairs = numbers(relay[key], "<f4").astype(np.float64)
    return pairs.view(np.complex128).reshape(-1, 6)
