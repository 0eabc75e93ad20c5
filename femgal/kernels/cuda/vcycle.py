# SPDX-License-Identifier: BSD-3-Clause
"""The Galerkin V-cycle on the device: matrices are made by the CPU, each application stays on the device.

A refresh assembles and coarsens on the CPU (`femgal.assembly`), finds the smoothers' intervals there and inverts the
bottom, and sends all of it; how often that is worth it is measured in iterations (`femgal.solvers.upkeep`).
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.cuda import matrices
from femgal.kernels.cuda.node_work import NodeWork
from femgal.kernels.cuda.stream import THREADS

# A device array.
Floats = Any


class HostLevel(Protocol):
    """What is asked of a level of the host's cycle; see `femgal.solvers.multigrid.Level`."""

    A: Any

    @property
    def inverse_blocks(self) -> NDArray[np.floating]:
        """Inverse diagonal blocks, shape [k, 6]."""

    @property
    def coefficients(self) -> list[tuple[float, float]]:
        """Of the smoother's polynomial."""


class DeviceLevel:
    """One matrix with its smoother.

    Parameters
    ----------
    work : Arrays and launches.
    level : Of the host; its values may change between calls of `refresh`.
    """

    def __init__(self, work: NodeWork, level: HostLevel) -> None:
        self._work, self._level = work, level
        pattern = level.A.pattern
        self._ptr, self._column = work.put(pattern.ptr), work.put(pattern.column)
        self.n_rows = level.A.n_rows
        self.refresh()

    def refresh(self) -> None:
        """Send the present values."""
        put = self._work.put
        self._values = put(self._level.A.values.astype(np.float32, copy=False))
        self._inverse = put(self._level.inverse_blocks.astype(np.float32, copy=False))
        self._coefficients = self._level.coefficients

    def solve(self, r: Floats) -> Floats:
        """What the polynomial makes of A^-1 r."""
        (_, b), *steps = self._coefficients
        x = self._work.pool.take(r.shape)
        self._work.stream.over_rows(matrices.scale_blocks, self.n_rows, self._inverse, b, r, x)
        return self._iterate(steps, r, x)

    def smooth(self, r: Floats, x: Floats) -> Floats:
        """x improved, in another array."""
        return self._iterate(self._coefficients, r, x)

    def _iterate(self, steps: list[tuple[float, float]], r: Floats, x: Floats) -> Floats:
        take, before, d = self._work.pool.take, x, self._work.pool.take(r.shape)
        matrix = (self._ptr, self._column, self._values, self._inverse)
        for a, b in steps:
            out = take(r.shape)
            self._work.stream.over_rows(matrices.smooth_rows, self.n_rows, *matrix, a, b, r, x, before, d, out)
            x, before = out, d
        return x

    def product(self, x: Floats) -> Floats:
        """A x, an array of its own."""
        nothing = self._work.zeros(self.n_rows)
        out = self._work.zeros(self.n_rows)
        self._work.add_scaled(out, -1.0, self.residual(nothing, x))
        return out

    def residual(self, r: Floats, x: Floats) -> Floats:
        """r - A x."""
        out = self._work.pool.take(r.shape)
        matrix = (self._ptr, self._column, self._values)
        self._work.stream.over_rows(matrices.subtract_product, self.n_rows, *matrix, x, r, out)
        return out


class DenseInverse:
    """The bottom, multiplied by its inverse."""

    def __init__(self, work: NodeWork, bottom: Any) -> None:
        self._work, self._bottom = work, bottom
        self.refresh()

    def refresh(self) -> None:
        """Send the present inverse."""
        self._inverse = self._work.put(self._bottom.inverse())

    def solve(self, r: Floats) -> Floats:
        """A^-1 r."""
        x = self._work.pool.take(r.shape)
        self._work.stream.over_blocks(matrices.multiply_dense, 3 * len(r), THREADS, 8 * THREADS, self._inverse, r, x)
        return x


class DeviceCycle:
    """A V-cycle; the counterpart of `femgal.solvers.multigrid.VCycle`.

    Parameters
    ----------
    work : Arrays and launches.
    cycle : Of the host, refreshed.
    """

    def __init__(self, work: NodeWork, cycle: Any) -> None:
        self._work = work
        self._levels = [DeviceLevel(work, level) for level in cycle.levels]
        dense = hasattr(cycle.bottom, "inverse")
        self._bottom = DenseInverse(work, cycle.bottom) if dense else DeviceLevel(work, cycle.bottom)
        self._transfers = [_transfer(work, product.transfer) for product in cycle.products]

    def refresh(self) -> None:
        """Send what the host's cycle has now."""
        for level in (*self._levels, self._bottom):
            level.refresh()

    def product(self, p: Floats) -> Floats:
        """The finest matrix times p."""
        return self._levels[0].product(p)

    def solve(self, r: Floats, number: int = 0) -> Floats:
        """One cycle for A x = r from zero, on a level and all below it."""
        if number == len(self._levels):
            return self._bottom.solve(r)
        level, (k, down, up), work = self._levels[number], self._transfers[number], self._work
        x, right = level.solve(r), work.pool.take((k, 3))
        work.stream.over_rows(matrices.restrict_rows, k, *down, level.residual(r, x), right)
        work.stream.over_rows(matrices.prolong_rows, len(x), *up, self.solve(right, number + 1), x)
        return level.smooth(r, x)


def _transfer(work: NodeWork, t: Any) -> tuple[int, tuple[Any, ...], tuple[Any, ...]]:
    """Number of coarse nodes, and the arguments of restriction and prolongation."""
    down = (work.put(t.child_ptr), work.put(t.child), work.put(t.child_weight.astype(np.float64)))
    return t.n_coarse, down, (work.put(t.parent), work.put(t.weight.astype(np.float64)))
