# SPDX-License-Identifier: BSD-3-Clause
"""Finds the few bad elements that dictate the stable step of explicit integration, where there are such."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.timestep.mass_scaling import share_for
from femgal.timestep.stable_step import guaranteed_step
from meshes.jit import kernel
from meshes.quality import dihedrals

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]

# Elements are few when no more than this share of them has to go for a step twice as long. In meshes of good quality,
# of 1 K to 500 K elements, it takes 1.4 % or more; in two published ones with slivers 0.2 % and a single element.
FEW = 0.005


@dataclass(frozen=True)
class Bottleneck:
    """The elements that dictate the stable step, and what it would be without them.

    Parameters
    ----------
    tet : The worst element.
    centroid : Of its vertices at rest [m].
    dihedral : Its smallest dihedral angle [degrees].
    altitude : Its smallest altitude [m].
    step, step_without : Step that is guaranteed to be stable at rest, with all elements and without the worst one [s].
    few, tets : Elements that would have to go for a step twice as long, of how many.
    share : Largest share of its mass that a body has to gain for the same.
    """

    tet: int
    centroid: tuple[float, float, float]
    dihedral: float
    altitude: float
    step: float
    step_without: float
    few: int
    tets: int
    share: float

    def __str__(self) -> str:
        place = ", ".join(f"{c:.4g}" for c in self.centroid)
        return (
            f"{self.few} of {self.tets} tetrahedra keep the step of verlet from being twice as long; the worst is "
            f"{self.tet} at ({place}) m: smallest dihedral angle {self.dihedral:.2g} degrees, smallest altitude "
            f"{self.altitude:.2g} m; a safe step is {self.step:.3g} s with it, {self.step_without:.3g} s without it. "
            f"Make them better, or let solver.mass_scaling = {_rounded_up(self.share):g} make them heavier"
        )


def find_bottleneck(disc: Discretisation, stiffness: Floats, k: Floats) -> Bottleneck | None:
    """The few elements that dictate the stable step; None where many do.

    Parameters
    ----------
    disc : The discretised bodies.
    stiffness : Element stiffness [N/m], shape [m].
    k : Vertex stiffness [N/m], shape [n].
    """
    step = guaranteed_step(k, disc.mass)
    most = int(FEW * disc.n_tets)
    if not math.isfinite(step) or most == 0:
        return None
    worst = worst_elements(disc, stiffness, k, most)
    limit = (1.0 / step) ** 2  # a quarter of the largest k / m: twice the step
    left = k.copy()
    few = _removals(worst, disc.mesh.cells, stiffness, disc.mass, disc.free, limit, left)
    if few > most:
        return None
    return _describe(disc, stiffness, k, int(worst[0]), few, share_for(disc, k, 2.0 * step))


def worst_elements(disc: Discretisation, stiffness: Floats, k: Floats, most: int) -> Longs:
    """The `most` elements with the largest share in the fastest vertices, worst first; arguments as above."""
    score = np.empty(disc.n_tets)
    _scores(disc.mesh.cells, stiffness, k / disc.mass**2, score)
    worst = np.argpartition(-score, most - 1)[:most] if most < disc.n_tets else np.arange(disc.n_tets)
    return worst[np.lexsort((worst, -score[worst]))]


def _describe(disc: Discretisation, stiffness: Floats, k: Floats, tet: int, few: int, share: float) -> Bottleneck:
    mesh, cell = disc.mesh, disc.mesh.cells[tet]
    without = k.copy()
    without[cell[disc.free[cell]]] -= stiffness[tet]
    B = disc.B[tet].reshape(3, 3)
    gradients = np.vstack([-B.sum(axis=0), B])
    x, y, z = mesh.points[cell].mean(axis=0).tolist()
    return Bottleneck(
        tet=tet,
        centroid=(x, y, z),
        dihedral=dihedrals(mesh.points, mesh.cells[tet : tet + 1]).minimum,
        altitude=1.0 / float(np.linalg.norm(gradients, axis=1).max()),
        step=guaranteed_step(k, disc.mass),
        step_without=guaranteed_step(without, disc.mass),
        few=few,
        tets=disc.n_tets,
        share=share,
    )


def _rounded_up(share: float) -> float:
    """The smallest number of two digits that is no less."""
    unit = 10.0 ** (math.floor(math.log10(share)) - 1)
    return float(f"{math.ceil(share / unit) * unit:.2g}")


@kernel
def _scores(tets: Ints, stiffness: Floats, weight: Floats, score: Floats) -> None:
    """Stiffness of each element times the largest weight of its vertices."""
    for e in range(len(tets)):
        largest = 0.0
        for c in range(4):
            largest = max(largest, weight[tets[e, c]])
        score[e] = stiffness[e] * largest


@kernel
def _removals(
    order: Longs, tets: Ints, stiffness: Floats, mass: Floats, free: NDArray[np.bool_], limit: float, left: Floats
) -> int:
    """How many elements, taken in order from what is left of k, bring every k / m down to the limit.

    One more than there are where all of them do not suffice.
    """
    above = 0
    for v in range(len(left)):
        above += left[v] > limit * mass[v]
    for n in range(len(order)):
        if above == 0:
            return n
        e = order[n]
        for c in range(4):
            v = tets[e, c]
            if free[v]:
                was = left[v] > limit * mass[v]
                left[v] -= stiffness[e]
                above -= was and left[v] <= limit * mass[v]
    return len(order) if above == 0 else len(order) + 1
