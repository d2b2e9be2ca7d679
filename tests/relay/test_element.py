"""A user's own functions: the documented ones, compiled and as plain Python; when they are called."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from faultloop import jit
from faultloop.errors import InputError
from faultloop.relay import Relay, RelaySettings, load_settings
from tests.relay.network import Network, play, settings_dict

NETWORK = Network()


def blocks(root: Path, language: str) -> list[str]:
    text = (root / "docs" / "relay.md").read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def with_element(folder: Path, source: str, element: str) -> RelaySettings:
    (folder / "stub.py").write_text(source, encoding="utf-8")
    data = settings_dict(NETWORK, [{"zone": 1, "reach_pu": 0.4}]) | tomllib.loads(element)
    return RelaySettings.from_dict(data, path=folder / "relay.toml")


def test_the_documented_settings_are_valid(root: Path, tmp_path: Path) -> None:
    path = tmp_path / "relay.toml"
    path.write_text(blocks(root, "toml")[0], encoding="utf-8")
    relay = Relay(load_settings(path))
    assert relay.settings.z1_ohm == pytest.approx(3 + 30j)
    assert list(relay.characteristics()) == ["PDIS1", "PDIS2"]


@pytest.mark.parametrize("compiled", [True, False])
def test_the_documented_element_trips(root: Path, tmp_path: Path, compiled: bool) -> None:
    source, element = blocks(root, "python")[0], blocks(root, "toml")[1]
    if not compiled:
        source = source.replace("@njit", "")
    relay = Relay(with_element(tmp_path, source, element))
    assert relay.bits[-1] == "PTOC1"
    events = play(relay, NETWORK.fault("AG", 0.9, duration_s=0.3), block=100)
    start = next(e.sample_count for e in events if e.text == "PTOC1 Str")
    trip = next(e for e in events if e.trip)
    assert (trip.trip.function, trip.trip.zone, trip.trip.loop, trip.trip.poles) == ("PTOC1", 0, "AG", 7)
    assert trip.sample_count - start == 480
    assert not any("PDIS1" in e.text for e in events)


@pytest.mark.parametrize(
    ("function", "words"),
    [
        ("nowhere.py:step", "no such file"),
        ("stub.py:stop", "did you mean 'step'"),
        ("faultloop.nowhere:step", "cannot be imported"),
        ("stub.py:broken", "does not compile"),
    ],
)
def test_a_wrong_element_is_named(tmp_path: Path, function: str, words: str) -> None:
    source = (
        "from numba import njit\n\n\ndef step(state, x, out):\n    pass\n\n\n"
        "@njit\ndef broken(state, x, out):\n    out[0] = unknown\n"
    )
    element = f'[[element]]\nname = "MINE"\nfunction = "{function}"\n'
    with pytest.raises(InputError, match=words) as error:
        Relay(with_element(tmp_path, source, element))
    assert error.value.key == "element[MINE].function"


def test_python_and_compiled_give_the_same_bits(root: Path, tmp_path: Path) -> None:
    source, element = blocks(root, "python")[0], blocks(root, "toml")[1].replace("trip = true", "")
    words = []
    for text in (source, source.replace("@njit", "")):
        relay = Relay(with_element(tmp_path, text, element))
        relay.advance(NETWORK.fault("BG", 0.9, duration_s=0.3))
        words.append((relay.pickup.copy(), relay.operate.copy()))
    assert all(np.array_equal(a, b) for a, b in zip(*words, strict=True))
    assert int(words[0][1][-1]) >> (len(relay.bits) - 1) == 1


@pytest.fixture
def own_function(root: Path, tmp_path: Path) -> Path:
    """The function that docs/how-to-add.md shows, as a file beside the settings."""
    text = (root / "docs" / "how-to-add.md").read_text(encoding="utf-8")
    found = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    (tmp_path / "ptov.py").write_text(next(t for t in found if "PTOV = Function" in t), encoding="utf-8")
    return tmp_path


def ptov(folder: Path, **keys: object) -> RelaySettings:
    element = {"name": "PTOV1", "function": "ptov.py:PTOV", "start_v": 20e3, "delay_ms": 50.0} | keys
    zones = [{"zone": 1, "reach_pu": 0.4}]
    return RelaySettings.from_dict(
        settings_dict(NETWORK, zones) | {"element": [element]}, path=folder / "relay.toml"
    )


@pytest.mark.parametrize("compiled", [True, False])
def test_a_function_with_named_parameters_trips(own_function: Path, compiled: bool) -> None:
    file = own_function / "ptov.py"
    if not compiled:
        file.write_text(file.read_text(encoding="utf-8").replace("@njit\n", ""), encoding="utf-8")
    relay = Relay(ptov(own_function))
    assert relay.bits[-1] == "PTOV1"
    events = play(relay, NETWORK.fault("AG", 0.9, duration_s=0.3), block=100)
    start = next(e.sample_count for e in events if e.text == "PTOV1 Str")
    trip = next(e for e in events if e.trip)
    assert (trip.trip.function, trip.trip.zone, trip.trip.loop, trip.trip.poles) == ("PTOV1", 0, "AG", 7)
    assert trip.sample_count - start == 240


@pytest.mark.parametrize(
    ("keys", "key", "words"),
    [
        ({"start_v": -1.0}, "start_v", "greater than 0"),
        ({"delay": 3.0}, "delay", "did you mean 'delay_ms'?"),
        ({"state": [0.0]}, "state", "state of its own"),
        ({"function": "ptov.py:Ptov2"}, "function", "did you mean 'Ptov'"),
        ({"function": "nowhere"}, "function", "no installed package brings 'nowhere'"),
    ],
)
def test_a_wrong_parameter_is_named(own_function: Path, keys: dict, key: str, words: str) -> None:
    with pytest.raises(InputError, match=re.escape(words)) as error:
        Relay(ptov(own_function, **keys))
    assert error.value.key == f"element[PTOV1].{key}"
    assert error.value.file == str(own_function / "relay.toml")


def test_a_plain_step_has_no_parameters(root: Path, tmp_path: Path) -> None:
    element = blocks(root, "toml")[1].replace("trip = true", "trop = true")
    with pytest.raises(InputError, match="did you mean 'trip'") as error:
        Relay(with_element(tmp_path, blocks(root, "python")[0], element))
    assert error.value.key == "element[PTOC1].trop"


MINE = '[[element]]\nname = "MINE"\nfunction = "stub.py:step"\n'
STEP = "def step(state, x, out):\n    "


@pytest.mark.parametrize(
    ("source", "words"),
    [
        (f"{STEP}raise RuntimeError('too hot')\n", "RuntimeError: too hot"),
        (f"{STEP}raise SystemExit(3)\n", "SystemExit: 3"),
        (f"from numba import njit\n@njit\n{STEP}raise ValueError('hot')\n", "its compiled code raises"),
    ],
)
def test_what_a_step_raises_names_the_element(tmp_path: Path, source: str, words: str) -> None:
    relay = Relay(with_element(tmp_path, source, MINE))
    with pytest.raises(InputError, match=f"failed near sample 0: .*{words}") as error:
        relay.advance(NETWORK.fault("AG", 0.9))
    assert error.value.key == "element[MINE].function"


def test_ctrl_c_in_a_step_is_one(tmp_path: Path) -> None:
    relay = Relay(with_element(tmp_path, f"{STEP}raise KeyboardInterrupt\n", MINE))
    with pytest.raises(KeyboardInterrupt):
        relay.advance(NETWORK.fault("AG", 0.9))


OWN = """
from faultloop.config.tables import Table
from faultloop.relay.functions.function import Function
class Own(Table):
    pass
step = Function("OWN", Own, lambda g, q, c, w: None, values=lambda settings, table: {"nothing": 1})
"""


@pytest.mark.parametrize(
    ("source", "words"), [("raise SystemExit", "cannot be run"), (OWN, "the values of 'OWN' are none")]
)
def test_a_file_that_is_none_is_named(tmp_path: Path, source: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        Relay(with_element(tmp_path, source, MINE))


@pytest.mark.parametrize("method", ["fourier", "kalman-bank", "m-class"])
def test_it_is_not_called_before_the_estimator_has_settled(tmp_path: Path, method: str) -> None:
    """The first call is that of the first sample after the settling."""
    source = "def step(state, x, out):\n    state[0] += 1\n    out[0] = 1\n"
    element = '[[element]]\nname = "MINE"\nfunction = "stub.py:step"\nstate = [0.0]\n'
    settings = with_element(tmp_path, source, f'{element}[estimator]\nmethod = "{method}"\nunsafe = true\n')
    relay = Relay(settings)
    samples = NETWORK.samples([(0.0, NETWORK.solve())], 0.3)
    place = len(relay.bits) - 1
    on: list[int] = []
    while len(on) < len(samples):  # a notice ends a block
        relay.advance(samples[len(on) :])
        on += [int(word) >> place & 1 for word in relay.pickup]
    settling = relay.estimator.settling_samples
    assert on == [0] * settling + [1] * (len(samples) - settling)


def test_save_and_restore_hold_a_users_state(own_function: Path) -> None:
    relay, x = Relay(ptov(own_function)), NETWORK.fault("AG", 0.9, duration_s=0.3)
    relay.advance(x[:600])
    saved = relay.save()
    once = [(e.sample_count, e.text) for e in play(relay, x[600:])]
    relay.restore(saved)
    assert [(e.sample_count, e.text) for e in play(relay, x[600:])] == once
    assert any("PTRC1" in text for _, text in once)


def test_it_is_told_by_an_entry_point(own_function: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As an installed package registers it."""
    package = own_function / "package"
    info = package / "residual-1.0.dist-info"
    info.mkdir(parents=True)
    (package / "residual.py").write_text((own_function / "ptov.py").read_text(encoding="utf-8"))
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: residual\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[faultloop.functions]\nresidual-voltage = residual:PTOV\n")
    monkeypatch.syspath_prepend(str(package))
    relay = Relay(ptov(own_function, function="residual-voltage"))
    events = play(relay, NETWORK.fault("AG", 0.9, duration_s=0.3), block=100)
    assert any(e.trip and e.trip.function == "PTOV1" for e in events)
    with pytest.raises(InputError, match="did you mean 'residual-voltage'"):
        Relay(ptov(own_function, function="residual-voltages"))


ESTIMATOR = """
import numpy as np
from numba import njit
from faultloop.relay.estimators import Estimator, make_estimator

def make(sampling_hz, frequency_hz, *, gain=1.0):
    inner = make_estimator("fourier", sampling_hz, frequency_hz)
    run = inner.step

    @njit
    def step(state, x, out):
        run(state, x, out)
        for k in range(12):
            out[k] *= gain

    return Estimator("mine", step, inner.state, inner.settling_samples)
"""


def test_an_estimator_from_a_file_is_compiled_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second relay, as in another process, takes the machine code from the cache; another gain not."""
    monkeypatch.setattr(jit, "cache_root", lambda: tmp_path / "cache")
    (tmp_path / "mine.py").write_text(ESTIMATOR, encoding="utf-8")
    samples = NETWORK.samples([(0.0, NETWORK.solve())], 0.1)

    def files_after(gain: float) -> tuple[set[Path], complex]:
        data = settings_dict(NETWORK, [], estimator={"method": "mine.py:make", "gain": gain})
        relay = Relay(RelaySettings.from_dict(data, path=tmp_path / "relay.toml"))
        relay.advance(samples)
        return set((tmp_path / "cache").rglob("*.nb?")), complex(*relay.phasors[-1, :2])

    first, once = files_after(1.0)
    again, _ = files_after(1.0)
    more, twice = files_after(2.0)
    assert any("step_" in file.name for file in first)
    assert again == first
    assert more > first
    assert twice == pytest.approx(2 * once)


@pytest.mark.parametrize(
    ("method", "key", "words"),
    [
        ("mine.py:made", "estimator.method", "did you mean 'make'"),
        ("nowhere.py:make", "estimator.method", "no such file"),
        ("mine.py:np", "estimator.method", "is no function make"),
    ],
)
def test_a_wrong_estimator_from_a_file_is_named(tmp_path: Path, method: str, key: str, words: str) -> None:
    (tmp_path / "mine.py").write_text(ESTIMATOR, encoding="utf-8")
    data = settings_dict(NETWORK, [], estimator={"method": method})
    with pytest.raises(InputError, match=re.escape(words)) as error:
        Relay(RelaySettings.from_dict(data, path=tmp_path / "relay.toml"))
    assert error.value.key == key
