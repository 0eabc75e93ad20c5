# SPDX-License-Identifier: BSD-3-Clause
"""Multilevel additive Schwarz.

1. It is the sum over levels and domains of dense inverses of P^T A P, built slowly from the assembled matrix.
2. It is symmetric and positive definite: deformed, inverted, held, free, of several bodies, stiff and light.
3. Conjugate gradients need fewer iterations with it than with vertex blocks, and with all levels than with the finest.
4. A refresh replaces what was made elsewhere; threads do not change a bit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from femgal.assembly.hessian import assemble
from femgal.discretisation import discretise
from femgal.kernels.cpu.backend import CpuBackend
from femgal.schwarz.domains import build_levels
from femgal.solvers import mas
from femgal.solvers.mas import MAS
from femgal.solvers.pcg import solve
from femgal.solvers.preconditioner import LayerBlocks
from femgal.timestep.potential import IncrementalPotential
from meshes.types import TetMesh
from verify.problems.bodies import STATES, distorted_box, left_end, positions, rng, uniform, varied

MESH = distorted_box((9, 4, 4))
X = MESH.points
HELD = varied(MESH, left_end(MESH))
TWO = uniform(TetMesh(np.concatenate((X, X + 5.0)), np.concatenate((MESH.cells, MESH.cells + len(X)))))
# Stiffness is 10^8 times inertia: what float32 cannot tell apart.
STIFF_AND_LIGHT = discretise(MESH, 1e8, 0.45, 1.0)
BODIES = {"held": HELD, "free": uniform(MESH), "two": TWO, "stiff": STIFF_AND_LIGHT}
H = 1.0 / 60.0


def made(disc, x: np.ndarray, threads: int = 1, size: int = 8, h: float = H) -> MAS:
    backend = CpuBackend(disc, threads)
    one = MAS(backend, size)
    one.refresh(IncrementalPotential(backend, x, h), x)
    return one


def dense(one: MAS) -> np.ndarray:
    """Its matrix, column by column."""
    n = int(one.backend.disc.free.sum())
    return np.stack([one.apply(e.reshape(n, 3)).ravel() for e in np.eye(3 * n)], axis=1)


def slow(one: MAS, x: np.ndarray) -> np.ndarray:
    """Sum of P (P^T A P)^-1 P^T, P the nodes of one domain."""
    A = assemble(one.backend.disc, x, H**-2).to_scipy().toarray()
    total = np.zeros_like(A)
    for level in one.levels:
        for d in range(level.n_domains):
            nodes = level.node[level.ptr[d] : level.ptr[d + 1]]
            P = np.kron((level.node_of[:, None] == nodes).astype(float), np.eye(3))
            total += P @ np.linalg.solve(P.T @ A @ P, P.T)
    return total


@pytest.mark.parametrize("state", STATES)
def test_it_is_the_sum_of_dense_inverses(state):
    x = np.where(HELD.free[:, None], positions(MESH, state), X)
    one = made(HELD, x)
    assert len(one.levels) == 3
    expected = slow(one, x)
    # Inverses of the finest level are rounded to float32.
    assert np.linalg.norm(dense(one) - expected) <= 3e-6 * np.linalg.norm(expected)


@pytest.mark.parametrize("state", ["rest", "inverted"])
@pytest.mark.parametrize("name", BODIES)
def test_symmetric_and_positive_definite(name, state):
    disc = BODIES[name]
    x = X if name != "two" else TWO.mesh.points
    if state == "inverted":
        x = x * [-1.0, 0.9, 1.2] + 0.004 * rng(241).standard_normal(x.shape)
    M = dense(made(disc, np.where(disc.free[:, None], x, disc.mesh.points), size=32))
    assert np.abs(M - M.T).max() <= 1e-14 * np.abs(M).max()
    A = assemble(disc, x, H**-2).to_scipy().toarray()
    # Eigenvalues of M A, which conjugate gradients see.
    L = np.linalg.cholesky(A)
    values = np.linalg.eigvalsh(L.T @ (0.5 * (M + M.T)) @ L)
    # Nothing coarser than translations holds a body that has hardly any inertia against turning.
    assert values.min() > (0.0 if name == "stiff" else 0.01)
    assert values.max() < 20.0


def iterations(disc, precondition, reduction: float = 1e-4) -> int:
    A = assemble(disc, X, H**-2)
    b = rng(242).standard_normal((A.n_rows, 3))
    return solve(CpuBackend(disc, 1), A.product, precondition, b, reduction, 2000).iterations


@pytest.mark.parametrize("disc", [HELD, STIFF_AND_LIGHT], ids=["held", "stiff"])
def test_fewer_iterations_than_vertex_blocks(disc, monkeypatch):
    one = made(disc, X, size=32)
    blocks = LayerBlocks((one.backend.vertices,))
    blocks.refresh(IncrementalPotential(one.backend, X, H), X)
    monkeypatch.setattr(mas, "build_levels", lambda *arguments: build_levels(*arguments)[:1])
    finest = made(disc, X, size=32)
    found = [iterations(disc, p.apply) for p in (one, finest, blocks)]
    assert found[0] < found[1] < found[2]
    assert found[0] < 0.5 * found[2]


def test_refresh():
    one = made(HELD, X)
    r = rng(243).standard_normal((int(HELD.free.sum()), 3))
    first = one.apply(r)
    bent = np.where(HELD.free[:, None], positions(MESH, "random"), X)
    phi = IncrementalPotential(one.backend, X, H)
    one.refresh(phi, bent)
    assert np.abs(one.apply(r) - first).max() > 1e-3 * np.abs(first).max()
    np.testing.assert_array_equal(one.apply(r), made(HELD, bent).apply(r))


def test_threads_do_not_change_a_bit(monkeypatch):
    monkeypatch.setattr(mas, "_SMALLEST_SHARE", 1)
    r = rng(244).standard_normal((int(HELD.free.sum()), 3))
    np.testing.assert_array_equal(*(made(HELD, X, threads).apply(r) for threads in (1, 3)))


def test_a_single_free_vertex():
    disc = replace(HELD, free=np.arange(len(X)) == 40)
    np.testing.assert_allclose(
        dense(made(disc, X)), np.linalg.inv(assemble(disc, X, H**-2).to_scipy().toarray()), rtol=1e-9
    )
