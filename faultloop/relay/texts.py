"""Lines for a person: which bits changed."""

from __future__ import annotations

from faultloop.relay.layout import Instance

Words = tuple[int, int]


def change_texts(
    instances: tuple[Instance, ...], bits: tuple[str, ...], before: Words, now: Words
) -> list[str]:
    """Lines for the functions whose start or operate changed.  (Direction and phase selection are in the
    bits, and in a start's line.)"""
    lines = []
    on = frozenset(name for place, name in enumerate(bits) if now[0] >> place & 1)
    for instance in instances:
        if not instance.function.told:
            continue
        for place, name in enumerate(instance.bits, instance.bit):
            for kind, data in enumerate(("Str", "Op")):
                was, is_on = before[kind] >> place & 1, now[kind] >> place & 1
                if was != is_on:
                    detail = "reset" if not is_on else instance.function.detail(on)
                    # a name with a dot is whole: a signal is there, which is no start
                    said = name.replace(".", " ") if "." in name and kind == 0 else f"{name} {data}"
                    lines.append(" ".join(f"{said} {detail}".split()))
    return lines
