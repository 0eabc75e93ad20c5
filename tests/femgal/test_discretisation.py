# SPDX-License-Identifier: BSD-3-Clause
"""Rest geometry, material and mass of the discretised bodies.

1. B is the inverse of the rest edge matrix, V the volume, for slivers of aspect ratio 1000 too.
2. Volumes sum to the volume of the box, masses to density times volume, also where the density varies.
3. Lumped masses are the row sums of scikit-fem's consistent mass matrix.
4. Vmu and Vlam are V mu and V lam; scalars and one value per tetrahedron give the same bodies.
5. Constrained vertices, and only they, are not free.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.discretisation import discretise
from meshes.generators import box
from meshes.types import TetMesh
from verify.problems.bodies import distorted_box, left_end, rng, varied
from verify.reference.elasticity import lumped_mass

MESH = distorted_box()


def edge_matrices(mesh: TetMesh) -> np.ndarray:
    """Dm with the edges from vertex 0 as columns, shape [m, 3, 3]."""
    return (mesh.points[mesh.cells[:, 1:]] - mesh.points[mesh.cells[:, :1]]).transpose(0, 2, 1)


@pytest.mark.parametrize("mesh", [MESH, box((1.0, 1e-3, 1.0), (3, 3, 3), jitter=0.1)], ids=["box", "slivers"])
def test_rest_shape(mesh):
    disc, Dm = discretise(mesh, 1e5, 0.3, 1.0), edge_matrices(mesh)
    identity = disc.B.reshape(-1, 3, 3) @ Dm
    np.testing.assert_allclose(identity, np.broadcast_to(np.eye(3), Dm.shape), rtol=0, atol=1e-11)
    np.testing.assert_allclose(disc.V, np.linalg.det(Dm) / 6.0, rtol=1e-11)
    assert disc.V.sum() == pytest.approx(np.ptp(mesh.points, axis=0).prod(), rel=1e-12)


def test_mass():
    rho = 10.0 ** rng(70).uniform(0.0, 4.0, len(MESH.cells))
    disc = discretise(MESH, 1e5, 0.3, rho)
    np.testing.assert_allclose(disc.mass, lumped_mass(MESH, rho), rtol=1e-13)
    assert disc.mass.sum() == pytest.approx((rho * disc.V).sum(), rel=1e-13)


def test_material():
    disc = varied(MESH)
    np.testing.assert_array_equal(disc.Vmu, disc.V * disc.mu)
    np.testing.assert_array_equal(disc.Vlam, disc.V * disc.lam)
    one, many = (
        discretise(MESH, 3e5, 0.2, 900.0),
        discretise(MESH, *(np.full(len(MESH.cells), p) for p in (3e5, 0.2, 900))),
    )
    for name in ("B", "V", "mu", "lam", "mass"):
        np.testing.assert_array_equal(getattr(one, name), getattr(many, name))


def test_free():
    assert discretise(MESH, 1e5, 0.3, 1.0).free.all()
    constrained = left_end(MESH)
    free = discretise(MESH, 1e5, 0.3, 1.0, constrained).free
    np.testing.assert_array_equal(np.flatnonzero(~free), np.sort(constrained))
