# SPDX-License-Identifier: BSD-3-Clause
"""Bound of the stable step from single elements.

1. lambda_e is the largest eigenvalue of the element's own assembled stiffness at its free vertices, for any shape and
   any Poisson's ratio, auxetic ones included.
2. (lam_L + 2 mu) V lambda_max(sum grad N grad N^T), the stiffness of a plane wave, is NOT a bound of it.
3. omega_max <= max sqrt(k_i / m_i) <= max sqrt(4 lambda_e / (rho_e V_e)): dense eigenvalues of M^-1 K lie below the
   bound at the vertices, and that below the bound of Irons and Treharne; free and held, uniform and varied bodies,
   slivers.
4. The bound at the vertices stays within 1.7 of omega_max on all of these, and on a published mesh with a sliver; the
   elements' does not.
5. The power iteration that the step is chosen with agrees.
6. Constrained vertices count for nothing; where nothing moves the step is infinite.
7. Threads change no bit.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.discretisation import Discretisation, discretise
from femgal.kernels.cpu.backend import CpuBackend
from femgal.kernels.cpu.threads import Workers
from femgal.solvers.spectrum import largest_frequency_squared, random_start
from femgal.timestep.stable_step import element_stiffness, guaranteed_step, vertex_stiffness
from meshes.generators import box
from meshes.make import make_tets
from meshes.types import TetMesh
from tests.femgal.slivers import box_with_slivers, largest_frequency, stiffnesses
from verify.problems.bodies import distorted_box, left_end, rng
from verify.reference.elasticity import AssembledElasticity

MESH = distorted_box((5, 3, 3))
MESHES = {"box": MESH, "flat": box((1.0, 0.01, 1.0), (3, 3, 3), jitter=0.1, seed=30_071), "sliver": box_with_slivers()}
RATIOS = (-0.95, -0.4, 0.0, 0.3, 0.49)


def body(mesh: TetMesh, held=(), uniform: bool = False) -> tuple[Discretisation, np.ndarray]:
    """A body and its density [kg/m^3] per element."""
    m, random = len(mesh.cells), rng(310)
    if uniform:
        E, nu, rho = np.full(m, 1e5), np.full(m, 0.4), np.full(m, 1000.0)
    else:
        E, nu, rho = 10.0 ** random.uniform(4, 6, m), random.choice(RATIOS, m), 10.0 ** random.uniform(2, 3, m)
    return discretise(mesh, E, nu, rho, held), rho


def largest_of_each_element(disc: Discretisation) -> np.ndarray:
    """Largest eigenvalue of the stiffness at the free vertices of each element, assembled with nothing attached."""
    m = disc.n_tets
    apart = TetMesh(disc.mesh.points[disc.mesh.cells].reshape(-1, 3), np.arange(4 * m).reshape(m, 4))
    K = AssembledElasticity(apart, disc.mu, disc.lam).hessian(apart.points).tobsr((12, 12))
    assert len(K.data) == m
    free = np.repeat(disc.free[disc.mesh.cells], 3, axis=1)
    return np.linalg.eigvalsh(K.data * free[:, None, :] * free[:, :, None])[:, -1]


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("mesh", MESHES)
def test_element_stiffness(mesh, held):
    mesh = MESHES[mesh]
    disc, _ = body(mesh, left_end(mesh, 0.15) if held else ())
    partly = disc.free[mesh.cells].any(axis=1) & ~disc.free[mesh.cells].all(axis=1)
    assert partly.any() == held
    exact = largest_of_each_element(disc)
    np.testing.assert_allclose(element_stiffness(disc, Workers(1)), exact, rtol=1e-9, atol=1e-300)


def test_plane_wave_is_no_bound():
    disc, _ = body(MESH, uniform=True)
    gradients = np.concatenate([-disc.B.reshape(-1, 3, 3).sum(axis=1, keepdims=True), disc.B.reshape(-1, 3, 3)], axis=1)
    a = np.linalg.eigvalsh(np.einsum("eki,ekj->eij", gradients, gradients))[:, 2]
    plane_wave = (disc.Vlam - disc.Vmu + 2.0 * disc.Vmu) * a
    assert (element_stiffness(disc, Workers(1)) > 1.2 * plane_wave).mean() > 0.5


@pytest.mark.parametrize("uniform", [True, False])
@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("mesh", MESHES)
def test_bounds_of_the_largest_frequency(mesh, held, uniform):
    slivers, mesh = mesh == "sliver", MESHES[mesh]
    disc, rho = body(mesh, left_end(mesh) if held else (), uniform)
    stiffness, k = stiffnesses(disc)
    exact = largest_frequency(disc)
    at_vertices = 2.0 / guaranteed_step(k, disc.mass)
    of_elements = np.sqrt((4.0 * stiffness / (rho * disc.V)).max())
    assert exact <= at_vertices * (1.0 + 1e-12)
    assert at_vertices <= of_elements * (1.0 + 1e-12)
    assert at_vertices <= 1.7 * exact
    if slivers:
        assert of_elements >= 10.0 * exact


def test_power_iteration_agrees():
    for mesh in MESHES.values():
        disc, _ = body(mesh, uniform=True)
        squared, _ = largest_frequency_squared(CpuBackend(disc, 1), mesh.points, random_start(disc.n_vertices))
        bound = 2.0 / guaranteed_step(stiffnesses(disc)[1], disc.mass)
        assert bound / 1.7 <= np.sqrt(squared) <= bound


def test_published_mesh_with_a_sliver(real_surface):
    mesh = make_tets(real_surface("ipc_bunny")).mesh
    disc, rho = body(mesh, uniform=True)
    stiffness, k = stiffnesses(disc)
    squared, _ = largest_frequency_squared(CpuBackend(disc), mesh.points, random_start(disc.n_vertices))
    bound = 2.0 / guaranteed_step(k, disc.mass)
    assert bound / 1.7 <= np.sqrt(squared) <= bound
    assert np.sqrt((4.0 * stiffness / (rho * disc.V)).max()) >= 8.0 * np.sqrt(squared)


def test_constrained_vertices_count_for_nothing():
    left = left_end(MESH, 0.15)
    disc, _ = body(MESH, left)
    stiffness, k = stiffnesses(disc)
    assert (k[left] == 0.0).all()
    assert (k[disc.free] > 0.0).all()
    inside = ~disc.free[MESH.cells].any(axis=1)
    assert inside.any()
    assert (stiffness[inside] == 0.0).all()
    disc, _ = body(MESH, np.arange(len(MESH.points)))
    assert guaranteed_step(vertex_stiffness(disc, element_stiffness(disc, Workers(1))), disc.mass) == np.inf


def test_threads_change_no_bit():
    disc, _ = body(box((1.0, 1.0, 1.0), (9, 9, 9), jitter=0.1, seed=30_073))
    assert disc.n_tets > 3 * 1024
    one, three = (element_stiffness(disc, Workers(threads)) for threads in (1, 3))
    assert one.tobytes() == three.tobytes()
