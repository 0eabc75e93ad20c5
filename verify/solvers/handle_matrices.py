# SPDX-License-Identifier: BSD-3-Clause
"""Galerkin matrices of affine handles: P^T A P with blocks of 12 x 12, their products, and transfer between levels.

With P_i = q_i (x) I_3 of node i in cluster I, block (I, J) is the sum over nodes i of I and j of J of
q_i^T A_ij q_j, contracted over the functions of the nodes. Every row of clusters is made by one thread from the rows of
its nodes, in their order.

Blocks are stored transposed: products then run along contiguous memory.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femgal.assembly.pattern import Pattern, sorted_pattern
from femgal.kernels.cpu.threads import Workers
from meshes.jit import kernel
from verify.solvers.handles import FUNCTIONS, Handles

Floats = NDArray[np.float64]
Reals = NDArray[np.floating]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]

UNKNOWNS = 3 * FUNCTIONS


@dataclass(frozen=True, eq=False)
class HandleMatrix:
    """A symmetric matrix over the handles of a level, c of them.

    Parameters
    ----------
    pattern : Which blocks there are.
    values : Transposed blocks, shape [blocks, 12, 12].
    workers : Threads that share the rows.
    """

    pattern: Pattern
    values: Floats
    workers: Workers

    @classmethod
    def of(cls, fine: Pattern, handles: Handles, workers: Workers) -> HandleMatrix:
        """A matrix of the pattern of P^T A P, without values yet."""
        label = handles.label.astype(np.int64)
        c = handles.n_clusters
        pairs = np.unique(np.repeat(label, np.diff(fine.ptr)) * c + label[fine.column])
        ptr = np.searchsorted(pairs, c * np.arange(c + 1))
        pattern = sorted_pattern(ptr, (pairs % c).astype(np.int32))
        return cls(pattern, np.empty((len(pairs), UNKNOWNS, UNKNOWNS)), workers)

    def project(self, fine: Pattern, transposed: Reals, handles: Handles) -> None:
        """Values of P^T A P.

        Parameters
        ----------
        fine, transposed : Pattern and transposed blocks of A, shape [blocks, 3a, 3a].
        """
        clusters = (handles.child_ptr, handles.child, handles.label, handles.q)
        mine = (self.pattern.ptr, self.pattern.column, self.values)
        self.workers.run_ragged(_project, handles.child_ptr, *clusters, fine.ptr, fine.column, transposed, *mine)
        # A function that is zero on its cluster would leave a row of zeros.
        diagonal, (at, which) = self.pattern.diagonal, np.nonzero(handles.unused())
        for r in range(3 * (len(at) > 0)):
            stiffest = self.values[diagonal[at]].max(axis=(1, 2))
            self.values[diagonal[at], 3 * which + r, 3 * which + r] = stiffest

    def product(self, d: Floats) -> Floats:
        """A d, shape [c, 12]."""
        out = np.empty_like(d)
        self.workers.run(_multiply, len(d), self.pattern.ptr, self.pattern.column, self.values, d, out)
        return out

    def diagonal_inverses(self) -> Floats:
        """Inverses of the diagonal blocks, shape [c, 12, 12]."""
        return np.asarray(np.linalg.inv(self.values[self.pattern.diagonal]), np.float64)

    def dense(self) -> Floats:
        """The whole matrix, shape [12 c, 12 c]."""
        n = self.pattern.n_rows
        out = np.zeros((n, UNKNOWNS, n, UNKNOWNS))
        row = np.repeat(np.arange(n), np.diff(self.pattern.ptr))
        out[row, :, self.pattern.column] = self.values.transpose(0, 2, 1)
        return out.reshape(UNKNOWNS * n, UNKNOWNS * n)


def restrict(handles: Handles, workers: Workers, r: Floats) -> Floats:
    """P^T r, shape [c, 12], of rows of the nodes, shape [k, 3a]."""
    out = np.zeros((handles.n_clusters, UNKNOWNS))
    workers.run_ragged(_restrict, handles.child_ptr, handles.child_ptr, handles.child, handles.q, r, out)
    return out


def prolong(handles: Handles, workers: Workers, d: Floats, x: Floats) -> None:
    """x += P d in place; rows of shape [c, 12] and [k, 3a]."""
    workers.run(_prolong, len(x), handles.label, handles.q, d, x)


def multiply_blocks(workers: Workers, blocks: Floats, r: Floats) -> Floats:
    """Symmetric blocks of shape [c, 12, 12] times rows of shape [c, 12]."""
    out = np.empty_like(r)
    workers.run(_multiply_blocks, len(r), blocks, r, out)
    return out


@kernel
def _project(
    start: int,
    stop: int,
    child_ptr: Longs,
    child: Ints,
    label: Ints,
    q: Floats,
    fine_ptr: Longs,
    fine_column: Ints,
    fine: Reals,
    ptr: Longs,
    column: Ints,
    values: Floats,
) -> None:
    a = q.shape[1]
    where = np.empty(len(child_ptr) - 1, np.int64)
    met = np.empty(len(child_ptr) - 1, np.int64)
    for I in range(start, stop):  # noqa: E741
        n = ptr[I + 1] - ptr[I]
        # Of the present node i: sum over j in J of A_ij q_j, transposed, for every J of the row.
        T = np.zeros((n, UNKNOWNS, 3 * a))
        for k in range(n):
            where[column[ptr[I] + k]] = k
        values[ptr[I] : ptr[I + 1]] = 0.0
        for c in range(child_ptr[I], child_ptr[I + 1]):
            i = child[c]
            n_met = 0
            for f in range(fine_ptr[i], fine_ptr[i + 1]):
                j = fine_column[f]
                k = where[label[j]]
                known = False
                for m in range(n_met):
                    known |= met[m] == k
                if not known:
                    met[n_met] = k
                    n_met += 1
                for beta in range(a):
                    for delta in range(FUNCTIONS):
                        w = q[j, beta, delta]
                        for s in range(3):
                            for p in range(3 * a):
                                T[k, 3 * delta + s, p] += w * fine[f, 3 * beta + s, p]
            for m in range(n_met):
                k = met[m]
                _add_outer(q[i], T[k], values[ptr[I] + k])
                T[k] = 0.0


@kernel
def _add_outer(q: Floats, T: Floats, block: Floats) -> None:
    """block += T (q (x) I_3), all transposed: shapes [a, 4], [12, 3a], [12, 12]."""
    for row in range(UNKNOWNS):
        for alpha in range(q.shape[0]):
            for gamma in range(FUNCTIONS):
                w = q[alpha, gamma]
                for r in range(3):
                    block[row, 3 * gamma + r] += w * T[row, 3 * alpha + r]


@kernel
def _multiply(start: int, stop: int, ptr: Longs, column: Ints, values: Floats, d: Floats, out: Floats) -> None:
    for i in range(start, stop):
        out[i] = 0.0
        for k in range(ptr[i], ptr[i + 1]):
            j = column[k]
            for s in range(UNKNOWNS):
                w = d[j, s]
                for p in range(UNKNOWNS):
                    out[i, p] += w * values[k, s, p]


@kernel
def _multiply_blocks(start: int, stop: int, blocks: Floats, r: Floats, out: Floats) -> None:
    for i in range(start, stop):
        out[i] = 0.0
        for s in range(UNKNOWNS):
            w = r[i, s]
            for p in range(UNKNOWNS):
                out[i, p] += w * blocks[i, s, p]


@kernel
def _restrict(start: int, stop: int, child_ptr: Longs, child: Ints, q: Floats, r: Floats, out: Floats) -> None:
    for I in range(start, stop):  # noqa: E741
        for c in range(child_ptr[I], child_ptr[I + 1]):
            i = child[c]
            for alpha in range(q.shape[1]):
                for gamma in range(FUNCTIONS):
                    for s in range(3):
                        out[I, 3 * gamma + s] += q[i, alpha, gamma] * r[i, 3 * alpha + s]


@kernel
def _prolong(start: int, stop: int, label: Ints, q: Floats, d: Floats, x: Floats) -> None:
    for i in range(start, stop):
        for alpha in range(q.shape[1]):
            for gamma in range(FUNCTIONS):
                for s in range(3):
                    x[i, 3 * alpha + s] += q[i, alpha, gamma] * d[label[i], 3 * gamma + s]
