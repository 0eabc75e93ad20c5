# SPDX-License-Identifier: BSD-3-Clause
"""Stencils.

1. The pieces of a stencil are positive and fill the inside part exactly, whatever the cuts.
2. The two tetrahedra at a lattice face split it alike; so do all four around a long edge, alternately.
3. For every combination of extreme cuts and moves, and for random ones between, all dihedral angles lie between 9.2
   and 161.7 degrees: the bound does not depend on the surface.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from meshes.quality import dihedrals
from meshes.stuffing.lattice import CELL, DIRECTIONS, EDGES
from meshes.stuffing.stencils import ALPHA, FIRST_CUT, N_CODES, carrier, code_of, stencil, tables
from meshes.types import signed_volumes

PATTERNS = [signs for signs in product((-1, 0, 1), repeat=4) if 1 in signs]
MOVES = np.vstack([np.zeros((1, 3)), np.vstack([DIRECTIONS, -DIRECTIONS]) * np.tile(ALPHA, 2)[:, None]])


def parts_of(signs: tuple[int, ...], cuts: np.ndarray, moves: np.ndarray, tetrahedron: int = 0) -> np.ndarray:
    """Places of the ten parts of a tetrahedron, shape [n, 10, 3], from cut fractions [n, 6] and moves [n, 4, 3]."""
    vertices = CELL[tetrahedron].astype(float)
    places = np.empty((len(cuts), 10, 3))
    places[:, :4] = vertices + moves * (np.array(signs) == 0)[None, :, None]
    for e, (p, q) in enumerate(EDGES):
        places[:, FIRST_CUT + e] = vertices[p] + cuts[:, e, None] * (vertices[q] - vertices[p])
    return places


def alphas() -> np.ndarray:
    return np.array([ALPHA[4] if p // 2 == q // 2 else ALPHA[0] for p, q in EDGES])


def cut_edges(signs: tuple[int, ...]) -> list[int]:
    return [e for e, (p, q) in enumerate(EDGES) if signs[p] * signs[q] < 0]


@pytest.mark.parametrize("tetrahedron", range(12))
def test_pieces_fill_the_inside_part(tetrahedron):
    rng = np.random.default_rng(60_013 + tetrahedron)
    for signs in PATTERNS:
        values = np.array(signs) * rng.uniform(0.5, 2.0, 4)
        cuts = np.array([[values[p] / (values[p] - values[q] or 1.0) for p, q in EDGES]])
        places = parts_of(signs, cuts, np.zeros((1, 4, 3)), tetrahedron)[0]
        volumes = signed_volumes(places, np.array(stencil(tetrahedron, signs)))
        assert volumes.min() > 0
        # Share of a simplex where a linear function is positive, by random sampling in barycentric coordinates.
        weights = rng.dirichlet(np.ones(4), 20_000)
        share = (weights @ values > 0).mean()
        assert volumes.sum() / (8 / 12) == pytest.approx(share, abs=0.02)


def test_neighbours_split_a_face_alike():
    splits: dict[tuple, set] = {}
    for shift in product((-2, 0, 2), repeat=3):
        for tetrahedron, cell in enumerate(CELL):
            at = [tuple(v) for v in cell + np.array(shift)]
            for g in range(4):
                p, q, r = (v for v in range(4) if v != g)
                for a, b, c in ((p, q, r), (p, r, q), (q, r, p)):
                    key = (frozenset((at[a], at[b])), at[c])
                    splits.setdefault(key, set()).add(at[carrier(tetrahedron, a, b, c)])
    assert all(len(carriers) == 1 for carriers in splits.values())
    inside = [at for at in splits if at[0] == frozenset(((0, 0, 0), (2, 0, 0)))]
    carriers = {g: next(iter(splits[edge, g])) for edge, g in inside}
    assert len(carriers) == 4
    for g, carried_by in carriers.items():
        for other, other_by in carriers.items():
            adjacent = np.abs(np.subtract(g, other)).sum() == 2
            assert (carried_by != other_by) == adjacent


def extremes(signs: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """All combinations of extreme cuts and moves of one pattern."""
    edges, zeros = cut_edges(signs), [v for v in range(4) if signs[v] == 0]
    choices = np.array(list(product(*([range(2)] * len(edges) + [range(len(MOVES))] * len(zeros)))), int)
    choices = choices.reshape(max(len(choices), 1), len(edges) + len(zeros))
    cuts, moves = np.full((len(choices), 6), 0.5), np.zeros((len(choices), 4, 3))
    for column, e in enumerate(edges):
        cuts[:, e] = np.where(choices[:, column] == 0, alphas()[e], 1 - alphas()[e])
    for column, v in enumerate(zeros):
        moves[:, v] = MOVES[choices[:, len(edges) + column]]
    return cuts, moves


def worst(signs: tuple[int, ...], cuts: np.ndarray, moves: np.ndarray) -> tuple[float, float]:
    places = parts_of(signs, cuts, moves)
    offsets = 10 * np.arange(len(places))[:, None, None]
    cells = (np.array(stencil(0, signs)) + offsets).reshape(-1, 4).astype(np.int32)
    points = places.reshape(-1, 3)
    assert signed_volumes(points, cells).min() > 0
    found = dihedrals(points, cells)
    return found.minimum, found.maximum


def test_angles_are_bounded_for_any_surface():
    rng = np.random.default_rng(88_007)
    found = []
    for signs in PATTERNS:
        cuts, moves = extremes(signs)
        found.append(worst(signs, cuts, moves))
        between = 0.5 + (cuts - 0.5) * rng.random(cuts.shape), moves * rng.random((len(moves), 4, 1))
        found.append(worst(signs, *between))
    smallest, largest = np.min(found, axis=0)[0], np.max(found, axis=0)[1]
    assert 9.2 < smallest < 9.3
    assert 161.6 < largest < 161.7


def test_tables_hold_the_stencils():
    count, parts, cuts = tables()
    assert count.shape == (N_CODES,)
    for tetrahedron in (0, 5, 11):
        for signs in PATTERNS:
            code = code_of(signs)
            expected = stencil(tetrahedron, signs)
            assert [tuple(row) for row in parts[tetrahedron, code, : count[code]]] == expected
        for e, (p, q) in enumerate(EDGES):
            low, direction = cuts[tetrahedron, e]
            high = p + q - low
            step = CELL[tetrahedron, high] - CELL[tetrahedron, low]
            np.testing.assert_array_equal(step, DIRECTIONS[direction])
