# SPDX-License-Identifier: BSD-3-Clause
"""Multilevel additive Schwarz preconditioner (Wu, Wang & Wang 2022, "MAS").

    M^-1 = sum over levels l and domains d of  C_l S_ld^T (S_ld C_l^T A C_l S_ld^T)^-1 S_ld C_l^T

C_l moves all vertices of a node of level l alike (3 unknowns per node), S_ld picks the nodes of one domain. On level 0
nodes are the free vertices; a domain of one level is a node of the next. All domains of all levels see the same
residual. Where the paper leaves something open, or this departs from it:

1. Domains are connected clusters of about 32 nodes from Lloyd's iteration, not runs of 32 along a space-filling curve:
   they are compact, and need not be split into their connected parts. Their sizes vary, by a inverse of 1.7 at most.
2. Levels end where every connected part of the free vertices is one domain.
3. The matrix is assembled once from elements whose Hessians are positive semi-definite (Smith et al. 2019), in float64:
   sums over all the blocks of a stiff and light body that cancel to its inertia do not survive float32.
4. Inverses are kept in float32 on level 0, the paper's precision, and in float64 on the others, which are small and
   where stiffness exceeds inertia most. They are applied in float64, which costs no more bandwidth.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from femgal.assembly.hessian import HessianAssembly
from femgal.assembly.matrix import BlockMatrix
from femgal.kernels.backend import Backend
from femgal.kernels.cpu.threads import Workers
from femgal.schwarz.corrections import add_coarse, correct
from femgal.schwarz.domains import DomainLevel, build_levels
from femgal.schwarz.inverses import inverse_offsets, invert
from femgal.timestep.potential import IncrementalPotential

Floats = NDArray[np.float64]

# Nodes per domain: the width of a warp, for which the paper makes its domains.
SIZE = 32

# Domains are the unit of work; one takes some microseconds to apply.
_SMALLEST_SHARE = 8


@dataclass(eq=False)
class MAS:
    """A preconditioner (`femgal.solvers.preconditioner.Preconditioner`).

    Parameters
    ----------
    backend : Of the bodies; work is shared by as many threads, whose number changes no bit.
    size : Nodes per domain aimed at.
    """

    backend: Backend
    size: int = SIZE
    price: float = field(default=5.0, init=False)
    levels: tuple[DomainLevel, ...] = field(init=False)
    _inverses: list[NDArray[np.floating]] = field(default_factory=list, init=False, repr=False)
    _matrix: BlockMatrix | None = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        self.levels = build_levels(self.backend.disc, self.size)
        self._at = [inverse_offsets(level) for level in self.levels]
        self._workers = Workers(self.backend.threads)
        self._assembly = HessianAssembly(self.backend.disc, "float64", self.backend.threads)

    def refresh(self, potential: IncrementalPotential, x: Floats) -> None:
        """Assemble A at x and invert the matrices of all domains."""
        self._matrix = self._assembly.assemble(x, potential.inverse_h2, out=self._matrix)
        self._inverses = self._inverses or self._room()
        pattern, values = self._matrix.pattern, self._matrix.values
        for level, at, inverse in zip(self.levels, self._at, self._inverses, strict=True):
            maps = (level.ptr, level.row_ptr, level.row, level.node_of, level.domain, level.place)
            matrix = (pattern.ptr, pattern.column, values)
            self._workers.run(invert, level.n_domains, *maps, *matrix, at, inverse, smallest_share=1)

    def _room(self) -> list[NDArray[np.floating]]:
        # A body of one level has nothing coarser that could be stiff.
        first = np.float32 if len(self.levels) > 1 else np.float64
        return [np.empty(at[-1], np.float64 if level else first) for level, at in enumerate(self._at)]

    def apply(self, r: Floats) -> Floats:
        """The sum of all domains' corrections, shape [k, 3]."""
        corrections: list[Floats] = []
        for level, at, inverse in zip(self.levels, self._at, self._inverses, strict=True):
            z, coarse = np.empty_like(r), np.empty((level.n_domains, 3))
            arguments = (level.ptr, level.node, at, inverse, r, z, coarse)
            self._workers.run(correct, level.n_domains, *arguments, smallest_share=_SMALLEST_SHARE)
            corrections.append(z)
            r = coarse
        for level, z, coarse in reversed(list(zip(self.levels, corrections, corrections[1:], strict=False))):
            self._workers.run(add_coarse, len(z), level.domain, coarse, z)
        return corrections[0]
