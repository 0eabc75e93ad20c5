# SPDX-License-Identifier: BSD-3-Clause
"""How much too stiff linear tetrahedra are in bending, measured on a cantilever.

A beam of n x n cells across and 10 n along, each split into six tetrahedra, is clamped at one end and loaded across at
the other. The deflection of its tip at small load is compared with Timoshenko's P L^3 / (3 E I) + P L / (kappa G A),
kappa = 10 (1 + nu) / (12 + 11 nu) for a square (Cowper 1966). Linear elements bend too little: by shear where there are
few of them across, by volume where nu is near 1/2. The clamp itself makes the real beam stiffer by some per cent at
nu near 1/2, which is counted here with the elements.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import scipy.sparse.linalg as spla

from femgal.discretisation import discretise
from meshes.generators import box
from verify.reference.elasticity import AssembledElasticity

SLENDERNESS = 10
# Cells across that are measured; beyond, the excess falls with the square of the width of a cell.
MOST_CELLS = 4


def over_stiffness(nu: float, cells: float) -> float:
    """True deflection over that of linear tetrahedra, from 1 for perfect elements.

    Parameters
    ----------
    nu : Poisson's ratio.
    cells : Cells through the thickness, not necessarily a whole number; fewer than one count as one.
    """
    n = max(cells, 1.0)
    if n >= MOST_CELLS:
        return 1.0 + max(0.0, measured(nu, MOST_CELLS) - 1.0) * (MOST_CELLS / n) ** 2
    low = int(n)
    excess = [max(measured(nu, k) - 1.0, 1e-6) for k in (low, low + 1)]
    slope = np.log(excess[1] / excess[0]) / np.log((low + 1) / low)
    return float(1.0 + excess[0] * (n / low) ** slope)


@cache
def measured(nu: float, cells: int) -> float:
    """The same for a whole number of cells."""
    mesh = box((float(SLENDERNESS), 1.0, 1.0), (SLENDERNESS * cells, cells, cells))
    x = mesh.points[:, 0]
    disc = discretise(mesh, 1.0, nu, 1.0, np.flatnonzero(x == 0.0))
    K = AssembledElasticity(mesh, disc.mu, disc.lam).hessian(mesh.points)
    tip = np.flatnonzero(x == x.max())
    load = np.zeros_like(mesh.points)
    load[tip, 1] = _shares(mesh.points[tip, 1:], cells)
    free = np.flatnonzero(np.repeat(disc.free, 3))
    u = np.zeros(load.size)
    u[free] = spla.spsolve(K[free][:, free].tocsc(), load.ravel()[free])
    return _timoshenko(nu) / float((u.reshape(-1, 3)[tip, 1] * load[tip, 1]).sum())


def _shares(points: np.ndarray, cells: int) -> np.ndarray:
    """A unit load spread evenly over the square end: half at its edges, a quarter at its corners."""
    inner = ((points > 1e-9) & (points < 1.0 - 1e-9)).sum(axis=1)
    return 0.25 * 2.0**inner / cells**2


def _timoshenko(nu: float) -> float:
    """Tip deflection of the unit square beam with E = 1 under a unit load."""
    length, kappa = float(SLENDERNESS), 10.0 * (1.0 + nu) / (12.0 + 11.0 * nu)
    return length**3 / (3.0 / 12.0) + length * 2.0 * (1.0 + nu) / kappa
