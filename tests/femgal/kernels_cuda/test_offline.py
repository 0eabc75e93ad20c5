# SPDX-License-Identifier: BSD-3-Clause
"""Every CUDA kernel compiled for Hopper without a GPU.

1. No kernel spills a register or keeps an array in local memory, in either precision.
2. Element passes in float32 compute nothing in double precision but differences of positions and sums.
3. None needs more than 168 registers, of which 384 threads fit on a multiprocessor.
"""

from __future__ import annotations

import pytest

from tests.femgal.kernels_cuda.simulated import needs_numba_cuda

# Sums over threads and counts come in doubles; what else the passes of elements may do in them is to subtract.
ELEMENT_PASSES = (
    "vertex_terms",
    "vertex_forces",
    "vertex_products",
    "vertex_definite_products",
    "energies",
    "energies_along",
    "von_mises_stresses",
    "pair_terms",
    "pair_forces",
    "pair_products",
)
SUMMING = ("energies", "energies_along")
MOST_REGISTERS = 168


@pytest.fixture
def compiled():
    needs_numba_cuda()
    from femgal.kernels.cuda import offline

    if offline.find_ptxas() is None:
        pytest.skip("ptxas is missing: pip install 'nvidia-cuda-nvcc==13.0.*'")
    return offline.compile_offline


def check(one) -> None:
    assert (one.stack, one.spills) == (0, 0)
    assert 0 < one.registers <= MOST_REGISTERS
    if one.precision == "float32" and one.name in ELEMENT_PASSES:
        assert set(one.doubles) <= ({"sub", "add"} if one.name in SUMMING else {"sub"})


@pytest.mark.parametrize("name", ["vertex_terms", "vertex_forces", "pair_terms", "energies_along"])
def test_single_precision(compiled, name):
    check(compiled(name, "float32"))


@pytest.mark.slow
def test_every_kernel_in_every_precision(compiled):
    from femgal.kernels.cuda.offline import compile_all, kernel_names, precisions

    found = list(compile_all())
    assert {(one.name, one.precision) for one in found} == {(n, p) for n in kernel_names() for p in precisions(n)}
    assert set(ELEMENT_PASSES) <= {one.name for one in found}
    for one in found:
        check(one)


def test_double_precision_is_seen(compiled):
    one = compiled("sum_vectors", "float32")
    assert one.doubles["fma"] > 0
    assert one.ptx.count("\n") > 100
