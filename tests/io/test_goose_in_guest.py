"""GOOSE and Sampled Values by AF_PACKET in the tests' guest, too."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.vcan import needs_vcan, passes_on_vcan


@needs_vcan
@pytest.mark.slow
def test_over_a_pair_of_the_guests_kernel(root: Path) -> None:
    """What `test_goose_link.py` asks of this machine's kernel, of the one that the tests' guest has."""
    passes_on_vcan(root, Path(__file__).with_name("test_goose_link.py"), 600)
