"""A summary in secondary values: what the relay's own terminals had, by the ratios of its settings."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from faultloop.errors import InputError
from faultloop.io.mcap_reader import Log
from faultloop.io.messages import CHANNELS
from faultloop.review.facts import PhasorFacts, RelayFacts, Summary
from faultloop.review.relay_summary import ratios


def secondary(log: Log, summary: Summary) -> Summary:
    """Phasors, impedances and peaks of each relay that names ``ct_ratio`` and ``vt_ratio``, over them.

    Raises InputError where no relay names any.
    """
    known = {name: ratios(log, name) for name in summary.relays}
    if not any(known.values()):
        what = "no relay's settings name ct_ratio and vt_ratio: there are no secondary values"
        raise InputError(what, file=log.path, key="--secondary")
    relays = {
        name: own if (pair := known[name]) is None else _scaled(own, *pair)
        for name, own in summary.relays.items()
    }
    return replace(summary, relays=relays)


def _scaled(own: RelayFacts, ct: float, vt: float) -> RelayFacts:
    ohms = {
        key: value and _ohms(value, ct / vt)
        for key, value in (("loop", own.loop), ("load_ohm", own.load_ohm))
    }
    peaks = {
        name: peak
        and replace(
            peak, instantaneous=peak.instantaneous / ct, rms=None if peak.rms is None else peak.rms / ct
        )
        for name, peak in own.peak_current.items()
    }
    phasors = {key: _phasors(getattr(own, key), ct, vt) for key in ("prefault", "fault")}
    return replace(own, peak_current=peaks, **ohms, **phasors)


def _ohms(value: Any, factor: float) -> Any:
    keys = ("r_ohm", "x_ohm", "magnitude_ohm")
    return replace(value, **{key: getattr(value, key) * factor for key in keys})


def _phasors(at: PhasorFacts | None, ct: float, vt: float) -> PhasorFacts | None:
    if at is None:
        return None
    over = {name: vt if name[0] == "v" else ct for name in CHANNELS}
    return replace(
        at, **{name: replace(at[name], magnitude=at[name].magnitude / over[name]) for name in CHANNELS}
    )
