# SPDX-License-Identifier: BSD-3-Clause
"""Meshes with a few bad elements, and what is dense and exact about them."""

from __future__ import annotations

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.kernels.cpu.threads import Workers
from femgal.timestep.stable_step import element_stiffness, vertex_stiffness
from meshes.types import TetMesh
from verify.problems.bodies import distorted_box
from verify.reference.elasticity import AssembledElasticity

Floats = NDArray[np.float64]


def box_with_slivers(flatness: float = 1e-3, count: int = 1, cells: tuple[int, int, int] = (5, 3, 3)) -> TetMesh:
    """A distorted box in which `count` elements are split in four, one of them a sliver.

    The new vertex lies within the old element, at `flatness` of its altitude above the face opposite to its first
    vertex; the sliver keeps the index of the old element.
    """
    mesh = distorted_box(cells)
    points, tets = list(mesh.points), mesh.cells.tolist()
    inner = np.argsort(np.linalg.norm(mesh.points[mesh.cells].mean(axis=1) - mesh.points.mean(axis=0), axis=1))
    for number in range(count):
        e = int(inner[6 * number])
        a, b, c, d = tets[e]
        weights = np.array([flatness, *3 * [(1.0 - flatness) / 3.0]])
        new = len(points)
        points.append(weights @ mesh.points[[a, b, c, d]])
        tets[e] = [new, b, c, d]
        tets += [[a, new, c, d], [a, b, new, d], [a, b, c, new]]
    return TetMesh(np.array(points), np.array(tets))


def stiffnesses(disc: Discretisation) -> tuple[Floats, Floats]:
    """Element and vertex stiffness [N/m]."""
    stiffness = element_stiffness(disc, Workers(1))
    return stiffness, vertex_stiffness(disc, stiffness)


def largest_frequency(disc: Discretisation, K: Floats | None = None) -> float:
    """Square root of the largest dense eigenvalue of M^-1 K at rest [1/s]; K where it has been assembled before."""
    K = stiffness_matrix(disc) if K is None else K
    last, mass = len(K) - 1, np.diag(np.repeat(disc.mass[disc.free], 3))
    return float(np.sqrt(scipy.linalg.eigh(K, mass, eigvals_only=True, subset_by_index=[last, last])[0]))


def stiffness_matrix(disc: Discretisation) -> Floats:
    """Dense stiffness of the free vertices at rest."""
    free = np.repeat(disc.free, 3)
    return AssembledElasticity(disc.mesh, disc.mu, disc.lam).hessian(disc.mesh.points).toarray()[np.ix_(free, free)]
