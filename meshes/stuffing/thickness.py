# SPDX-License-Identifier: BSD-3-Clause
"""Where the body is thinner than the lattice can follow.

The inside lattice points sample the volume evenly. The thickness of the body at such a point is taken as its shortest
chord along the seven lattice directions. Measured on scans, a tentacled ball and a thin-walled pot at 500 to 1,000,000
vertices: the share of the volume that is lost is, within a quarter, the share thinner than 0.75 spacings, unless most
of the body is a wall of one thickness; that needs 1.4 spacings.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from meshes.jit import kernel
from meshes.stuffing.crossings import BUNDLES, Crossings, lattice_number
from meshes.stuffing.lattice import Lattice

LOST_BELOW = 0.75
WALL_NEEDS = 1.4
WALL_SHARE = 0.3
ACCEPTED_LOSS = 0.01
_FACETS_LOSE = 0.1  # at most, of a body that is not thin
_FEWEST = 5  # points below a quantile that make it one


def thin_points(sign: NDArray[np.int8], lattice: Lattice, found: Sequence[Crossings]) -> NDArray[np.float32]:
    """Thickness below WALL_NEEDS of the inside points, ascending, in units of the spacing."""
    thickness = np.full(lattice.size, np.inf, np.float32)
    for bundle, crossings in zip(BUNDLES, found, strict=True):
        _mark_thin(thickness, WALL_NEEDS, bundle.step, lattice.strides, *crossings.line_data(bundle))
    thin = thickness[thickness < WALL_NEEDS]
    thin.sort()
    return thin


def share_below(thin: NDArray[np.float32], inside: int, limit: float) -> float:
    """Share of the volume thinner than a limit <= WALL_NEEDS, in units of the spacing."""
    return float(np.searchsorted(thin, limit)) / max(inside, 1)


def sufficient_spacing(thin: NDArray[np.float32], inside: int, lost: float) -> float:
    """Spacing, as a fraction of the present one, at which at most ACCEPTED_LOSS of the volume should be lost.

    Parameters
    ----------
    thin, inside : As of a `Sample`.
    lost : Share of the volume lost at the present spacing.
    """
    by_thickness = min(
        _quantile(thin, inside, ACCEPTED_LOSS) / LOST_BELOW, _quantile(thin, inside, WALL_SHARE) / WALL_NEEDS
    )
    # Facets that cut off a smooth convex surface or an edge lose a share that falls with the square of the spacing.
    by_facets = min((ACCEPTED_LOSS / lost) ** 0.5, 1.0)
    if by_thickness >= 1.0:
        return by_facets
    return by_thickness if lost > _FACETS_LOSE else min(by_thickness, by_facets)


def _quantile(thin: NDArray[np.float32], inside: int, share: float) -> float:
    rank = int(share * inside)
    return float(thin[rank]) if _FEWEST <= rank < len(thin) else np.inf


@kernel
def _mark_thin(
    thickness: NDArray[np.float32],
    limit: float,
    step: float,
    strides: NDArray[np.int64],
    frame: NDArray[np.int64],
    low: NDArray[np.int64],
    columns: int,
    start: NDArray[np.int64],
    height: NDArray[np.float64],
    face: NDArray[np.int32],
    turn: NDArray[np.int8],
) -> None:
    for line in range(start.shape[0] - 1):
        u, v = low[0] + line // columns, low[1] + line % columns
        winding, entered = 0, 0.0
        for i in range(start[line], start[line + 1]):
            before = winding
            winding += turn[i]
            if before <= 0 < winding:
                entered = height[i]
            chord = (height[i] - entered) * step
            if winding <= 0 < before and chord < limit:
                for w in range(int(np.ceil(entered)), int(np.floor(height[i])) + 1):
                    p = lattice_number(frame, strides, u, v, w)
                    thickness[p] = min(thickness[p], chord)
