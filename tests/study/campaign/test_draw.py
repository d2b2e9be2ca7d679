"""What cases draw: from seed, case number and place only, and from the right distributions."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from faultloop.config.campaign import Vary
from faultloop.study.campaign.draw import Draws, uniforms

KEY = "fault.F1.at_pu"


def draws(sampling: str = "random", seed: int = 1, **vary: object) -> Draws:
    return Draws([Vary.model_validate({"key": KEY} | vary)], seed, sampling)


def drawn(count: int, **vary: object) -> np.ndarray:
    made = draws(**vary)
    return np.array([made.at(case)[KEY] for case in range(count)])


def test_a_draw_depends_on_seed_case_and_place_only() -> None:
    both = [Vary(key="a.x", uniform=(0, 1)), Vary(key="a.y", uniform=(0, 1))]
    alone = Draws(both[:1], 7, "random")
    together = Draws(both, 7, "random")
    for case in (5, 0, 10**9, 3):
        assert together.at(case)["a.x"] == alone.at(case)["a.x"]
    assert together.at(0)["a.x"] != together.at(0)["a.y"]
    assert Draws(both, 8, "random").at(0) != together.at(0)
    assert together.at(0, attempt=1) != together.at(0)


def test_draws_of_neighbours_are_independent() -> None:
    """Cases, places and attempts, each against the others: no correlation above chance (5 sigma)."""
    n = 4000
    table = np.array([[uniforms(1, case, 3, attempt) for attempt in range(2)] for case in range(n)])
    columns = table.reshape(n, 6).T
    rows = np.vstack([columns, columns[:, np.roll(np.arange(n), 1)]])
    correlation = np.corrcoef(rows)
    np.fill_diagonal(correlation, 0)
    assert np.abs(correlation).max() < 5 / np.sqrt(n)
    assert len(np.unique(columns)) == columns.size


def test_a_draw_is_philox_at_the_counter_of_its_case() -> None:
    """As numpy has it in a new generator, whatever was drawn before, by this thread or another."""
    asked = [(7, 10**8, 5, 0), (7, 0, 1, 3), (8, 1, 9, 999), (7, 2, 4, 0)]

    def drawn() -> list[list[float]]:
        return [uniforms(*one).tolist() for one in asked for _ in range(50)]

    with ThreadPoolExecutor(4) as pool:
        together = [task.result() for task in [pool.submit(drawn) for _ in range(8)]]
    expected = []
    for seed, case, places, attempt in asked:
        raw = np.random.Philox(key=seed, counter=((case << 64) | attempt) << 64).random_raw(places)
        expected.append(((raw >> np.uint64(11)) + 0.5) * 2.0**-53)
    for found in (drawn(), *together):
        assert all(np.array_equal(one, expected[place // 50]) for place, one in enumerate(found))


@pytest.mark.parametrize(
    ("vary", "mean", "deviation", "low", "high"),
    [
        ({"uniform": [2, 6]}, 4, 4 / np.sqrt(12), 2, 6),
        ({"log_uniform": [1, np.e]}, np.e - 1, np.sqrt((np.e**2 - 1) / 2 - (np.e - 1) ** 2), 1, np.e),
        ({"normal": [3, 0.5]}, 3, 0.5, -np.inf, np.inf),
        ({"values": [1, 2, 6]}, 3, np.sqrt(14 / 3), 1, 6),
        ({"range": [0, 1, 3]}, 0.5, np.sqrt(1 / 6), 0, 1),
    ],
)
@pytest.mark.parametrize("sampling", ["random", "sobol"])
def test_distributions(
    sampling: str, vary: dict[str, object], mean: float, deviation: float, low: float, high: float
) -> None:
    """Closed forms of mean and deviation; Sobol points come nearer to them than chance does."""
    n = 4096
    x = drawn(n, sampling=sampling, **vary)
    error = abs(x.mean() - mean) / (deviation / np.sqrt(n))
    assert error < (4 if sampling == "random" else 1)
    assert x.std() == pytest.approx(deviation, rel=0.05)
    assert low <= x.min() and x.max() <= high


def test_sobol_points_in_any_order() -> None:
    varied = [Vary(key="a.x", uniform=(0, 1)), Vary(key="a.y", uniform=(0, 1))]
    forward, backward = (Draws(varied, 3, "sobol") for _ in range(2))
    there = [forward.at(case) for case in range(0, 3000, 100)]
    back = [backward.at(case) for case in reversed(range(0, 3000, 100))]
    assert there == back[::-1]
    cells = {(int(8 * p["a.x"]), int(8 * p["a.y"])) for p in (forward.at(case) for case in range(64))}
    assert len(cells) == 64  # one point in each of 64 squares: a net in base 2


def test_a_grid_goes_through_all_combinations() -> None:
    made = Draws(
        [
            Vary(key="a.x", values=("p", "q")),
            Vary(key="a.y", range=(0, 1, 3)),
            Vary(key="a.z", values=(True,)),
        ],
        1,
        "grid",
    )
    assert made.grid_size == 6
    rows = [tuple(made.at(number).values()) for number in range(6)]
    assert rows == [(x, y, True) for x in "pq" for y in (0.0, 0.5, 1.0)]


def test_linked_keys_and_factors() -> None:
    vary = Vary.model_validate({"keys": ["a.x", "b.x"], "values": [2.0], "factor": {"c.x": 1.5, "b.x": -1}})
    assert Draws([vary], 1, "grid").at(0) == {"a.x": 2.0, "b.x": -2.0, "c.x": 3.0}
