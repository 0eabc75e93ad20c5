# SPDX-License-Identifier: BSD-3-Clause
"""Small problems that cases and tests share: meshes by name, materials, and states that hurt."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation, discretise
from femgal.hierarchy.layer import Layer, build_layer
from femgal.kernels.cpu.backend import CpuBackend
from femgal.timestep.backward_euler import BackwardEuler
from femgal.timestep.potential import IncrementalPotential
from femgal.timestep.state import MotionState
from meshes.connectivity import cell_edges
from meshes.generators import box
from meshes.make import make_tets
from meshes.ordering import reorder
from meshes.types import TetMesh
from verify.suite.case import Skip
from verify.suite.use import SEED

Floats = NDArray[np.float64]

STATES = ("rest", "random", "stretched", "inverted")

# Meshes of the suite: a distorted Kuhn grid, a regular one, an unstructured one that is always there, and two that
# FEMGAL_MESH_PATH may name: a scanned surface, and a published mesh with dihedral angles down to 0.2 degrees.
MESHES = ("box", "beam", "rabbit", "bunny", "slivers")
OWN = "own"
_VERTICES = 700


def rng(salt: int = 0) -> np.random.Generator:
    """A generator of its own for each use."""
    return np.random.default_rng(SEED + 2 * salt)


def distorted_box(cells: tuple[int, int, int] = (9, 4, 4), jitter: float = 0.12) -> TetMesh:
    """Box with cells near 0.1 m and displaced inner vertices, in Morton order."""
    size = (0.1 * cells[0], 0.11 * cells[1], 0.09 * cells[2])
    return reorder(box(size, cells, jitter=jitter, seed=SEED))[0]


def varied(mesh: TetMesh, constrained: NDArray | tuple = ()) -> Discretisation:
    """A different material in every tetrahedron: E over two decades, nu from -0.2 to 0.48, rho over one decade."""
    m, random = len(mesh.cells), rng(1)
    E, nu = 10.0 ** random.uniform(4.0, 6.0, m), random.uniform(-0.2, 0.48, m)
    return discretise(mesh, E, nu, 10.0 ** random.uniform(2.0, 3.0, m), constrained)


def uniform(mesh: TetMesh, constrained: NDArray | tuple = (), E: float = 1e5, nu: float = 0.4) -> Discretisation:
    """One material, rho = 1000 kg/m^3."""
    return discretise(mesh, E, nu, 1000.0, constrained)


def left_end(mesh: TetMesh, width: float = 1e-9) -> NDArray:
    """Vertices with x up to `width` [m] from the smallest."""
    return np.flatnonzero(mesh.points[:, 0] <= mesh.points[:, 0].min() + width)


@cache
def mesh(name: str) -> TetMesh:
    """A mesh of the suite by name, in Morton order, some hundred vertices (the published one has 4670).

    Raises
    ------
    Skip
        It is not on this machine.
    """
    if name == OWN:
        return own_body().mesh
    if name == "box":
        return distorted_box((6, 4, 4))
    if name == "beam":
        return reorder(box((1.5, 0.5, 0.5), (12, 4, 4)))[0]
    if name == "rabbit":
        return make_tets("rabbit", _VERTICES).mesh
    file = {"bunny": "bunny.ply", "slivers": "tets/ipc_bunny.msh"}[name]
    for folder in filter(None, os.environ.get("FEMGAL_MESH_PATH", "").split(os.pathsep)):
        if (Path(folder) / file).is_file():
            return make_tets(Path(folder) / file, None if file.endswith(".msh") else _VERTICES).mesh
    raise Skip(f"{Path(file).name} is not in a folder of FEMGAL_MESH_PATH")


@cache
def body(name: str, material: str = "varied", held: bool = True) -> Discretisation:
    """A mesh of the suite with a material: "varied" or "uniform"; of the user's own mesh always the user's own.

    Parameters
    ----------
    held : Whether the vertices at the low end of x are constrained; for the user's own body, those of its scene.
    """
    if name == OWN:
        return own_body()
    constrained = left_end(mesh(name), 0.1 * float(np.ptp(mesh(name).points[:, 0]))) if held else ()
    return {"varied": varied, "uniform": uniform}[material](mesh(name), constrained)


def released(disc: Discretisation) -> Discretisation:
    """The same body with nothing held."""
    return replace(disc, free=np.ones(disc.n_vertices, bool))


_own: list[Discretisation] = []


def own_body() -> Discretisation:
    """The user's body, where there is one."""
    if not _own:
        raise Skip("no mesh of one's own was given")
    return _own[-1]


def is_own(disc: Discretisation) -> bool:
    """Whether a body is the user's: any other is large enough for every case that it is in."""
    return any(disc is one for one in _own)


def use_own_body(disc: Discretisation) -> None:
    """Make a body the one that "own" stands for."""
    mesh.cache_clear()
    body.cache_clear()
    _own[:] = [disc]


def mean_edge(mesh: TetMesh) -> float:
    """Mean length of the edges [m]."""
    i, j = cell_edges(mesh.cells, len(mesh.points)).T
    return float(np.linalg.norm(mesh.points[i] - mesh.points[j], axis=1).mean())


def positions(mesh: TetMesh, state: str) -> Floats:
    """Positions [m] of a named state, shape [n, 3]; noise goes with the mean edge."""
    X, noise = mesh.points, mean_edge(mesh) * rng(2).standard_normal(mesh.points.shape)
    if state == "rest":
        return X.copy()
    if state == "random":
        return X + 0.3 * noise
    if state == "stretched":
        return X * [20.0, 0.3, 0.3] + 0.03 * noise
    if state == "inverted":
        return X * [-1.0, 0.9, 1.2] + 0.08 * noise
    raise ValueError(state)


def force_scale(disc: Discretisation, x: Floats) -> float:
    """Largest single term mu F grad N [N] of any element: what rounding of a sum of forces is relative to."""
    D = x[disc.mesh.cells[:, 1:]] - x[disc.mesh.cells[:, :1]]
    return float((disc.Vmu * np.linalg.norm(D, axis=(1, 2)) * (disc.B**2).sum(axis=1)).max())


def linear_layer(disc: Discretisation, n_nodes: int = 12) -> Layer:
    """A layer with four random parents per free vertex and barycentric weights, a few of them zero."""
    random, n = rng(3), disc.n_vertices
    parent = np.stack([random.choice(n_nodes, 4, replace=False) for _ in range(n)]).astype(np.int32)
    weight = random.dirichlet(np.ones(4), n)
    unused = random.random(n) < 0.2
    weight[unused, 3] = 0.0
    weight /= weight.sum(axis=1, keepdims=True)
    parent[unused, 3] = -1
    parent[~disc.free] = -1
    return build_layer(disc, parent, weight, n_nodes, "made up")


@dataclass(frozen=True)
class Moving:
    """Vertices that go along a straight line: positions rest + velocity t."""

    vertices: NDArray[np.int64]
    rest: Floats
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def is_fixed(self) -> bool:
        """Whether the vertices never move."""
        return not any(self.velocity)

    def positions(self, time: float) -> Floats:
        """Positions [m], shape [k, 3]."""
        return self.rest + time * np.array(self.velocity)


def march(stepper: BackwardEuler, state: MotionState, h: float, steps: int) -> list[MotionState]:
    """The given state and those after each of a number of steps of h seconds."""
    states = [state]
    for _ in range(steps):
        states.append(stepper.step(states[-1], h))
    return states


def potential_at(disc: Discretisation, xhat: Floats, h: float, inertia: float = 1.0) -> IncrementalPotential:
    """Incremental potential on one thread."""
    return IncrementalPotential(CpuBackend(disc, 1), xhat, h, inertia)


def slopes(errors: Floats, factor: float = 2.0) -> Floats:
    """Observed orders between successive errors when the parameter falls by `factor` each time."""
    errors = np.asarray(errors)
    return np.log(errors[:-1] / errors[1:]) / np.log(factor)
