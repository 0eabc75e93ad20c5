# SPDX-License-Identifier: BSD-3-Clause
"""Linear tetrahedra with lumped mass: everything about the bodies that does not change with time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from femgal.kernels.cpu.rest import lump_mass, rest_shape
from femgal.materials.stable_neo_hookean import parameters
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
