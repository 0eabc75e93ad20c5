# SPDX-License-Identifier: BSD-3-Clause
"""The CUDA backend in Numba's simulator against the plain float64 passes, on 480 tetrahedra.

1. Gradients, blocks, corrections, Hessian products, energies, energies along a line, restriction, prolongation and the
   work on vectors: to 1e-12 in float64 and 2e-5 in float32 of the largest value, at the finest layer, constant clusters
   and a layer with four parents, with and without constrained vertices.
   V-cycles and products with their finest matrix to 1e-5, as the host makes them in single precision.
2. A position that is not a number is found.
3. The same pass gives the same bits again.
"""

from __future__ import annotations

from functools import cache

import pytest

from tests.femgal.kernels_cuda.simulated import in_simulator

OF_CYCLES = 1e-5
TOLERANCE = {"float64": 1e-12, "float32": 2e-5}


@cache
def found(precision: str, *arguments: str) -> dict:
    return in_simulator("verify.gpu.passes", precision, *arguments)


def assert_equal(result: dict, precision: str) -> None:
    assert len(result["differences"]) > 40
    wrong = {name: size for name, size in result["differences"].items() if not size <= TOLERANCE[precision]}
    assert wrong == {}


def test_passes():
    assert_equal(found("float64", "0.25"), "float64")


@pytest.mark.slow
@pytest.mark.parametrize("precision", TOLERANCE)
# Nothing is held, or four fifths of a body of 0.5 m, with elements that no free vertex feels.
@pytest.mark.parametrize("held", ["0", "0.4"])
def test_all_passes(precision, held):
    result = found(precision, held, "rare")
    assert_equal(result, precision)
    assert "definite product" in result["differences"]
    assert len(result["cycles"]) == 4
    assert max(result["cycles"].values()) <= OF_CYCLES
    assert result["repeats"]


def test_what_is_not_finite_is_found():
    assert found("float64", "0.25")["finite"] == [True, False]


def test_same_bits_again():
    assert found("float64", "0.25")["repeats"]
