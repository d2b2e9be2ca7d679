"""What CRC-8 and the checks behind it leave of a plain frame's errors: every pattern of up to four bits."""

from __future__ import annotations

from itertools import combinations
from math import comb

from faultloop.io.can.e2e import crc8_p01
from faultloop.io.can.frames import State, decode
from faultloop.io.can.table import Kind
from faultloop.nodes.goose import MS, Subscriber
from faultloop.study.report import Check, Table

_BITS = 64
_NOW_NS = 300_000 * MS


def _syndromes() -> list[int]:
    """What one wrong bit does to the check: CRC-8 is linear, so those of several bits are their XOR."""
    clean = crc8_p01(Kind.TRIP, bytes(8))
    syndromes = []
    for bit in range(_BITS):
        data = (1 << bit).to_bytes(8, "little")
        syndromes.append(crc8_p01(Kind.TRIP, data) ^ clean ^ data[0])
    return syndromes


def undetected(bits: int) -> list[tuple[int, ...]]:
    """Every pattern of that many wrong bits that CRC-8 does not see."""
    syndromes = _syndromes()
    by_syndrome: dict[int, list[int]] = {}
    for bit, syndrome in enumerate(syndromes):
        by_syndrome.setdefault(syndrome, []).append(bit)
    found = []
    for chosen in combinations(range(_BITS), bits - 1):
        rest = 0
        for bit in chosen:
            rest ^= syndromes[bit]
        found += [(*chosen, last) for last in by_syndrome.get(rest, ()) if last > chosen[-1]]
    return found


def undetected_bursts() -> list[tuple[int, ...]]:
    """Patterns within 8 consecutive bits, in the order of transmission, that CRC-8 does not see.

    There would be none if the CRC came last; profile 1 has it first, so a burst over bytes 0 and 1 is two.
    """
    sent = [8 * (k // 8) + 7 - k % 8 for k in range(_BITS)]  # most significant bit of each byte first
    syndromes = _syndromes()
    found = []
    for first in range(_BITS):
        for tail in range(1 << min(7, _BITS - 1 - first)):
            pattern = (sent[first], *(sent[first + 1 + k] for k in range(7) if tail >> k & 1))
            rest = 0
            for bit in pattern:
                rest ^= syndromes[bit]
            if rest == 0:
                found.append(pattern)
    return found


def operating(patterns: list[tuple[int, ...]], st_num: int) -> int:
    """How many of them make a trip of an idle relay's repetition under `st_num` that is taken at once."""
    idle = State(Kind.TRIP, 0, 0, st_num, 40, 10, _NOW_NS // 10_000 - 50_000)
    subscriber = Subscriber()
    subscriber.receive(idle, _NOW_NS - 500 * MS)
    genuine = idle._replace(sq_num=41, counter=11, time=_NOW_NS // 10_000)
    frame = genuine.encode()
    whole = int.from_bytes(frame.data, "little")
    count = 0
    for pattern in patterns:
        wrong = whole
        for bit in pattern:
            wrong ^= 1 << bit
        message = decode(frame._replace(data=wrong.to_bytes(8, "little")))
        if isinstance(message, State) and message.poles:
            count += subscriber.copied().receive(message, _NOW_NS) is True
    return count


def residual_table() -> Table:
    """Patterns of wrong bits in a fresh frame that a plain breaker would act upon."""
    rows = []
    for bits in range(1, 5):
        patterns = undetected(bits) if bits > 1 else []
        rows.append(_row(str(bits), comb(_BITS, bits), patterns))
    bursts = sum(1 << min(7, _BITS - 1 - first) for first in range(_BITS))
    rows.append(_row("burst of up to 8", bursts, undetected_bursts()))
    return Table(
        "Bits wrong in a plain trip frame, behind CAN's own CRC: every pattern",
        ("bits", ">patterns", ">CRC-8 does not see", ">trip (even st_num)", ">trip (odd)", ">share"),
        rows,
    )


def _row(what: str, total: int, patterns: list[tuple[int, ...]]) -> tuple[object, ...]:
    acts = [operating(patterns, st_num) for st_num in (2, 3)]
    return (what, total, len(patterns), *acts, sum(acts) / 2 / total)


def residual_checks() -> list[Check]:
    """What holds for every pattern, whatever the frame."""
    # One more in st_num flips 1, 2, 3 or 4 of its bits under these; under others more than a pattern has.
    patterns = [*undetected(3), *undetected_bursts()]
    fatal = sum(operating(patterns, st_num) for st_num in (0, 1, 3, 7))
    return [
        Check("patterns of two bits that CRC-8 does not see", len(undetected(2)), 0),
        Check("patterns of three bits, and bursts of up to 8, that trip", fatal, 0),
    ]
