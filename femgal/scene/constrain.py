# SPDX-License-Identifier: BSD-3-Clause
"""Turns the constraints of a scene into motions of vertices."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from femgal.scene.model import Constraint
from femgal.scene.motion import Motion, make_motion
from femgal.scene.problems import Problem, SceneError
from femgal.scene.select import bounding_box, describe, describe_box, describe_point, select

Floats = NDArray[np.float64]


def make_motions(
    constraints: Sequence[Constraint], points: Floats, vertex_body: NDArray[np.int32], source: str
) -> tuple[Motion, ...]:
    """Return one motion per constraint that selects vertices; ``none = true`` gives none.

    Parameters
    ----------
    constraints : What the scene prescribes.
    points : Rest positions [m] of all vertices, shape [n, 3].
    vertex_body : Body of each vertex, shape [n].
    source : The scene, for messages.

    Raises
    ------
    SceneError
        A selector that holds no vertex, a vertex in two constraints, or no vertex left that may move.
    """
    owner = np.full(len(points), -1)
    motions = []
    for number, constraint in enumerate(constraints):
        if constraint.where.none:
            continue
        vertices = _vertices(constraint, points, vertex_body, f"constraints[{number}].where", source)
        _refuse_taken(owner, vertices, points, number, source)
        owner[vertices] = number
        motions.append(make_motion(vertices, points, constraint.path, constraint.rotation))
    if (owner >= 0).all():
        found = f"all {len(points)} vertices are constrained"
        problem = Problem("constraints", "nothing is left to move", found, "at least one free vertex")
        raise SceneError([problem], source=source)
    return tuple(motions)


def constraint_warnings(constraints: Sequence[Constraint], motions: Sequence[Motion]) -> list[str]:
    """Say which constraints hold so few vertices that the body turns about them."""
    named = [number for number, constraint in enumerate(constraints) if not constraint.where.none]
    return [
        f"constraints[{number}] holds {len(motion.vertices)} vertices only, about which the body can turn: "
        "enlarge the region or use more vertices if that is not meant"
        for number, motion in zip(named, motions, strict=True)
        if len(motion.vertices) < 3
    ]


def _vertices(
    constraint: Constraint, points: Floats, vertex_body: NDArray[np.int32], key: str, source: str
) -> NDArray[np.int64]:
    bodies = range(int(vertex_body.max()) + 1) if constraint.body is None else [constraint.body]
    found, boxes = [], []
    for body in bodies:
        members = np.flatnonzero(vertex_body == body)
        box = bounding_box(points[members])
        found.append(members[select(constraint.where, points[members], box)])
        boxes.append(f"body {body} spans {describe_box(box)}")
    vertices = np.concatenate(found)
    if not len(vertices):
        text = "; ".join([describe(constraint.where), *boxes[:4]])
        problem = Problem(key, "selects no vertex", text, "at least one vertex", "move or enlarge the region")
        raise SceneError([problem], source=source)
    return vertices


def _refuse_taken(owner: NDArray, vertices: NDArray, points: Floats, number: int, source: str) -> None:
    taken = vertices[owner[vertices] >= 0]
    if not len(taken):
        return
    other = int(owner[taken[0]])
    count, first = int((owner[taken] == other).sum()), describe_point(points[taken[0]])
    found = f"{count} vertices are in constraints[{other}] too, the first at {first} [m]"
    what = f"shares vertices with constraints[{other}]"
    problem = Problem(f"constraints[{number}]", what, found, "one constraint per vertex")
    raise SceneError([problem], source=source)
