# SPDX-License-Identifier: BSD-3-Clause
"""Power iterations against dense eigenvalues.

1. lambda_max(D_l^-1 A_l) of every layer, from below and within 10%, with 3x3 blocks and with plain diagonals, for
   steps from h -> 0 (where it is 1) to 1/60 s. A tight cluster of eigenvalues at the top is why it is not closer.
2. The step lengths made of it lie in (0, 1], go to 1 with h -> 0, and keep one sweep from exciting the motion: with the
   dense eigenvalue 1 - w lambda >= -1/3 within 0.01, the share of the margin that low estimates have been seen to eat.
3. The squared frequency is within 7% of the largest dense eigenvalue of M^-1 K, without and with constrained vertices,
   for uniform and heterogeneous bodies. It may lie below, where the residual's disc holds other eigenvalues, but never
   so far that 0.9 of the step made of it is unstable. The mode has unit mass norm and rests where vertices do.
4. A few iterations from a known mode are as good as many from a random start.
5. The start vector is the same in every call.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import scipy.linalg

from femgal.hierarchy.hierarchy import build_constant_hierarchy
from femgal.kernels.cpu.backend import CpuBackend
from femgal.solvers.smoother import step_lengths
from femgal.solvers.spectrum import largest_block_jacobi_eigenvalue, largest_frequency_squared, random_start
from verify.problems.bodies import distorted_box, left_end, linear_layer, positions, potential_at, rng, uniform, varied
from verify.reference.elasticity import AssembledElasticity
from verify.reference.transfer import block_diagonal, diagonal_blocks, galerkin, mass_matrix, prolongation

MESH = distorted_box((5, 3, 3))
BODIES = {
    "uniform": uniform(MESH),
    "held": uniform(MESH, left_end(MESH)),
    "solid wall": uniform(MESH, left_end(MESH, 0.25)),
    "varied": varied(MESH, left_end(MESH)),
}
LAYERS = {name: (*build_constant_hierarchy(BODIES[name], 4).layers, linear_layer(BODIES[name])) for name in BODIES}


@cache
def stiffness(name: str, state: str):
    disc = BODIES[name]
    return AssembledElasticity(MESH, disc.mu, disc.lam).hessian(placed(state))


def placed(state: str) -> np.ndarray:
    return 0.8 * MESH.points if state == "compressed" else positions(MESH, state)


def dense_eigenvalue(name: str, layer, h: float, scalar: bool) -> float:
    A = galerkin(prolongation(layer), mass_matrix(BODIES[name].mass) / h**2 + stiffness(name, "rest"))
    D = np.diag(A.diagonal()) if scalar else block_diagonal(diagonal_blocks(A)).toarray()
    return largest(A.toarray(), D)


def largest(A: np.ndarray, D: np.ndarray) -> float:
    last = len(A) - 1
    return float(scipy.linalg.eigh(A, D, eigvals_only=True, subset_by_index=[last, last])[0])


@pytest.mark.parametrize("scalar", [False, True])
@pytest.mark.parametrize("h", [1e-7, 1.0 / 600.0, 1.0 / 60.0])
@pytest.mark.parametrize("name", ["uniform", "solid wall", "varied"])
def test_block_jacobi_eigenvalue(name, h, scalar):
    phi = potential_at(BODIES[name], MESH.points, h)
    steps = step_lengths("spectral", phi, LAYERS[name], scalar=scalar)
    for layer, w in zip(LAYERS[name], steps, strict=True):
        estimate = largest_block_jacobi_eigenvalue(phi, layer, MESH.points, scalar=scalar)
        exact = dense_eigenvalue(name, layer, h, scalar)
        assert 0.9 * exact <= estimate <= exact * (1.0 + 1e-9)
        assert 0.0 < w <= 1.0
        assert 1.0 - w * exact >= -1.0 / 3.0 - 0.01
        if h == 1e-7 and layer.name != "made up":  # overlapping weights leave a coarse mass matrix that is not diagonal
            assert w == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("h", [1.0 / 600.0, 1.0 / 60.0])
def test_step_lengths_of_all_layers(h):
    phi = potential_at(BODIES["held"], MESH.points, h)
    layers = LAYERS["held"][:-1]
    lambdas = np.array([largest_block_jacobi_eigenvalue(phi, layer, MESH.points) for layer in layers])
    smoothing, stable = 2.0 / (1.0 + lambdas), 4.0 / (3.0 * lambdas)
    w = step_lengths("spectral", phi, layers)
    np.testing.assert_array_equal(w[smoothing < 0.9 * stable], smoothing[smoothing < 0.9 * stable])
    assert (w <= np.minimum(smoothing, stable)).all()
    assert (w >= 0.9 * np.minimum(smoothing, stable)).all()
    # The short step is the smoother's business on every vertex, the long one that of stability on some layer.
    assert (smoothing > stable).any() == (h == 1.0 / 60.0)
    np.testing.assert_array_equal(step_lengths((0.25, 0.5), phi, layers), [0.5] + [0.25] * (len(layers) - 1))
    assert np.isnan(step_lengths("exact", phi, layers)).all()


def dense_frequency_squared(name: str, K) -> float:
    free = np.repeat(BODIES[name].free, 3)
    return largest(K.toarray()[np.ix_(free, free)], np.diag(np.repeat(BODIES[name].mass, 3)[free]))


@pytest.mark.parametrize("state", ["rest", "stretched", "compressed"])
@pytest.mark.parametrize("name", BODIES)
def test_largest_frequency(name, state):
    disc = BODIES[name]
    start = random_start(disc.n_vertices)
    estimate, mode = largest_frequency_squared(CpuBackend(disc, 1), placed(state), start)
    exact = dense_frequency_squared(name, stiffness(name, state))
    assert 0.93 * exact <= estimate <= 1.07 * exact
    assert 0.9 * np.sqrt(exact / estimate) < 0.95
    assert (disc.mass[:, None] * mode**2).sum() == pytest.approx(1.0, rel=1e-12)
    assert (mode[~disc.free] == 0.0).all()


def test_following_a_mode():
    backend = CpuBackend(BODIES["held"], 1)
    _, mode = largest_frequency_squared(backend, MESH.points, random_start(len(MESH.points)))
    x = MESH.points + 0.003 * rng(90).standard_normal(MESH.points.shape)
    before = backend.passes.hessian_product
    estimate, _ = largest_frequency_squared(backend, x, mode, max_iterations=4)
    assert backend.passes.hessian_product - before <= 4
    disc = BODIES["held"]
    exact = dense_frequency_squared("held", AssembledElasticity(MESH, disc.mu, disc.lam).hessian(x))
    assert 0.98 * exact <= estimate <= 1.3 * exact


def test_random_start_is_fixed():
    np.testing.assert_array_equal(random_start(50), random_start(50))
    assert np.abs(random_start(1000).mean(axis=0)).max() <= 0.15  # five standard deviations of a mean
