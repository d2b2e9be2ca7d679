"""The process bus of IEC 61850: GOOSE (8-1) and Sampled Values (9-2, IEC 61869-9).

The encodings are those of the package ``open61850`` (extra ``faultloop[iec61850]``), which is imported when
the first message is made or read.
"""

from __future__ import annotations

from faultloop.errors import InputError


def require(key: str | None = None) -> None:
    """InputError where the extra is not installed."""
    try:
        import open61850  # noqa: F401
    except ImportError:
        raise InputError(
            "GOOSE and Sampled Values need open61850: pip install 'faultloop[iec61850]'", key=key
        ) from None
