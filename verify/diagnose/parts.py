# SPDX-License-Identifier: BSD-3-Clause
"""What hangs together, what does not, and what cannot deform."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshes.connectivity import component_labels
from meshes.surface import boundary, manifold_report
from verify.diagnose.finding import Finding, Severity, count, percent
from verify.diagnose.target import Target
from verify.diagnose.thickness import face_neighbours
from verify.problems.bodies import mean_edge

Integers = NDArray[np.int64]

# Vertices closer than this share of the mean edge are one vertex to whoever made the mesh.
SEAM = 1e-5
# Share of elements without a vertex inside the body that is worth a word.
ALL_ON_BOUNDARY = 0.5


def parts(target: Target) -> Finding:
    """Connected parts: how many, how large, and which nothing holds."""
    mesh, disc = target.disc.mesh, target.disc
    label = np.unique(component_labels(mesh.cells), return_inverse=True)[1].reshape(-1)
    n = int(label.max()) + 1
    tets = np.bincount(label[mesh.cells[:, 0]], minlength=n)
    held = np.bincount(label, ~disc.free, minlength=n) > 0
    bodies, free = len(target.scene.bodies), int((~held).sum())
    numbers = {"parts": n, "parts_not_held": free, "tets_of_parts": np.sort(tets)[::-1][:20], "bodies": bodies}
    if n <= bodies:
        return Finding("parts", Severity.OK, f"{count(n, 'connected part')}, as many as bodies.", numbers=numbers)
    sizes = ", ".join(f"{k:,}" for k in np.sort(tets)[::-1][:6]) + (", ..." if n > 6 else "")
    what = f"{n} parts that share no vertex, of {sizes} tetrahedra"
    constrained = not held.all() and held.any()
    what += f"; {free} of them held by no constraint: they move on their own." if constrained else "."
    advice = "If this should be one body, merge its vertices or join the parts; if not, all is well."
    return Finding("parts", Severity.WARNING, what, advice, numbers)


def seams(target: Target) -> Finding:
    """Vertices that lie on top of each other without being one."""
    from scipy.spatial import cKDTree

    mesh = target.disc.mesh
    near = SEAM * mean_edge(mesh)
    pairs = cKDTree(mesh.points).query_pairs(near, output_type="ndarray")
    numbers = {"pairs": len(pairs), "distance_m": near}
    if not len(pairs):
        return Finding("seams", Severity.OK, "No two vertices in one place.", numbers=numbers)
    where = ", ".join(f"{c:.4g}" for c in mesh.points[pairs[0, 0]])
    what = f"{count(len(pairs), 'pair')} of vertices in one place, the first at ({where}) m: the body is cut there."
    advice = "Merge duplicate vertices in the program that wrote the mesh, unless the cut is meant."
    return Finding("seams", Severity.PROBLEM, what, advice, {**numbers, "first_m": mesh.points[pairs[0, 0]]})


def hinges(target: Target) -> Finding:
    """Parts that are joined only in single vertices or edges."""
    cells = target.disc.mesh.cells
    joined, by_faces = len(np.unique(component_labels(cells))), _parts_by_faces(cells)
    report = manifold_report(boundary(cells))
    numbers = {
        "parts_by_vertices": joined,
        "parts_by_faces": by_faces,
        "pinched_vertices": report.pinched_vertices,
        "crowded_edges": report.crowded_edges,
    }
    if report.manifold:
        return Finding("hinges", Severity.OK, "The boundary is a closed surface without pinches.", numbers=numbers)
    what = (
        f"The boundary pinches at {count(report.pinched_vertices, 'vertex', 'vertices')} and "
        f"{count(report.crowded_edges, 'edge')}"
    )
    if by_faces > joined:
        what += f": {by_faces} parts share no face and hang together only there, as hinges without stiffness."
        advice = "Join them over faces, or separate them: a hinge turns freely and its elements are stretched at will."
        return Finding("hinges", Severity.WARNING, what, advice, numbers)
    return Finding("hinges", Severity.NOTE, what + ".", "Stress is not to be trusted there.", numbers)


def stuck(target: Target) -> Finding:
    """Elements that cannot deform freely: without a free vertex, or without one inside the body."""
    disc, cells = target.disc, target.disc.mesh.cells
    outside = np.zeros(disc.n_vertices, bool)
    outside[boundary(cells)] = True
    on_boundary = int(outside[cells].all(axis=1).sum())
    fixed = int((~disc.free[cells]).all(axis=1).sum())
    share = on_boundary / disc.n_tets
    numbers = {"all_on_boundary": on_boundary, "all_fixed": fixed, "share_on_boundary": share}
    what = (
        f"{on_boundary:,} of {disc.n_tets:,} tetrahedra have all vertices on the boundary ({percent(share)}), "
        f"{fixed:,} have no free vertex."
    )
    if share < ALL_ON_BOUNDARY:
        return Finding("boundary elements", Severity.OK, what, numbers=numbers)
    advice = "Most of the body is one element thick: see bending below. Ask for more vertices."
    return Finding("boundary elements", Severity.WARNING, what, advice, numbers)


def _parts_by_faces(cells: NDArray[np.int32]) -> int:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    neighbour = face_neighbours(cells)
    element, face = np.nonzero(neighbour >= 0)
    other = neighbour[element, face]
    m = len(cells)
    return int(connected_components(coo_array((np.ones(len(other)), (element, other)), (m, m)), directed=False)[0])
