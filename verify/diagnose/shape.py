# SPDX-License-Identifier: BSD-3-Clause
"""Size, slivers and edges of a mesh."""

from __future__ import annotations

import numpy as np

from meshes.quality import quality, shapes
from verify.diagnose.finding import Finding, Severity, count
from verify.diagnose.target import Target

# Bodies outside this range [m] were mostly drawn in millimetres or inches.
USUAL_SIZE = (1e-2, 100.0)
# Dihedral angles [degrees]: what meshers promise, and where solvers begin to suffer.
GOOD_ANGLE, BAD_ANGLE, AWFUL_ANGLE = 10.0, 5.0, 1.0
SPREAD_NOTED, SPREAD_BAD = 10.0, 100.0
_SHOWN = 5


def size(target: Target) -> Finding:
    """How large the bodies are, in metres, and how heavy."""
    disc, mesh = target.disc, target.disc.mesh
    extents = np.ptp(mesh.points, axis=0)
    shown = " x ".join(f"{x:.3g}" for x in extents)
    what = (
        f"{count(disc.n_vertices, 'vertex', 'vertices')}, {count(disc.n_tets, 'tetrahedron', 'tetrahedra')}, "
        f"{shown} m, {disc.V.sum():.3g} m^3, {disc.mass.sum():.3g} kg."
    )
    numbers = {
        "vertices": disc.n_vertices,
        "tets": disc.n_tets,
        "extents_m": extents,
        "volume_m3": disc.V.sum(),
        "mass_kg": disc.mass.sum(),
    }
    usual = USUAL_SIZE[0] <= extents.max() <= USUAL_SIZE[1]
    if usual:
        return Finding("size", Severity.OK, what, numbers=numbers)
    advice = "Lengths are in metres: if the file is in another unit, scale it (bodies.0.size or bodies.0.height)."
    return Finding("size", Severity.NOTE, what, advice, numbers)


def slivers(target: Target) -> Finding:
    """Tetrahedra that are nearly flat: smallest dihedral angles, and where the worst are."""
    mesh = target.disc.mesh
    angle, ratio, _ = shapes(mesh.points, mesh.cells)
    below = {limit: int((angle < limit).sum()) for limit in (AWFUL_ANGLE, BAD_ANGLE, GOOD_ANGLE)}
    worst = np.argsort(angle, kind="stable")[:_SHOWN]
    listed = [
        {"tet": int(target.numbers[e]), "angle_deg": float(angle[e]), "centroid_m": mesh.points[mesh.cells[e]].mean(0)}
        for e in worst
    ]
    numbers = {
        "smallest_angle_deg": angle.min(),
        "percentile_1_angle_deg": np.percentile(angle, 1),
        "median_angle_deg": np.median(angle),
        "below_1_deg": below[AWFUL_ANGLE],
        "below_5_deg": below[BAD_ANGLE],
        "below_10_deg": below[GOOD_ANGLE],
        "smallest_radius_ratio": ratio.min(),
        "worst": listed,
    }
    smallest = float(angle.min())
    what = f"Smallest dihedral angle {smallest:.2g} degrees, median of all tetrahedra {np.median(angle):.2g}"
    if smallest >= GOOD_ANGLE:
        return Finding("slivers", Severity.OK, what + ".", numbers=numbers)
    bad = below[BAD_ANGLE]
    limit = BAD_ANGLE if bad else GOOD_ANGLE
    what += f"; {below[limit]:,} of {len(angle):,} below {limit:g} degrees"
    what += f", {below[AWFUL_ANGLE]:,} below 1. " if below[AWFUL_ANGLE] else ". "
    what += f"Worst {_place(target)}: " + ", ".join(f"{one['tet']} ({one['angle_deg']:.2g})" for one in listed) + "."
    advice = (
        "They shorten the explicit step, slow iterative solvers and amplify rounding (see below). Remesh there, or "
        "fill the surface anew: `femgal mesh make` keeps all angles above 10 degrees."
    )
    return Finding("slivers", Severity.WARNING if bad else Severity.NOTE, what, advice if bad else "", numbers)


def _place(target: Target) -> str:
    return "tetrahedra, as numbered in the file from 0 (degrees)" if target.from_file else "tetrahedra (degrees)"


def edges(target: Target) -> Finding:
    """How far the longest edge is from the shortest."""
    found = quality(target.disc.mesh)
    spread = found.edge_max / found.edge_min
    what = (
        f"Edges from {found.edge_min:.3g} to {found.edge_max:.3g} m, median {found.edge_median:.3g} m: the longest is "
        f"{spread:.3g} times the shortest."
    )
    numbers = {
        "shortest_m": found.edge_min,
        "median_m": found.edge_median,
        "longest_m": found.edge_max,
        "longest_over_shortest": spread,
    }
    if spread < SPREAD_NOTED:
        return Finding("edges", Severity.OK, what, numbers=numbers)
    advice = (
        "Explicit steps follow the shortest edges, errors the longest: a more even mesh is faster and no less accurate."
    )
    return Finding("edges", Severity.WARNING if spread >= SPREAD_BAD else Severity.NOTE, what, advice, numbers)
