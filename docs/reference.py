"""Writes docs/reference.md from the code: signatures, and the first line of what each says of itself.

python docs/reference.py            # writes it anew
"""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

PAGE = Path(__file__).with_name("reference.md")
HEAD = """# Reference

Made from the code by `python docs/reference.py`, and held to it by a test. Conventions of time, units and
order are in docs/interfaces.md.
"""
MODULES: dict[str, dict[str, str]] = {
    "faultloop": {
        "faultloop.loop.runner": "run",
        "faultloop.loop.replay": "replay ReplayResult",
        "faultloop.loop.result": "Result Verdict",
        "faultloop.loop.scenario": "load_scenario",
        "faultloop.relay.settings": "load_settings RelaySettings",
        "faultloop.study.campaign": "Campaign",
        "faultloop.study.campaign.run": "Summary",
        "faultloop.errors": "InputError",
    },
    "plant": {"faultloop.plant.plant": "Plant Change", "faultloop.plant.component": "Component"},
    "relay": {
        "faultloop.relay.relay": "Relay RelayInputs Outputs",
        "faultloop.relay.events": "Event Trip",
        "faultloop.relay.functions.function": "Function",
        "faultloop.relay.layout": "instances Instance",
        "faultloop.config.user_code": "load",
    },
    "estimators": {
        "faultloop.relay.estimators.base": "Estimator run_estimator",
        "faultloop.relay.estimators.registry": (
            "make_estimator estimator_methods estimator_parameters register"
        ),
    },
    "nodes": {"faultloop.nodes.clock": "SampleClock", "faultloop.nodes.block": "RelayBlock"},
    "loop": {
        "faultloop.loop.outcome": "Outcome TripReport FaultChange EventText Position Fold Cast outcome_of",
        "faultloop.loop.case": "Cases Prepared CaseOutcome",
        "faultloop.loop.recording": "MemorySink",
    },
    "io": {
        "faultloop.io.mcap_writer": "LogWriter",
        "faultloop.io.mcap_reader": "open_log Log Entry",
        "faultloop.io.messages": "values",
        "faultloop.io.diff": "diff_logs Diff FieldDifference",
        "faultloop.io.recover": "recover_log Recovered",
        "faultloop.io.tables": "write_parquet write_csv",
        "faultloop.io.rerun_sink": "RerunSink log_to_rerun",
        "faultloop.io.comtrade.read": "read_comtrade",
        "faultloop.io.comtrade.record": "Record AnalogChannel StatusChannel",
        "faultloop.io.comtrade.write": "write_comtrade",
    },
    "io: CAN": {
        "faultloop.io.can.frames": "Frame State SampledValues Measurements Heartbeat decode",
        "faultloop.nodes.goose": "Publisher Subscriber",
        "faultloop.io.can.bus": "SimulatedBus",
        "faultloop.io.can.transport": "Transport open_transport open_bus",
        "faultloop.io.can.confinement": "Controller ErrorSource",
        "faultloop.io.can.faults": "SenderFaults",
        "faultloop.io.can.senders": "Senders",
    },
    "live": {
        "faultloop.live.supervisor": "Supervisor run_processes",
        "faultloop.io.can.socketcan": "open_link",
        "faultloop.live.merge": "merge",
    },
}


def reference() -> str:
    """The page."""
    lines = [HEAD]
    for title, modules in MODULES.items():
        lines.append(f"## {title}\n")
        for module, names in modules.items():
            lines.append(f"`{module}`\n")
            for name in names.split():
                lines += _entry(name, getattr(importlib.import_module(module), name))
            lines.append("")
    return "\n".join(lines).rstrip() + "\n"


def _entry(name: str, thing: Any) -> Iterator[str]:
    if not inspect.isclass(thing):
        yield f"- `{name}{_signature(thing)}`{_first(thing)}"
        return
    fields = _fields(thing)
    made = _signature(thing) if fields is None else f"({', '.join(fields)})"
    yield f"- `{name}{made}`{_first(thing)}"
    for own, member in vars(thing).items():
        if own.startswith(("_", "model_")) or (fields is not None and own in fields):
            continue
        function = inspect.unwrap(getattr(member, "__func__", member))
        if isinstance(member, property):
            yield f"  - `.{own}`{_first(member.fget)}"
        elif inspect.isfunction(function):
            yield f"  - `.{own}{_signature(function)}`{_first(function)}"


def _fields(thing: Any) -> list[str] | None:
    if dataclasses.is_dataclass(thing):
        return [field.name for field in dataclasses.fields(thing) if not field.name.startswith("_")]
    if hasattr(thing, "_fields"):
        return list(thing._fields)
    models = getattr(thing, "model_fields", None)
    return None if models is None else list(models)


def _signature(thing: Any) -> str:
    """Names and defaults; types are in the code."""
    parts = []
    star = False
    for parameter in inspect.signature(thing).parameters.values():
        if parameter.name in ("self", "cls"):
            continue
        if parameter.kind is parameter.KEYWORD_ONLY and not star:
            parts.append("*")
            star = True
        mark = {parameter.VAR_POSITIONAL: "*", parameter.VAR_KEYWORD: "**"}.get(parameter.kind, "")
        star = star or mark == "*"
        default = "" if parameter.default is parameter.empty else f"={_default(parameter.default)}"
        parts.append(f"{mark}{parameter.name}{default}")
    return f"({', '.join(parts)})"


def _default(value: Any) -> str:
    text = repr(value)
    return text if not re.search(r"0x|<|/", text) else "..."


def _first(thing: Any) -> str:
    """The first sentence of its docstring, on one line."""
    text = inspect.getdoc(thing) or ""
    paragraph = " ".join(text.partition("\n\n")[0].split())
    return f": {paragraph}" if paragraph else ""


if __name__ == "__main__":
    PAGE.write_text(reference(), encoding="utf-8")
