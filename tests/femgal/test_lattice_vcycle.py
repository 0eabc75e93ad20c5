# SPDX-License-Identifier: BSD-3-Clause
"""The V-cycle as a preconditioner.

1. It is symmetric to rounding and positive definite: z . M^-1 w and w . M^-1 z agree, z . M^-1 z > 0, and all its
   eigenvalues relative to A lie in (0, 1.1).
2. Conjugate gradients with it need at most 10 iterations to 1e-2 (energy norm) on boxes of several levels, soft and
   stiff, heavy and light, at rest and deformed; block Jacobi needs ten times as many where the step is long.
3. Free bodies, several of them, slivers, a mesh without a coarse level, one free vertex: all work.
4. A refresh makes exactly what a new preconditioner would, but for the eigenvalue estimate.
5. The product with its finest matrix is that of the backend with the definite part of every element.
6. The size of the residual does not matter, zero gives zero, and threads change no bit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

from femgal.assembly.hessian import HessianAssembly
from femgal.kernels.cpu.backend import CpuBackend
from femgal.solvers.lattice_vcycle import LatticeVCycle
from femgal.solvers.pcg import solve
from femgal.solvers.preconditioner import LayerBlocks
from femgal.timestep.potential import IncrementalPotential
from meshes.types import TetMesh
from tests.femgal.slivers import box_with_slivers
from verify.problems.bodies import distorted_box, left_end, released, rng, uniform

MESH = distorted_box((20, 12, 12))
HELD = uniform(MESH, left_end(MESH), E=1e6)
SMALL = distorted_box((8, 6, 6))


def potential(disc, h=1.0 / 60.0, threads=1):
    return IncrementalPotential(CpuBackend(disc, threads), disc.mesh.points, h)


def bent(mesh: TetMesh) -> np.ndarray:
    """A smooth motion of a tenth of the body's size that turns and stretches; constrained ends may move, too."""
    X = mesh.points - mesh.points.min(axis=0)
    return mesh.points + 0.2 * np.ptp(X, axis=0).min() * np.sin(3.0 * X[:, [1, 2, 0]] / np.ptp(X, axis=0).max())


def refreshed(phi, x, **options):
    made = LatticeVCycle(phi.backend, **options)
    made.refresh(phi, x)
    return made


def iterations(phi, x, precondition, right="mass", reduction=1e-2):
    disc, backend = phi.backend.disc, phi.backend
    A = HessianAssembly(disc, "float64", 1).assemble(x, phi.inverse_h2)
    b = disc.mass[disc.free, None] * np.array([0.1, 0.3, -1.0])
    if right == "random":
        b = rng(440).standard_normal(b.shape)
    found = solve(backend, A.product, precondition.apply, b, reduction, 2000)
    assert found.curvature
    assert found.reduction <= reduction
    return found.iterations


def dense(precondition, n: int) -> np.ndarray:
    columns = [precondition.apply(unit.reshape(n, 3)).ravel() for unit in np.eye(3 * n)]
    return np.array(columns).T


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_symmetric_and_definite(precision):
    phi, x = potential(HELD), bent(MESH)
    M = refreshed(phi, x, precision=precision)
    z, w = rng(441).standard_normal((2, int(HELD.free.sum()), 3))
    one, other = (z * M.apply(w)).sum(), (w * M.apply(z)).sum()
    scale = np.sqrt((z * M.apply(z)).sum() * (w * M.apply(w)).sum())
    assert abs(one - other) <= {"float32": 1e-5, "float64": 1e-12}[precision] * scale
    assert (z * M.apply(z)).sum() > 0.0


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("disc", [HELD, uniform(distorted_box((2, 2, 2)), E=1e7)], ids=["levels", "bottom alone"])
def test_its_product_is_that_of_the_definite_part(disc, precision):
    phi, x = potential(disc), bent(disc.mesh)
    M, p = refreshed(phi, x, precision=precision), rng(442).standard_normal((int(disc.free.sum()), 3))
    d = np.zeros_like(x)
    d[disc.free] = p
    expected = phi.backend.nodal_product(phi.backend.vertices, x, d, phi.inverse_h2, definite=True)
    np.testing.assert_allclose(
        M.product(p), expected, rtol=0, atol={"float32": 1e-6, "float64": 1e-12}[precision] * np.abs(expected).max()
    )


@pytest.mark.parametrize("held", [True, False])
def test_spectrum(held):
    disc = uniform(SMALL, left_end(SMALL) if held else (), E=1e7)
    phi, x = potential(disc), bent(SMALL)
    M = refreshed(phi, x, precision="float64")
    Z = dense(M, int(disc.free.sum()))
    np.testing.assert_allclose(Z, Z.T, rtol=0, atol=1e-12 * np.abs(Z).max())
    A = HessianAssembly(disc, "float64", 1).assemble(x, phi.inverse_h2).to_scipy().toarray()
    values = scipy.linalg.eigh(A, np.linalg.inv(0.5 * (Z + Z.T)), eigvals_only=True)
    assert values[0] > 0.02
    assert values[-1] < 1.1


@pytest.mark.parametrize("right", ["mass", "random"])
@pytest.mark.parametrize("state", ["rest", "bent"])
@pytest.mark.parametrize(("E", "rho"), [(1e3, 1000.0), (1e6, 1000.0), (1e8, 1000.0), (1e6, 1.0), (1e8, 1.0)])
def test_iterations(E, rho, state, right):
    disc = uniform(MESH, left_end(MESH), E=E)
    disc = replace(disc, mass=disc.mass * (rho / 1000.0))
    phi, x = potential(disc), {"rest": MESH.points, "bent": bent(MESH)}[state]
    assert iterations(phi, x, refreshed(phi, x), right) <= 10


def test_beats_block_jacobi():
    phi, x = potential(uniform(MESH, left_end(MESH), E=1e8)), MESH.points
    blocks = LayerBlocks((phi.backend.vertices,))
    blocks.refresh(phi, x)
    assert iterations(phi, x, blocks) > 10 * iterations(phi, x, refreshed(phi, x))


def scattered() -> TetMesh:
    """27 boxes that do not touch."""
    one = distorted_box((3, 3, 3))
    shifts = 0.6 * np.stack(np.meshgrid(*3 * [np.arange(3.0)]), axis=-1).reshape(-1, 3)
    points = np.concatenate([one.points + shift for shift in shifts])
    return TetMesh(points, np.concatenate([one.cells + k * len(one.points) for k in range(27)]))


@pytest.mark.parametrize(
    ("disc", "most"),
    [
        pytest.param(released(HELD), 10, id="free"),
        pytest.param(uniform(scattered(), E=1e7), 10, id="scattered"),
        pytest.param(uniform(box_with_slivers(1e-3, 3, (8, 6, 6)), E=1e7), 12, id="slivers"),
        pytest.param(uniform(distorted_box((2, 2, 2)), E=1e7), 2, id="no coarse level"),
        pytest.param(uniform(SMALL, np.arange(1, len(SMALL.points)), E=1e7), 2, id="one vertex"),
    ],
)
def test_bodies(disc, most):
    phi = potential(disc)
    for x in (disc.mesh.points, bent(disc.mesh)):
        assert iterations(phi, x, refreshed(phi, x), "random") <= most


def test_refresh():
    phi, x, r = potential(HELD), bent(MESH), rng(442).standard_normal((int(HELD.free.sum()), 3))
    M = LatticeVCycle(phi.backend)
    M.refresh(phi, MESH.points)
    at_rest = M.apply(r)
    M.refresh(phi, x)
    new = refreshed(phi, x).apply(r)
    assert np.abs(M.apply(r) - new).max() <= 0.05 * np.abs(new).max()
    assert np.abs(at_rest - new).max() > 0.1 * np.abs(new).max()


def test_size_of_the_residual():
    M = refreshed(potential(HELD), MESH.points)
    r = rng(443).standard_normal((int(HELD.free.sum()), 3))
    for size in (1e-60, 1e60):
        np.testing.assert_allclose(
            M.apply(size * r), size * M.apply(r), rtol=0, atol=1e-5 * size * np.abs(M.apply(r)).max()
        )
    np.testing.assert_array_equal(M.apply(0.0 * r), 0.0)


def test_threads_change_no_bit():
    r = rng(444).standard_normal((int(HELD.free.sum()), 3))
    one, two = (refreshed(potential(HELD, threads=threads), bent(MESH)).apply(r) for threads in (1, 2))
    np.testing.assert_array_equal(one, two)


def test_prints():
    text = str(refreshed(potential(HELD), MESH.points))
    assert len(text.splitlines()) >= 3
    assert "solved directly" in text
