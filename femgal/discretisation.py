# SPDX-License-Identifier: BSD-3-Clause
"""Linear tetrahedra with lumped mass: everything about the bodies that does not change with time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from femgal.materials.stable_neo_hookean import parameters
from meshes.jit import kernel
from meshes.types import TetMesh

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Discretisation:
    """Rest geometry, material and mass of all bodies together; n vertices, m tetrahedra.

    Parameters
    ----------
    mesh : The rest configuration.
    B : Inverse rest edge matrices Dm^-1 [1/m], row-major, shape [m, 9]; its rows are grad N_1, grad N_2, grad N_3.
    V : Rest volumes [m^3], shape [m].
    mu, lam : Material parameters [Pa], shape [m].
    Vmu, Vlam : The same times V [J], shape [m].
    mass : Lumped vertex masses [kg], shape [n].
    free : Vertices that the solver may move, shape [n], bool.
    """

    mesh: TetMesh
    B: Floats
    V: Floats
    mu: Floats
    lam: Floats
    Vmu: Floats
    Vlam: Floats
    mass: Floats
    free: NDArray[np.bool_]

    @property
    def n_vertices(self) -> int:
        """Number of vertices."""
        return len(self.mesh.points)

    @property
    def n_tets(self) -> int:
        """Number of tetrahedra."""
        return len(self.mesh.cells)


def discretise(
    mesh: TetMesh, E: ArrayLike, nu: ArrayLike, rho: ArrayLike, constrained: ArrayLike = ()
) -> Discretisation:
    """Discretise bodies by linear tetrahedra.

    Parameters
    ----------
    mesh : Rest configuration.
    E, nu, rho : Young's modulus [Pa], Poisson's ratio [-] and density [kg/m^3], scalars or one per tetrahedron.
    constrained : Indices of the vertices whose motion is prescribed.
    """
    m = len(mesh.cells)
    B, V = np.empty((m, 9)), np.empty(m)
    rest_shape(0, m, mesh.points, mesh.cells, B, V)
    mu, lam = (np.ascontiguousarray(np.broadcast_to(p, m)) for p in parameters(E, nu))
    density = np.ascontiguousarray(np.broadcast_to(np.asarray(rho, np.float64), m))
    mass = np.zeros(len(mesh.points))
    lump_mass(mesh.cells, V, density, mass)
    free = np.ones(len(mesh.points), bool)
    free[np.asarray(constrained, np.int64)] = False
    return Discretisation(mesh, B, V, mu, lam, V * mu, V * lam, mass, free)


@kernel
def rest_shape(start: int, stop: int, X: Floats, tets: NDArray[np.int32], B: Floats, V: Floats) -> None:
    """B[e] = Dm^-1 and V[e] = det Dm / 6 of elements start to stop - 1."""
    for e in range(start, stop):
        o = X[tets[e, 0]]
        a, b, c = X[tets[e, 1]] - o, X[tets[e, 2]] - o, X[tets[e, 3]] - o
        # The rows of Dm^-1 are b x c, c x a and a x b over det Dm.
        bc0, bc1, bc2 = b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]
        det = a[0] * bc0 + a[1] * bc1 + a[2] * bc2
        B[e, 0], B[e, 1], B[e, 2] = bc0 / det, bc1 / det, bc2 / det
        B[e, 3] = (c[1] * a[2] - c[2] * a[1]) / det
        B[e, 4] = (c[2] * a[0] - c[0] * a[2]) / det
        B[e, 5] = (c[0] * a[1] - c[1] * a[0]) / det
        B[e, 6] = (a[1] * b[2] - a[2] * b[1]) / det
        B[e, 7] = (a[2] * b[0] - a[0] * b[2]) / det
        B[e, 8] = (a[0] * b[1] - a[1] * b[0]) / det
        V[e] = det / 6.0


@kernel
def lump_mass(tets: NDArray[np.int32], V: Floats, density: Floats, mass: Floats) -> None:
    """Give a quarter of each element's mass to each of its vertices."""
    for e in range(len(tets)):
        for k in range(4):
            mass[tets[e, k]] += 0.25 * density[e] * V[e]
