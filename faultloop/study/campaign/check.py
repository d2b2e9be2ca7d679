"""What can be known to be wrong with a campaign before its first case is run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from faultloop.config.campaign import Judge
from faultloop.errors import InputError, nearest
from faultloop.relay import RelaySettings
from faultloop.relay.layout import instances
from faultloop.relay.named_code import named_code
from faultloop.relay.relay import estimator_of
from faultloop.study.campaign.plan import Case, Plan
from faultloop.study.campaign.where import where_of

LOOKED_AT, PASSED_OVER = 2000, 50_000
"""Cases that a judge must apply to one of: places of a fault, and how many cases they are looked for in."""
OTHERS = 20
"""Cases in which a value is tried before it counts as impossible by itself."""
WITHOUT_PLACE = ("type", "angle_deg", "resistance_ohm", "ground_ohm", "duration_s")
"""Of a fault: what does not decide where it is."""


def check_plan(plan: Plan) -> None:
    """Raises InputError for a value that makes every case impossible, and for a judge that never applies or
    can never hold.
    """
    estimators = Estimators()
    try:
        try:
            base = plan.first
        except InputError:
            _check_ends(plan, plan.values(0), estimators)  # which explains more than one case does
            raise
        _check_ends(plan, base.values, estimators)
        estimators.check(base)
        _check_judges(plan, base)
    except InputError as error:
        raise error.within(plan.file) from None


class Estimators:
    """Makes each that a campaign has once, to see whether it can be made: nothing else here takes so long.

    Not those of the user's own: their code is not run before the first case.
    """

    def __init__(self) -> None:
        self._made: set[str] = set()

    def check(self, case: Case) -> None:
        """Raises InputError."""
        for settings in case.settings.values():
            own, estimator = settings.relay, settings.estimator
            told = repr((own.sampling_hz, own.frequency_hz, estimator))
            if told not in self._made and not any(named_code(settings)):
                estimator_of(settings)
                self._made.add(told)


def _check_ends(plan: Plan, base: Mapping[str, Any], estimators: Estimators) -> None:
    """Of the values that make every case impossible, that one is told without which a case is possible."""
    found: InputError | None = None
    for place in range(len(plan.tables.vary)):
        for value in plan.draws.ends(place):
            own = plan.draws.keyed(place, value)
            error = _objection(plan, dict(base) | own, estimators)
            others = (_objection(plan, other | own, estimators) for other in _some(plan))
            if error is None or None in others:
                continue
            plan.made(0, {})  # where a file is wrong by itself, that is told
            told = ", ".join(f"{key} = {own[key]!r}" for key in own)
            where = f"vary[{place}]" if error.key is None else f"vary[{place}]: {error.key}"
            objection = InputError(f"{told} is impossible: {error.what}", file=plan.file, key=where)
            if _is_possible(plan, {key: other for key, other in base.items() if key not in own}):
                raise objection from None
            found = found or objection
    if found is not None:
        raise found


def _is_possible(plan: Plan, values: Mapping[str, Any]) -> bool:
    try:
        plan.made(0, values)
    except InputError:
        return False
    return True


def _objection(plan: Plan, values: Mapping[str, Any], estimators: Estimators) -> InputError | None:
    try:
        if all(condition.holds(values) for condition in plan.conditions):
            estimators.check(plan.made(0, values))
    except InputError as error:
        return error
    return None


def _some(plan: Plan) -> Iterable[dict[str, Any]]:
    """Values of cases; of few drawn ones also of more that might have been drawn."""
    drawn = plan.draws.sampling != "grid"
    count = max(plan.cases, OTHERS) if drawn else plan.cases
    for number in range(0, count, max(count // OTHERS, 1)):
        try:
            yield plan.values(number)
        except InputError:
            continue


def _check_judges(plan: Plan, base: Case) -> None:
    for number, judge in enumerate(plan.tables.judge):
        where = f"judge[{number}]"
        if judge.relay not in base.settings:
            what = f"there is no relay '{judge.relay}'; {nearest(judge.relay, base.settings)}"
            raise InputError(what, key=f"{where}.relay")
        after, within = judge.after_ms, judge.within_ms
        if after is not None and within is not None and after > within:
            what = f"can never hold: a trip within {within:g} ms is before {after:g} ms"
            raise InputError(what, key=f"{where}.after_ms")
        _check_names(judge, _settings_of(plan, base, judge.relay), where)
    wanted, looked_at = _never_met(plan)
    for (relay, where), number in wanted.items():
        seen = "absent" if where == "none" else where
        raise InputError(
            f"can never apply: in none of {looked_at} cases is a fault {seen} for relay '{relay}'",
            key=f"judge[{number}].where",
        )


def _check_names(judge: Judge, settings: list[RelaySettings], where: str) -> None:
    """That there is a function, a zone that it wants, in any of the settings that the relay may have."""
    zones: dict[str, int | None] = {}
    for one in settings:
        zones |= {name: getattr(table, "zone", None) for name, table in _functions(one)}
    if judge.function is not None and judge.function not in zones:
        what = f"relay '{judge.relay}' has no function '{judge.function}'"
        raise InputError(f"{what}; {nearest(judge.function, zones)}", key=f"{where}.function")
    known = sorted({zone for zone in zones.values() if zone is not None})
    if judge.zone is not None and judge.zone not in known:
        what = f"relay '{judge.relay}' has no zone {judge.zone}; known: {', '.join(map(str, known))}"
        raise InputError(what, key=f"{where}.zone")


def _settings_of(plan: Plan, base: Case, relay: str) -> list[RelaySettings]:
    """Those of the relay in the first case, and with each of the values that are varied of them."""
    found = [base.settings[relay]]
    for place, vary in enumerate(plan.tables.vary):
        if any(key.startswith(f"relay.{relay}.") for key in vary.all_keys):
            for value in plan.draws.ends(place):
                try:
                    case = plan.made(0, dict(base.values) | plan.draws.keyed(place, value))
                except InputError:  # will be a row with its error
                    continue
                found.append(case.settings[relay])
    return found


def _functions(settings: RelaySettings) -> list[tuple[str, Any]]:
    """Names of what can trip, and their tables."""
    own = [(instance.name, instance.table) for instance in instances(settings) if instance.name != "PTRC1"]
    return [*own, *((element.name, None) for element in settings.element)]


def _never_met(plan: Plan) -> tuple[dict[tuple[str, str], int], int]:
    """Where a judge wants a fault, seen from its relay, and no case has one, with the judge's number; and in
    how many cases it was looked for.
    """
    wanted = {
        (judge.relay, judge.where): number
        for number, judge in reversed(list(enumerate(plan.tables.judge)))
        if judge.where is not None
    }
    keys = [key for key in plan.keys if _places(key)]
    seen: set[str] = set()
    looked_at = 0
    for number in range(0, plan.cases, max(plan.cases // PASSED_OVER, 1)):
        if not wanted or len(seen) >= LOOKED_AT:
            break
        looked_at += 1
        try:
            values = plan.values(number)
            place = repr([values[key] for key in keys])
            if place in seen:
                continue
            seen.add(place)
            case = plan.made(number, values)
        except InputError:  # will be a row with its error
            continue
        for relay in case.scenario.relay:
            wanted.pop((relay.name, where_of(case.scenario, relay)), None)
    return wanted, looked_at


def _places(key: str) -> bool:
    """Whether it may decide where a fault is."""
    table, *_, name = key.split(".")
    return table in ("line", "relay") or (table == "fault" and name not in WITHOUT_PLACE)
