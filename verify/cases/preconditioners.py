# SPDX-License-Identifier: BSD-3-Clause
"""Preconditioners of Newton's linear systems against dense algebra: their formula, symmetry, definiteness and worth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from femgal.assembly.transfer import Transfer
from femgal.discretisation import Discretisation
from femgal.kernels.backend import Backend
from femgal.solvers.lattice_vcycle import LatticeVCycle
from femgal.solvers.layer_cycle import LayerCycle
from femgal.solvers.mas import MAS
from femgal.solvers.pcg import Solution, solve
from femgal.solvers.preconditioner import LayerBlocks, Preconditioner
from femgal.solvers.smoother import step_lengths
from femgal.timestep.potential import IncrementalPotential
from verify.problems.bodies import body, rng
from verify.reference.corrections import Corrections, corrections_at
from verify.reference.galerkin import balanced, layers
from verify.suite.case import Kind, Measurement, case
from verify.suite.measure import at_most, compare, worst
from verify.suite.use import Use

Floats = NDArray[np.float64]

_MAKERS: Mapping[str, Callable[[Backend], Preconditioner]] = {
    "blocks": lambda backend: LayerBlocks((backend.vertices,)),
    "layers": lambda backend: LayerBlocks(layers(backend.disc, "clusters-8")),
    "layers-linear": lambda backend: LayerBlocks(layers(backend.disc, "lattice")),
    "cycle": lambda backend: LayerCycle(layers(backend.disc, "clusters-8")),
    "cycle-linear": lambda backend: LayerCycle(layers(backend.disc, "lattice")),
    "mas": MAS,
}
PRECONDITIONERS = tuple(_MAKERS)

# Inertia over elasticity: a step so long that blocks alone are of little use.
_WEIGHT = 1e-3

# Iterations that leave a hundredth of the residual of a random load, at this step; a tenth more than were counted when
# the row was written, so that a preconditioner which loses its worth is noticed.
_MOST = {"blocks": 78, "layers": 55, "layers-linear": 34, "cycle": 31, "cycle-linear": 24, "mas": 24}


@case(
    "preconditioners/formula",
    title="A preconditioner is the matrix that its formula says",
    quantity="largest entry of the difference over the largest entry",
    unit="m/N",
    kind=Kind.CROSS_CODE,
    formula=("blocks, layers: sum of P D^-1 P^T; cycle: (I - E) A^-1, E = prod (I - w P D^-1 P^T A) down and up"),
    source="A by scikit-fem, its blocks and inverses by LAPACK; P of the layers or domains, w of the production code",
    tolerance=1e-9,
    reason="condition of A of 1e5 times rounding; additive Schwarz is in single precision: see its row",
    over={"preconditioner": ("blocks", "layers", "layers-linear", "cycle", "cycle-linear")},
    requires="scikit-fem",
)
def formula(use: Use, *, preconditioner: str) -> Measurement:
    """Column by column, at rest."""
    return compare(_dense(use, preconditioner), _expected(use, preconditioner))


@case(
    "preconditioners/domains",
    title="Additive Schwarz is the sum over all domains of the inverses of their own matrices",
    quantity="largest entry of the difference over the largest entry",
    unit="m/N",
    kind=Kind.CROSS_CODE,
    formula="sum over levels and domains of C S^T (S C^T A C S^T)^-1 S C^T",
    source="A by scikit-fem, inverses by LAPACK; the domains are those of the production code",
    tolerance=1e-6,
    reason="inverses of the finest level are kept in single precision, 6e-8, of matrices with a condition of some tens",
    requires="scikit-fem",
)
def domains(use: Use) -> Measurement:
    """Column by column, at rest."""
    return compare(_dense(use, "mas"), _expected(use, "mas"))


@case(
    "preconditioners/galerkin",
    title="The V-cycle's matrices are the Hessian and its Galerkin products with the prolongations",
    quantity="largest entry of the difference over the largest entry, worst of all levels",
    unit="N/m",
    kind=Kind.CROSS_CODE,
    formula="A_0 = d2 phi, A_{l+1} = P_l^T A_l P_l",
    source="A_0 by scikit-fem; products by SciPy, P of the production code",
    tolerance=1e-12,
    reason="rounding of sums over the children of a node",
    requires="scikit-fem",
)
def galerkin(use: Use) -> Measurement:
    """A rabbit at rest, in double precision; the box is small enough to be solved without a coarse matrix."""
    disc = body("rabbit", "uniform")
    phi, exact = _potential(disc, use)
    made = LatticeVCycle(phi.backend, precision="float64")
    made.refresh(phi, disc.mesh.points)
    cycle, A, found = made._cycle, exact.A, {}
    for number, level in enumerate((*cycle.levels, cycle.bottom)):
        found[f"level {number}"] = compare(level.A.to_scipy().toarray(), A.toarray())
        if number < len(cycle.levels):
            P = _prolongation(cycle.products[number].transfer)
            A = (P.T @ A @ P).tocsr()
    if len(found) < 2:
        raise AssertionError("there is no coarse matrix: this body proves nothing")
    return worst(found)


@case(
    "preconditioners/symmetric",
    title="A preconditioner is symmetric, as conjugate gradients need it",
    quantity="largest entry of M^-1 - M^-T over the largest entry",
    unit="m/N",
    kind=Kind.IDENTITY,
    formula="r . M^-1 s = s . M^-1 r",
    source="each is a sum of symmetric terms, or a product of symmetric factors and the same in reverse",
    tolerance=1e-11,
    reason="rounding, times the condition of the blocks",
    over={"preconditioner": PRECONDITIONERS},
)
def symmetric(use: Use, *, preconditioner: str) -> Measurement:
    """Column by column, at rest."""
    M = _dense(use, preconditioner)
    return compare(M, M.T)


@case(
    "preconditioners/definite",
    title="A preconditioner is positive definite: the spectrum of M^-1 A is positive",
    quantity="1/1500 over the least eigenvalue of M^-1 A divided by the largest, as excess over 1",
    unit="1",
    kind=Kind.IDENTITY,
    formula="lambda_min(M^-1 A) >= lambda_max(M^-1 A) / 1500 > 0",
    source="M^-1 column by column, A by scikit-fem, eigenvalues of L^T M^-1 L, A = L L^T, by LAPACK",
    tolerance=0.0,
    reason="a bound, a fifth below what blocks alone have here; the ratio is negative where M is not definite",
    over={"preconditioner": PRECONDITIONERS},
    requires="scikit-fem",
)
def definite(use: Use, *, preconditioner: str) -> Measurement:
    """At rest, at a step much longer than elasticity asks for."""
    L = np.linalg.cholesky(_potential(_disc(), use)[1].A.toarray())
    values = np.linalg.eigvalsh(L.T @ _dense(use, preconditioner) @ L)
    return at_most(-float(values[0] / values[-1]), -1.0 / 1500.0, f"eigenvalues {values[0]:.3g} to {values[-1]:.3g}")


@case(
    "preconditioners/iterations",
    title="Conjugate gradients reach a hundredth of the residual within the iterations that were counted before",
    quantity="iterations over their bound, as excess",
    unit="1",
    kind=Kind.REGRESSION,
    formula="iterations <= " + ", ".join(f"{most} ({name})" for name, most in _MOST.items()),
    source="earlier counts on this system; there is no published number",
    tolerance=0.0,
    reason="a bound, a tenth above the counts",
    over={"preconditioner": PRECONDITIONERS},
)
def iterations(use: Use, *, preconditioner: str) -> Measurement:
    """A random load on the box at rest; the note has the share of the residual that was left."""
    solution = _solution(use, preconditioner, 0.01, 500)
    note = f"{solution.iterations} iterations left {solution.reduction:.2g}"
    return at_most(float(solution.iterations), float(_MOST[preconditioner]), note)


@case(
    "preconditioners/conjugate-gradients",
    title="Conjugate gradients end at the solution of the linear system",
    quantity="largest error of a displacement over the largest displacement",
    unit="m",
    kind=Kind.CROSS_CODE,
    formula="A d = b",
    source="A by scikit-fem, solved by a sparse direct solver",
    tolerance=1e-7,
    reason="the residual is reduced to 1e-10, and the condition of the preconditioned matrix is some hundreds",
    over={"preconditioner": PRECONDITIONERS},
    quick={"preconditioner": ("layers", "mas")},
    requires="scikit-fem",
)
def conjugate_gradients(use: Use, *, preconditioner: str) -> Measurement:
    """A random load on the box at rest."""
    expected = _potential(_disc(), use)[1].solution(_load().ravel())
    return compare(_solution(use, preconditioner, 1e-10, 2000).d.ravel(), expected)


def preconditioner_of(backend: Backend, name: str) -> Preconditioner:
    """A preconditioner by the name of a row."""
    return _MAKERS[name](backend)


def _disc() -> Discretisation:
    return body("box", "uniform")


@cache
def _potential(disc: Discretisation, use: Use) -> tuple[IncrementalPotential, Corrections]:
    """A long step from rest, with production's passes and as matrices of the layer of vertices."""
    phi = IncrementalPotential(use.backend(disc), disc.mesh.points, (_WEIGHT * balanced(disc)) ** -0.5)
    return phi, corrections_at(disc, (phi.backend.vertices,), disc.mesh.points, phi.inverse_h2)


def _made(use: Use, name: str) -> Preconditioner:
    phi, _ = _potential(_disc(), use)
    made = preconditioner_of(phi.backend, name)
    made.refresh(phi, _disc().mesh.points)
    return made


@cache
def _dense(use: Use, name: str) -> Floats:
    """M^-1 column by column, shape [f, f]."""
    made, f = _made(use, name), 3 * int(_disc().free.sum())
    return np.stack([made.apply(unit.reshape(-1, 3)).ravel() for unit in np.eye(f)], axis=1)


def _prolongation(transfer: Transfer) -> sp.csr_matrix:
    """P, three rows per finer and three columns per coarser node."""
    fine, slot = np.nonzero(transfer.parent >= 0)
    entries = (transfer.weight[fine, slot], (fine, transfer.parent[fine, slot]))
    return sp.kron(sp.coo_matrix(entries, shape=(transfer.n_fine, transfer.n_coarse)), sp.eye(3)).tocsr()


def _load() -> Floats:
    return rng(60).standard_normal((int(_disc().free.sum()), 3))


def _solution(use: Use, name: str, reduction: float, most: int) -> Solution:
    phi, made = _potential(_disc(), use)[0], _made(use, name)
    backend, X = phi.backend, _disc().mesh.points

    def product(p: Floats) -> Floats:
        d = np.zeros_like(X)
        backend.prolong(backend.vertices, p, d)
        return backend.nodal_product(backend.vertices, X, d, phi.inverse_h2)

    return solve(backend, product, made.apply, _load(), reduction, most)


def _expected(use: Use, name: str) -> Floats:
    """M^-1 by its formula, shape [f, f]."""
    phi, exact = _potential(_disc(), use)
    if name == "mas":
        return _of_domains(MAS(phi.backend), exact.A.toarray())
    hierarchy = "lattice" if name.endswith("linear") else "clusters-8"
    chosen = layers(_disc(), hierarchy)[: 1 if name == "blocks" else None]
    exact = corrections_at(_disc(), chosen, _disc().mesh.points, phi.inverse_h2)
    if not name.startswith("cycle"):
        return np.asarray(sum(C.toarray() for C in exact.C), np.float64)
    down = tuple(range(len(chosen)))
    E = exact.propagation((*down, *down[-2::-1]), step_lengths("spectral", phi, chosen))
    return np.asarray(np.linalg.solve(exact.A.toarray(), np.eye(len(E)) - E.T).T, np.float64)


def _of_domains(mas: MAS, A: Floats) -> Floats:
    total = np.zeros_like(A)
    for level in mas.levels:
        # A vertex belongs to one node of the level, a node to one domain.
        P = np.kron(np.eye(len(level.domain))[level.node_of], np.eye(3))
        coarse = P.T @ A @ P
        for d in range(level.n_domains):
            nodes = level.node[level.ptr[d] : level.ptr[d + 1]]
            at = (3 * nodes[:, None] + np.arange(3)).ravel()
            total += P[:, at] @ np.linalg.solve(coarse[np.ix_(at, at)], P[:, at].T)
    return total
