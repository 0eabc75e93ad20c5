# SPDX-License-Identifier: BSD-3-Clause
"""Material parameters of every tetrahedron of a body, regions included."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from femgal.scene.model import Body, Region
from femgal.scene.problems import Problem, SceneError
from femgal.scene.select import bounding_box, describe, describe_box, select
from meshes.types import TetMesh

Floats = NDArray[np.float64]


class Material(NamedTuple):
    """Young's modulus [Pa], Poisson's ratio and density [kg/m^3] of each tetrahedron, shape [m]."""

    E: Floats
    nu: Floats
    rho: Floats


def material(body: Body, mesh: TetMesh, key: str, source: str) -> Material:
    """Return the material of each tetrahedron of a placed body.

    Parameters
    ----------
    body : Its E, nu, rho and regions; later regions override earlier ones.
    mesh : The placed mesh.
    key, source : Where the body stands (``bodies[0]``) in which scene, for messages.

    Raises
    ------
    SceneError
        A region id that the mesh does not have, or a selector that holds no tetrahedron.
    """
    values = Material(*(np.full(len(mesh.cells), value) for value in (body.E, body.nu, body.rho)))
    for number, region in enumerate(body.regions):
        chosen = _tetrahedra(region, mesh, f"{key}.regions[{number}]", source)
        for array, value in zip(values, (region.E, region.nu, region.rho), strict=True):
            if value is not None:
                array[chosen] = value
    return values


def material_warnings(body: Body, key: str) -> list[str]:
    """Say what is risky about a material: Poisson's ratios that let the energy favour collapse."""
    ratios = [(key, body.nu)]
    ratios += [(f"{key}.regions[{i}]", region.nu) for i, region in enumerate(body.regions) if region.nu is not None]
    return [
        f"{where}.nu = {nu:g}: for nu <= 0 a body crushed to a point can have less energy than at rest; "
        "elements that collapse may stay collapsed"
        for where, nu in ratios
        if nu <= 0.0
    ]


def _tetrahedra(region: Region, mesh: TetMesh, key: str, source: str) -> NDArray[np.bool_]:
    assert mesh.regions is not None  # filled in by TetMesh itself
    if region.where is None:
        chosen = mesh.regions == region.id
        known = ", ".join(str(number) for number in np.unique(mesh.regions)[:20])
        problem = Problem(f"{key}.id", "the mesh has no such region", str(region.id), f"one of: {known}")
    else:
        centroids = mesh.points[mesh.cells].mean(axis=1)
        box = bounding_box(mesh.points)
        chosen = select(region.where, centroids, box)
        found = f"{describe(region.where)}; the body spans {describe_box(box)}"
        problem = Problem(f"{key}.where", "selects no tetrahedron", found, "at least one centroid inside")
    if not chosen.any():
        raise SceneError([problem], source=source)
    return chosen
