"""A component that is not the package's own, from a file to the relay's samples (docs/how-to-add.md)."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import faultloop
from faultloop.errors import InputError
from faultloop.loop.scenario import AnyScenario
from faultloop.plant import Plant
from faultloop.plant.component import with_components
from faultloop.plant.components import COMPONENTS
from tests.examples import scenario
from tests.plant.record import record
from tests.plant.reference import network, phasors

OHM = 500.0


@pytest.fixture(scope="module")
def model(root: Path, tmp_path_factory: pytest.TempPathFactory) -> type[AnyScenario]:
    """A scenario with the component that the documentation shows, in a file of its own."""
    text = (root / "docs/how-to-add.md").read_text(encoding="utf-8")
    file = tmp_path_factory.mktemp("component") / "shown_resistor.py"
    file.write_text(re.findall(r"```python\n(.*?)```", text, re.DOTALL)[0], encoding="utf-8")
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None and spec.loader is not None
    module = sys.modules[file.stem] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return with_components(AnyScenario, (*COMPONENTS, module.Resistor), "MyScenario")


def radial(**tables: Any) -> dict[str, Any]:
    """One source, so that a load at the far bus is the only current."""
    data = network("rl", **tables)
    return data | {"source": data["source"][:1]}


def test_it_carries_its_current(model: type[AnyScenario]) -> None:
    data = radial(resistor=[{"name": "R", "bus": "B", "ohm": OHM}])
    x, _ = record(Plant(model.from_dict(data)), 960)
    v, i = phasors(x, 0, 4800)[1, :3], -phasors(x, 0, 4800)[1, 3:]
    assert np.abs(v / i / OHM - 1).max() < 1e-6
    assert np.abs(x[:96] - x[-96:]).max() < 1e-9 * np.abs(x).max(), "the run starts in its steady state"


@pytest.mark.parametrize(
    ("item", "message"),
    [
        ({"name": "R", "bus": "C", "ohm": 1.0}, r"resistor\[R\].bus: there is no bus 'C'"),
        ({"name": "R", "bus": "B", "ohm": 0.0}, r"resistor\[R\].ohm: input should be greater than 0"),
        ({"name": "R", "bus": "B", "ohms": 1.0}, r"resistor\[R\].ohms: unknown key; did you mean 'ohm'"),
    ],
)
def test_wrong_input_is_told_as_the_packages_own_is(
    model: type[AnyScenario], item: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        model.from_dict(radial(resistor=[item]))


def test_it_runs_in_the_closed_loop(model: type[AnyScenario], root: Path, tmp_path: Path) -> None:
    """With its table in the log's metadata, from where the run can be had again."""
    data = scenario(resistor=[{"name": "R", "bus": "B", "ohm": OHM}])
    path = root / "scenarios" / "with-a-resistor.toml"
    result = faultloop.run(model.from_dict(data, path=path), log=tmp_path / "run.mcap")
    assert [trip.relay for trip in result.trips]
    log = faultloop.open_log(tmp_path / "run.mcap")
    assert '"resistor":[{"name":"R","bus":"B","ohm":500.0}]' in log.metadata["scenario"]["json"]
