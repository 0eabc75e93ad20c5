# SPDX-License-Identifier: BSD-3-Clause
"""How much memory of a device a scene needs, before anything is put there.

Elements and (element, node) pairs are counted, their places in blocks as `femgal.kernels.cuda.layout` makes them. What
is found only by laying out is taken from bodies of 300 to 20,000 vertices (rabbit, bunny, cube; both transfers): a
block of the finest layer has SLOTS vertices per element, a coarse layer has COARSE_SLOTS slots per pair, and parts that
are not full add PADDING to the pairs.
"""

from __future__ import annotations

import numpy as np

from femgal.discretisation import Discretisation
from femgal.hierarchy.layer import Layer
from femgal.kernels.cuda.layout import REST, SIZES
from femgal.scene.model import SolverSettings
from femgal.solvers.lattice_vcycle import most_dense

# 0.45 to 0.49 in single precision, 0.56 to 0.58 in double; 0.02 to 0.07; 1.01 to 1.26.
SLOTS, COARSE_SLOTS, PADDING = 0.6, 0.08, 1.25

# Rows of three doubles per vertex: the state, what a step works on, and copies of both where steps are repeated.
VECTORS = {"newton-multigrid": 60}
OTHER_VECTORS = 44

# A step that is repeated keeps the slots of each of its passes; steps of two kinds, with new blocks and with kept ones,
# are repeated, and a third set belongs to those that are not.
KINDS = 3

# What a context, code and the driver take.
BASE = 512 * 2**20

# Bytes of an assembled block of nine in single precision with its column, twice, as new ones are sent before the old
# ones go; of a level's smoother and transfer per node; and what coarser levels add.
BLOCK, LEVEL, COARSER = 2 * 36 + 4, 160, 1.5

# Vertex block descent: bytes of the four stars around each tetrahedron, and of each end of an edge.
STAR, EDGE_END = 4 * 28, 12


def device_bytes(settings: SolverSettings, disc: Discretisation, layers: tuple[Layer, ...] = ()) -> int:
    """Bytes that a scene takes on the device, rather too many: `BASE` and `array_bytes`."""
    return BASE + array_bytes(settings, disc, layers)


def array_bytes(settings: SolverSettings, disc: Discretisation, layers: tuple[Layer, ...] = ()) -> int:
    """Bytes of all arrays of the device.

    Parameters
    ----------
    layers : Of the hierarchy, finest first; empty for solvers without one.
    """
    real, n = np.dtype(settings.precision).itemsize, disc.n_vertices
    size = SIZES[settings.precision]
    passes = KINDS * settings.iterations if settings.name in ("fas", "jacobi", "scalar-jacobi") else KINDS
    total = 24 * VECTORS.get(settings.name, OTHER_VECTORS) * n + 16 * disc.n_tets
    total += _finest(disc, size, real, passes)
    total += sum(_coarse(layer, size, real, passes * (settings.pre + settings.post)) for layer in layers[1:])
    if settings.name == "vbd":
        total += STAR * disc.n_tets + EDGE_END * _blocks(disc)
    if settings.name == "newton-multigrid" and settings.preconditioner == "v-cycle":
        total += int(COARSER * (BLOCK * _blocks(disc) + LEVEL * n)) + _dense_bottom(disc)
    return total


def _finest(disc: Discretisation, size: int, real: int, passes: int) -> int:
    """Blocks of all elements, felt by a free vertex or not, their slots, and rows of the free vertices."""
    felt = int(disc.free[disc.mesh.cells].any(axis=1).sum())
    places = _filled(felt, size) + _filled(disc.n_tets - felt, size)
    slots = int(SLOTS * disc.n_tets) + 4
    return places * (20 + REST * real) + slots * (16 + 9 * real * passes) + 64 * disc.n_vertices


def _coarse(layer: Layer, size: int, real: int, passes: int) -> int:
    """The same of a coarse layer, with its pairs, its prolongation and their transpose."""
    elements = _filled(len(layer.active), size) * (12 + REST * real) + int(SLOTS * len(layer.active)) * 4
    pairs = int(PADDING * layer.n_pairs) * (2 + 3 * real)
    slots = int(COARSE_SLOTS * layer.n_pairs) * (8 + 9 * real * passes)
    return elements + pairs + slots + 24 * layer.parent.size + 256 * layer.n_nodes


def _dense_bottom(disc: Discretisation) -> int:
    """The inverse of the coarsest matrix in double precision, twice, as a new one is sent before the old one goes."""
    free = int(disc.free.sum())
    return 2 * 8 * min(3 * free, most_dense(free)) ** 2


def _filled(elements: int, size: int) -> int:
    return -(-elements // size) * size


def _blocks(disc: Discretisation) -> int:
    """3x3 blocks of the Hessian: of a solid body with few holes, one per vertex and two per edge, n + m edges."""
    return 3 * disc.n_vertices + 2 * disc.n_tets
