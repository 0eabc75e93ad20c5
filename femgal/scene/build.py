# SPDX-License-Identifier: BSD-3-Clause
"""Builds the arrays of a scene: one mesh of all bodies, its materials, its start and what is prescribed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femgal.scene.constrain import constraint_warnings, make_motions
from femgal.scene.initial import initial_positions
from femgal.scene.material import Material, material, material_warnings
from femgal.scene.model import Body, Scene
from femgal.scene.motion import Motion
from femgal.scene.place import placed
from femgal.scene.problems import Problem, SceneError
from meshes.errors import InputError
from meshes.types import Origin, TetMesh

Floats = NDArray[np.float64]
Integers = NDArray[np.int32]

# Positions [m] and velocities [m/s] beyond this are taken for mistakes; files hold them in single precision.
LARGEST = 1e12


@dataclass(frozen=True, eq=False)
class World:
    """Everything that a simulation starts from; n vertices, m tetrahedra of all bodies, body after body.

    Parameters
    ----------
    mesh : Rest configuration, each body in Morton order, region ids kept.
    body, vertex_body : Body of each tetrahedron, shape [m], and of each vertex, shape [n]; int32.
    E, nu, rho : Young's modulus [Pa], Poisson's ratio and density [kg/m^3] of each tetrahedron, shape [m].
    x0, v0 : Start positions [m] and velocities [m/s], shape [n, 3]; constrained vertices are where their motion
        has them at time zero and move with its slope.
    motions : Prescribed motions; no vertex is in two of them.
    warnings : What the user should know, one sentence each.
    origins : Per body: name, source, sha256, terms, vertices, tets, messages and stuffing report of its mesh.
    """

    mesh: TetMesh
    body: Integers
    vertex_body: Integers
    E: Floats
    nu: Floats
    rho: Floats
    x0: Floats
    v0: Floats
    motions: tuple[Motion, ...]
    warnings: tuple[str, ...]
    origins: list[dict[str, Any]]


@dataclass(frozen=True, eq=False)
class _Part:
    """One body, built."""

    mesh: TetMesh
    material: Material
    x0: Floats
    v0: Floats
    origin: dict[str, Any]
    warnings: list[str]


def build_world(scene: Scene) -> World:
    """Make the meshes of a scene and everything that is defined on them.

    Raises
    ------
    SceneError
        A mesh that cannot be made; a region, constraint or pull that selects nothing; a vertex in two constraints;
        no free vertex.
    InputError
        Positions or velocities at the start are out of bounds.
    """
    made = _make_meshes(scene)
    parts = [
        _build_part(b, m, f"bodies[{i}]", scene.name) for i, (b, m) in enumerate(zip(scene.bodies, made, strict=True))
    ]
    mesh = _joined([part.mesh for part in parts])
    body = np.repeat(np.arange(len(parts), dtype=np.int32), [len(part.mesh.cells) for part in parts])
    vertex_body = np.repeat(np.arange(len(parts), dtype=np.int32), [len(part.mesh.points) for part in parts])
    motions = make_motions(scene.constraints, mesh.points, vertex_body, scene.name)
    x0, v0 = (np.concatenate(arrays) for arrays in zip(*((part.x0, part.v0) for part in parts), strict=True))
    for motion in motions:
        x0[motion.vertices] = motion.positions(0.0)
        v0[motion.vertices] = motion.velocities(0.0)
    E, nu, rho = (np.concatenate(values) for values in zip(*(part.material for part in parts), strict=True))
    warnings = [text for part in parts for text in part.warnings] + constraint_warnings(scene.constraints, motions)
    origins = [part.origin for part in parts]
    _check_start(mesh.points, x0, v0)
    return World(mesh, body, vertex_body, E, nu, rho, x0, v0, motions, tuple(warnings), origins)


def _check_start(X: Floats, x0: Floats, v0: Floats) -> None:
    for name, unit, values in (
        ("rest positions", "m", X),
        ("start positions", "m", x0),
        ("start velocities", "m/s", v0),
    ):
        largest = float(np.abs(values).max())
        if not largest <= LARGEST:
            raise InputError(
                f"{name} are out of bounds",
                found=f"{largest:.3g} {unit}",
                allowed=f"up to {LARGEST:.0e} {unit}",
                advice="check size, translate, velocity and initial of the bodies, and the paths",
            )


def _make_meshes(scene: Scene) -> list[Any]:
    """Make the mesh of each body; bodies that ask for the same mesh share one."""
    made: dict[tuple[str, int | None], Any] = {}
    for number, body in enumerate(scene.bodies):
        if (body.mesh, body.vertices) not in made:
            made[body.mesh, body.vertices] = _make_mesh(body, f"bodies[{number}]", scene.name)
    return [made[body.mesh, body.vertices] for body in scene.bodies]


def _build_part(body: Body, made: Any, key: str, source: str) -> _Part:
    shape = None if made.surface is None else made.surface.points
    rest = made.mesh if body.slivers is None else _with_slivers(made.mesh, body.slivers, key, source)
    mesh: TetMesh = rest.moved(placed(rest.points, body, shape))
    return _Part(
        mesh=mesh,
        material=material(body, mesh, key, source),
        x0=initial_positions(body.initial, mesh.points, f"{key}.initial", source),
        v0=np.tile(np.asarray(body.velocity), (len(mesh.points), 1)),
        origin=_origin(made),
        warnings=[*(f"{key}.mesh: {text}" for text in made.messages), *material_warnings(body, key)],
    )


def _make_mesh(body: Body, key: str, source: str) -> Any:
    from meshes.store import make_or_find_tets

    try:
        return make_or_find_tets(body.mesh, body.vertices)
    except InputError as error:
        what = f"{error.what} ({error.where})" if error.where else error.what
        found, allowed = (None if value is None else str(value) for value in (error.found, error.allowed))
        raise SceneError([Problem(f"{key}.mesh", what, found, allowed, error.advice)], source=source) from error


def _with_slivers(mesh: TetMesh, degrees: float, key: str, source: str) -> TetMesh:
    from meshes.slivers import with_slivers

    try:
        return with_slivers(mesh, degrees)
    except InputError as error:
        found, allowed = str(error.found), str(error.allowed)
        raise SceneError([Problem(f"{key}.slivers", error.what, found, allowed, error.advice)], source=source) from None


def _origin(made: Any) -> dict[str, Any]:
    origin = made.mesh.origin
    return {
        "name": origin.name,
        "source": origin.source,
        "sha256": origin.sha256,
        "terms": origin.terms,
        "vertices": len(made.mesh.points),
        "tets": len(made.mesh.cells),
        "messages": list(made.messages),
        "stuffing": made.report,
    }


def _joined(meshes: Sequence[TetMesh]) -> TetMesh:
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes[:-1])])
    return TetMesh(
        np.concatenate([mesh.points for mesh in meshes]),
        np.concatenate([mesh.cells + start for mesh, start in zip(meshes, starts, strict=True)]),
        meshes[0].origin if len(meshes) == 1 else Origin(name=", ".join(mesh.origin.name for mesh in meshes)),
        np.concatenate([mesh.regions for mesh in meshes if mesh.regions is not None]),
    )
