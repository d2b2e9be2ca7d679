"""Kernels that call kernels: as numba's own, whoever calls whom first."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import pytest

from faultloop import linking

TABLE = np.array([1.0, 2.0, 4.0])


def kernel(function: Any) -> Any:
    return linking.kernel(function, {"error_model": "numpy"})


def made() -> tuple[Any, Any, Any, Any]:
    @kernel
    def leaf(x: float) -> float:
        if x < 0:
            raise ValueError("below zero")
        return TABLE[int(x)]

    @kernel
    def middle(x: float) -> float:
        return leaf(x) + np.sqrt(x)

    @kernel
    def other(x: float) -> float:
        return leaf(x) - 1.0

    @kernel
    def root(x: float) -> float:
        return middle(x) * 10.0 + other(x) + leaf(x)

    return leaf, middle, other, root


def test_a_root_runs_what_its_parts_do() -> None:
    *_, root = made()
    assert root(1.0) == 30.0 + 1.0 + 2.0
    with pytest.raises(ValueError, match="below zero"):
        root(-1.0)


def test_what_a_root_calls_is_not_made_ready_by_itself() -> None:
    leaf, middle, other, root = made()
    root(1.0)
    assert not leaf.overloads
    assert not middle.overloads
    parts = [kernel.part.overloads[(numba.float64,)].library for kernel in (leaf, middle, other)]
    for library in parts:
        assert library.get_pointer_to_function("anything") == 0


def test_what_an_inlined_one_calls_is_linked_for_others() -> None:
    """Nothing refers to an inlined kernel's own code, nor by it to what it calls."""

    @kernel
    def leaf(x: float) -> float:
        return x + 1 if x < 100 else np.sin(x) + np.sum(np.arange(x))

    def inlined(x: float) -> float:
        return leaf(x) + leaf(2 * x)

    always = linking.kernel(inlined, {"inline": "always"})

    @kernel
    def last(x: float) -> float:
        return leaf(3 * x)

    @kernel
    def middle(x: float) -> float:
        return last(x) + always(x)

    @kernel
    def root(x: float) -> float:
        return always(x) + middle(x)

    assert root(1.0) == 2 + 3 + 4 + 2 + 3
    for function in root.overloads[(numba.float64,)].library._final_module.functions:
        assert not (function.is_declaration and "leaf" in function.name)


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 2, 1, 0), (1, 3, 0, 2)])
def test_any_may_be_called_first(order: tuple[int, ...]) -> None:
    kernels, right = made(), (2.0, 3.0, 1.0, 33.0)
    for _ in range(2):
        for k in order:
            assert kernels[k](1.0) == right[k]


def test_numbas_own_kernel_may_call_one_and_be_called() -> None:
    leaf, _, _, root = made()

    @numba.njit
    def foreign(x: float) -> float:
        return root(x) + leaf(x)

    @kernel
    def ours(x: float) -> float:
        return foreign(x) + leaf(x)

    assert ours(1.0) == 37.0
    assert foreign(1.0) == 35.0
    with pytest.raises(ValueError, match="below zero"):
        ours(-1.0)


def test_one_that_calls_itself() -> None:
    @kernel
    def factorial(n: int) -> int:
        return 1 if n < 2 else n * factorial(n - 1)

    @kernel
    def root(n: int) -> int:
        return factorial(n) + 1

    assert root(10) == 3628801
    assert factorial(5) == 120


def test_an_address_of_a_root_can_be_called() -> None:
    leaf, *_ = made()

    @kernel
    def twice(x: float) -> float:
        return 2 * leaf(x)

    @kernel
    def through(step: Any, x: float) -> float:
        return step(x)

    assert through(twice, 2.0) == 8.0
