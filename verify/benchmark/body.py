# SPDX-License-Identifier: BSD-3-Clause
"""A body to time passes on: held at one end, bent, in motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation, discretise
from femgal.hierarchy.hierarchy import Hierarchy, build_constant_hierarchy
from femgal.scene.motion import Motion
from meshes.generators import box
from meshes.ordering import reorder
from meshes.types import TetMesh

Floats = NDArray[np.float64]

# A drape of a soft solid at the substeps that a scene takes when it does not say how many.
E, NU, RHO = 1e6, 0.4, 1000.0
H = 1.0 / 60.0 / 50.0
GRAVITY = np.array([0.0, 0.0, -9.81])
JITTER = 0.1
_SEED = 20_260_203


@dataclass(frozen=True, eq=False)
class BenchmarkBody:
    """A discretised body with its hierarchy and a state in which no term vanishes; n vertices.

    Parameters
    ----------
    disc : The end at the smallest x coordinates is held.
    hierarchy : Piecewise-constant layers.
    """

    disc: Discretisation
    hierarchy: Hierarchy

    @cached_property
    def x(self) -> Floats:
        """Positions [m], shape [n, 3]: bent by a few per cent, with noise, held where it is held."""
        X = self.disc.mesh.points
        size = np.ptp(X, axis=0).max()
        share = (X[:, :1] - X[:, 0].min()) / size
        noise = np.random.default_rng(_SEED).standard_normal(X.shape) / len(X) ** (1.0 / 3.0)
        bend = 0.02 * size * share * (np.sin(2.0 * np.pi / size * X[:, [1, 2, 0]]) + noise)
        return np.where(self.disc.free[:, None], X + bend, X)

    @cached_property
    def v(self) -> Floats:
        """Velocities [m/s], shape [n, 3]."""
        return np.roll(self.x - self.disc.mesh.points, 1, axis=1) / 0.1

    @cached_property
    def xhat(self) -> Floats:
        """Prediction of a step of H seconds [m], shape [n, 3]."""
        return self.x + np.where(self.disc.free[:, None], H * self.v + H * H * GRAVITY, 0.0)

    @property
    def motions(self) -> tuple[Motion, ...]:
        """The held end."""
        held = np.flatnonzero(~self.disc.free)
        return (Motion(held, self.disc.mesh.points[held]),)


def benchmark_body(mesh: TetMesh, ratio: int = 32) -> BenchmarkBody:
    """Hold a hundredth of the length of a Morton-ordered mesh and build its hierarchy."""
    x = mesh.points[:, 0]
    held = np.flatnonzero(x <= x.min() + 0.01 * np.ptp(x))
    disc = discretise(mesh, E, NU, RHO, held)
    return BenchmarkBody(disc, build_constant_hierarchy(disc, ratio))


def kuhn_box(cells: int) -> TetMesh:
    """Unit cube of cells^3 grid cells and six times as many tetrahedra, jittered, in Morton order."""
    return reorder(box(cells=(cells, cells, cells), jitter=JITTER, seed=_SEED))[0]


def few_tets() -> BenchmarkBody:
    """A body whose passes take no longer than to start them; it has one coarse layer."""
    return benchmark_body(reorder(box((2.0, 1.0, 1.0), (2, 1, 1)))[0], ratio=2)
