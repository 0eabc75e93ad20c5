# SPDX-License-Identifier: BSD-3-Clause
"""Who is soonest where: over size, mesh quality and stiffness over density, a map for each scene and target."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from reports.benchmark.charts import Record, stiffness
from reports.benchmark.tables import Table


def winner_maps(record: Record) -> list[Table]:
    """Maps of every scene and target."""
    scenes = dict.fromkeys(problem["scene"] for problem in record["problems"] if problem["vertices"])
    return [_map(record, scene, target) for scene in scenes for target in record["targets"]]


def _map(record: Record, scene: str, target: float) -> Table:
    problems = [p for p in record["problems"] if p["scene"] == scene and p["vertices"]]
    columns = sorted({_material(problem) for problem in problems})
    meshes = sorted(set(map(_mesh, problems)))
    at = {(_mesh(problem), _material(problem)): problem["id"] for problem in problems}
    rows = tuple(
        (_words(mesh), *(_cell(record, at.get((mesh, column)), target) for column in columns)) for mesh in meshes
    )
    materials = (f"E/rho = {ratio:.3g} (E = {E:g}, rho = {rho:g}, nu = {nu:g})" for ratio, E, rho, nu in columns)
    heads = ("vertices", *materials)
    return Table(f"{scene}: soonest at an error of {target:g}", heads, rows)


def _mesh(problem: Mapping[str, Any]) -> tuple[int, float]:
    """Vertices, and angle of the slivers [degrees]; the good mesh comes first, then ever flatter ones."""
    axes = problem["axes"]
    return axes["vertices"] or problem["vertices"], -(axes.get("slivers") or math.inf)


def _words(mesh: tuple[int, float]) -> str:
    vertices, angle = mesh
    return f"{vertices}" if angle == -math.inf else f"{vertices}, slivers of {-angle:g} degrees"


def _material(problem: Mapping[str, Any]) -> tuple[float, float, float, float]:
    return stiffness(problem), problem["E"][1], problem["rho"][0], problem["nu"][1]


def _cell(record: Record, problem: str | None, target: float) -> str:
    entries = [
        entry
        for entry in record["summary"]
        if entry["problem"] == problem and entry["target"] == target and entry["seconds"] is not None
    ]
    if not entries:
        return "-" if problem is None else "nobody"
    first, *others = sorted(entries, key=lambda entry: entry["seconds"])
    text = f"{first['curve']}, {first['seconds']:.3g} s/frame"
    return text + (f"; {others[0]['curve']} x {others[0]['seconds'] / first['seconds']:.2g}" if others else "")
