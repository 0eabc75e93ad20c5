# SPDX-License-Identifier: BSD-3-Clause
"""Cook's membrane and a cantilever: geometry, loads, and the answers of quadratic elements that the cases compare with.

``python -m verify.reference.bending`` computes the answers on a sequence of meshes and writes them to
``verify/reference/data/bending.json`` (some ten minutes of CPU time); ``answers()`` reads them.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from femgal.materials.stable_neo_hookean import parameters
from meshes.generators import box
from meshes.types import Origin, TetMesh
from verify.reference.elasticity import AssembledElasticity, consistent_mass, lumped_mass
from verify.reference.loads import surface_load
from verify.reference.richardson import extrapolate
from verify.reference.statics import Elasticity, LinearSolver, equilibrium

Floats = NDArray[np.float64]

DATA = Path(__file__).parent / "data" / "bending.json"

# Cells along the body, of the sequence of quadratic elements.
SEQUENCE = (4, 8, 16)

_TAPER = ((44.0, 0.0), (16.0, 44.0))
_GRAVITY = 10.0


@dataclass(frozen=True)
class Bending:
    """A body held at x = 0 that a dead load bends.

    Parameters
    ----------
    name : "cook" or "cantilever".
    nu : Poisson's ratio.
    load : Share of the load that bends the body far; 1e-6 for the limit of small strain.
    slides : Whether the held end may contract across the plane of bending: plane stress to its very end.

    Cook's membrane is 48 m long, 44 m high where it is held and 16 m where a shear load of 0.0375 E per area acts
    upwards (Cook 1974), 12 m thick with both faces free: between plane stress and plane strain. Half as thick it
    buckles sideways under that load. In the limit of small strain it is 3 m thick, and in plane stress where it slides.
    The cantilever is 1 x 1/2 x 1/2 m^3, of 1000 kg/m^3, and bends under its own weight.
    """

    name: str
    nu: float
    load: float = 1.0
    slides: bool = False

    @property
    def key(self) -> str:
        """Name of the answer."""
        return f"{self.name} nu={self.nu:.4g} load={self.load:g}" + " slides" * self.slides

    @property
    def young(self) -> float:
        """Young's modulus [Pa]."""
        return {"cook": 1e5, "cantilever": 2e5}[self.name]

    @property
    def thickness(self) -> float:
        """Of Cook's membrane [m]."""
        return 12.0 if self.load == 1.0 else 3.0

    def shape(self, n: int) -> tuple[int, int, int]:
        """Grid cells along x, y, z of a mesh with n cells along the body."""
        if self.name == "cantilever":
            return n, n // 2, n // 2
        return n, n, max(1, round(n * self.thickness / 48.0))

    def mesh(self, n: int) -> TetMesh:
        """Kuhn's tetrahedra of a mapped grid."""
        unit = box(cells=self.shape(n))
        s, t, r = unit.points.T
        if self.name == "cantilever":
            return TetMesh(np.stack([s, t / 2.0, r / 2.0], axis=1), unit.cells, Origin(self.name))
        (left, y0), (right, y1) = _TAPER
        y = (1.0 - s) * (y0 + left * t) + s * (y1 + right * t)
        return TetMesh(np.stack([48.0 * s, y, self.thickness * r], axis=1), unit.cells, Origin(self.name))

    def free(self, nodes: Floats) -> NDArray[np.bool_]:
        """Components that may move, shape [n, 3]."""
        held = np.abs(nodes[:, 0]) < 1e-9
        free = np.repeat(~held[:, None], 3, axis=1)
        if self.slides:
            # One face of the plate, by symmetry its middle, keeps it from drifting away.
            free[held & (nodes[:, 2] > 1e-9), 2] = True
        return free

    def forces(self, mesh: TetMesh, degree: int) -> Floats:
        """Dead load at the nodes [N], shape [n, 3]; the weight of linear elements is lumped, as in production."""
        if self.name == "cook":
            up = np.array([0.0, 0.0375 * self.young * self.load, 0.0])[:, None, None]
            return surface_load(mesh, lambda X: X[0] > 48.0 - 1e-9, lambda X: up + 0.0 * X, degree)
        mass = lumped_mass(mesh, 1000.0) if degree == 1 else np.asarray(consistent_mass(mesh, 1000.0, 2).sum(axis=1))
        return mass.reshape(-1, 1) * np.array([0.0, 0.0, -_GRAVITY * self.load])

    def deflection(self, nodes: Floats, u: Floats) -> float:
        """Displacement along the load over that load: of Cook's membrane the middle of the loaded end [m]."""
        at_end = nodes[:, 0] > nodes[:, 0].max() - 1e-9
        if self.name == "cook":
            at_end &= np.abs(nodes[:, 1] - 52.0) < 1e-9
            return float(u[at_end, 1].mean() / self.load)
        return float(-u[at_end, 2].mean() / self.load)


PROBLEMS = (
    Bending("cook", 0.3),
    Bending("cook", 1.0 / 3.0, load=1e-6, slides=True),
    Bending("cantilever", 0.3),
    Bending("cantilever", 0.49),
    Bending("cantilever", 0.499),
)


def bend(
    problem: Bending,
    elasticity: Elasticity,
    nodes: Floats,
    degree: int,
    mesh: TetMesh,
    start: Floats,
    tolerance: float = 1e-9,
) -> Floats:
    """Displacements in equilibrium [m], shape [n, 3], from an estimate of them.

    Raises
    ------
    ArithmeticError
        Newton's method did not converge.
    """
    free = problem.free(nodes)
    load = problem.forces(mesh, degree)
    # Algebraic multigrid is slow where the material hardly changes its volume, and lost where the matrix is indefinite.
    linear: LinearSolver = "multigrid" if len(nodes) > 6000 and problem.nu < 0.4 else "direct"
    start = nodes + np.where(free, start, 0.0)
    try:
        return equilibrium(elasticity, load, free, start, tolerance=tolerance, linear=linear).x - nodes
    except ArithmeticError as failed:
        raise ArithmeticError(f"{problem.key}, {len(nodes)} nodes: {failed}") from failed


def refined(problem: Bending, u: Floats, nodes: Floats, onto: Floats, n: int, degree: int = 1) -> Floats:
    """Displacements of the nodes of a grid of n cells, interpolated at other points of the body: where to start.

    An estimate for quadratic elements on a tapered grid, whose midpoints lie a little beside it.
    """
    counts = tuple(degree * cells + 1 for cells in problem.shape(n))
    axes = tuple(np.linspace(0.0, 1.0, count) for count in counts)
    grid = np.rint(_parameters(problem, nodes) * (np.array(counts) - 1)).astype(int)
    values = np.zeros((*counts, 3))
    values[tuple(grid.T)] = u
    return RegularGridInterpolator(axes, values)(np.clip(_parameters(problem, onto), 0.0, 1.0))


def quadratic(problem: Bending, n: int) -> float:
    """Deflection [m] of quadratic elements, n cells along the body."""
    return problem.deflection(*_quadratic(problem, n, None))


def sequence(problem: Bending) -> dict[str, Any]:
    """Deflections of quadratic elements on the sequence of meshes, and what they converge to."""
    rows: list[dict[str, Any]] = []
    last = None
    for n in SEQUENCE:
        nodes, u = _quadratic(problem, n, last)
        last = (n, nodes, u)
        rows.append({"cells": problem.shape(n), "nodes": len(nodes), "deflection_m": problem.deflection(nodes, u)})
        print(problem.key, rows[-1], flush=True)
    limit = extrapolate([row["deflection_m"] for row in rows])
    return {"problem": asdict(problem), "sequence": rows, **asdict(limit)}


def _quadratic(problem: Bending, n: int, last: tuple[int, Floats, Floats] | None) -> tuple[Floats, Floats]:
    """Nodes and their displacements [m], from those of a coarser mesh where there is one."""
    mesh = problem.mesh(n)
    mu, lam = parameters(problem.young, problem.nu)
    elasticity = AssembledElasticity(mesh, mu, lam, degree=2)
    X = elasticity.nodes
    start = refined(problem, last[2], last[1], X, last[0], 2) if last else np.zeros_like(X)
    return X, bend(problem, elasticity, X, 2, mesh, start)


@cache
def answers() -> dict[str, dict[str, Any]]:
    """Committed answers by `Bending.key`: sequence, value [m], order and gci."""
    return json.loads(DATA.read_text())["answers"]


def _parameters(problem: Bending, X: Floats) -> Floats:
    """Where points lie on the unit cube, shape [n, 3]."""
    if problem.name == "cantilever":
        return X * np.array([1.0, 2.0, 2.0])
    (left, y0), (right, y1) = _TAPER
    s = X[:, 0] / 48.0
    t = (X[:, 1] - (1.0 - s) * y0 - s * y1) / ((1.0 - s) * left + s * right)
    return np.stack([s, t, X[:, 2] / problem.thickness], axis=1)


def _write() -> None:
    what = "Answers of quadratic tetrahedra (scikit-fem, verify.reference.bending) to bending problems; SI units."
    found = {problem.key: sequence(problem) for problem in PROBLEMS}
    whole = {"about": what, "command": "python -m verify.reference.bending", "answers": found}
    DATA.parent.mkdir(exist_ok=True)
    DATA.write_text(json.dumps(whole, indent=1) + "\n")


if __name__ == "__main__":
    _write()
