# SPDX-License-Identifier: BSD-3-Clause
"""Meshes with something wrong, and what is to be found about them."""

from __future__ import annotations

import numpy as np

from femgal.scene.load import parse_scene
from meshes.generators import box
from meshes.io.tets import write_tets
from meshes.types import TetMesh
from verify.diagnose.target import target_of

SCENE = """
frames = 4
[[bodies]]
mesh = {mesh}
E = {E}
nu = {nu}
rho = {rho}
{more}
"""

HELD = "[[constraints]]\nwhere = {{halfspace = {{point = [{x}, 0.5, 0.5], normal = [-1, 0, 0]}}, relative = true}}"


def beside(mesh, shift):
    """The mesh and a copy of it, moved, sharing nothing."""
    points = np.concatenate([mesh.points, mesh.points + shift])
    return TetMesh(points, np.concatenate([mesh.cells, mesh.cells + len(mesh.points)]))


def welded(mesh):
    """The same mesh with vertices in one place made one."""
    keys = np.round(mesh.points * 1e6).astype(np.int64)
    _, first, index = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return TetMesh(mesh.points[first], index.reshape(-1)[mesh.cells])


def block(cells=(4, 2, 2), size=(1.0, 0.5, 0.5)):
    return box(size, cells)


def scene_of(folder, mesh, E=1e6, nu=0.4, rho=1000.0, more=""):
    """A scene of one mesh, which is written to a file in its own order."""
    import json

    path = folder / "mesh.vtu"
    write_tets(path, mesh)
    return parse_scene(SCENE.format(mesh=json.dumps(str(path)), E=E, nu=nu, rho=rho, more=more), "diagnosed.toml")


def target(folder, mesh, **material):
    return target_of(scene_of(folder, mesh, **material))
