# SPDX-License-Identifier: BSD-3-Clause
"""Deformation gradients that hurt, and the layout of a tile: entry j of lane l at 32 j + l."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from verify.problems.bodies import rng

LANES = 32
COUNT = 10 * LANES


def _stretched(salt: int, s: object) -> NDArray:
    """U diag(s) V^T with random orthogonal U and V, reflections too."""
    U, V = np.linalg.qr(rng(salt).standard_normal((2, COUNT, 3, 3)))[0]
    return U * np.broadcast_to(s, (COUNT, 3))[:, None, :] @ V  # type: ignore[call-overload]


def _powers(salt: int, *lowest: float) -> NDArray:
    return 10.0 ** rng(salt).uniform(lowest, 0.0, (COUNT, 3))


GRADIENTS = {
    "random": rng(400).standard_normal((COUNT, 3, 3)),
    "small strain": np.eye(3) + 1e-3 * rng(401).standard_normal((COUNT, 3, 3)),
    "rest": np.repeat(np.eye(3)[None], COUNT, axis=0),
    "rotated": _stretched(402, 1.0),
    "compressed": _stretched(403, (0.9, 0.8, 0.6)),
    "squashed": _stretched(404, (1.0, 1.0, 0.05)),
    "inverted": _stretched(405, (1.2, 0.9, -0.8)),
    "twice the largest": _stretched(406, (1.2, 1.2, 0.5)),
    "twice the smallest": _stretched(407, (1.2, 0.5, 0.5)),
    "nearly equal": _stretched(408, (1.2, 1.2 + 1e-9, 1.2 - 1e-8)),
    "flat": _stretched(409, (1.3, 0.7, 0.0)),
    "line": _stretched(410, (1.3, 0.0, 0.0)),
    "point": np.zeros((COUNT, 3, 3)),
    "nearly flat": _stretched(411, _powers(412, 0.0, -1.0, -17.0)),
    "nearly a line": _stretched(413, _powers(414, 0.0, -17.0, -17.0)),
    "long": _stretched(415, (1e3, 5.0, 0.1)),
    "tiny": _stretched(416, (1e-20, 1e-22, 1e-25)),
    # Axes exchanged, equal columns, ranks one and two, exact ties.
    "whole numbers": rng(417).integers(-1, 2, (COUNT, 3, 3)).astype(float),
    "diagonal": np.eye(3) * rng(418).choice([0.0, 1.0, 1.0, 0.5, -0.7, 2.0], (COUNT, 1, 3)),
}


def to_tiles(*tensors: NDArray, rows: int) -> NDArray:
    """Tensors, each [COUNT, 3, 3], in the first rows of tiles of `rows` rows: shape [COUNT / 32, rows * 32]."""
    tiles = np.zeros((COUNT // LANES, rows, LANES), tensors[0].dtype)
    for k, F in enumerate(tensors):
        tiles[:, 9 * k : 9 * k + 9] = F.reshape(-1, LANES, 9).transpose(0, 2, 1)
    return tiles.reshape(len(tiles), -1)


def from_tiles(tiles: NDArray, row: int, n: int = 9) -> NDArray:
    """Rows row to row + n of the tiles by lane, shape [COUNT, n]."""
    return tiles.reshape(len(tiles), -1, LANES)[:, row : row + n].transpose(0, 2, 1).reshape(COUNT, n)
