# SPDX-License-Identifier: BSD-3-Clause
"""What a mesh file holds before anything was checked."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass
class RawMesh:
    """Unchecked contents of a mesh file.

    Parameters
    ----------
    points : Vertex positions, shape [n_vertices, 2 or 3].
    blocks : Cell type (meshio's names: tetra, triangle, quad, polygon ...) and vertex indices [n_cells, width].
    data : Values per cell, by name, one array per block.
    messages : What the reader had to say.
    """

    points: NDArray
    blocks: list[tuple[str, NDArray]]
    data: dict[str, list[NDArray]] = field(default_factory=dict)
    messages: list[str] = field(default_factory=list)

    def counts(self) -> Counter[str]:
        """Cells of each type."""
        total: Counter[str] = Counter()
        for kind, cells in self.blocks:
            total[kind] += len(cells)
        return +total

    def summary(self) -> str:
        """Cell counts as text: ``12 tetra, 8 triangle``."""
        return ", ".join(f"{number} {kind}" for kind, number in self.counts().items()) or "no cells"

    def cells(self, kind: str, width: int) -> NDArray:
        """All cells of one type in file order, shape [n_cells, width]."""
        found = [np.asarray(cells).reshape(len(cells), -1) for name, cells in self.blocks if name == kind]
        return np.concatenate(found) if found else np.empty((0, width), np.int64)

    def cell_data(self, name: str, kind: str) -> NDArray:
        """Values of one name on all cells of one type in file order."""
        pairs = zip(self.blocks, self.data[name], strict=True)
        return np.concatenate([np.asarray(values) for (found, _), values in pairs if found == kind])
