# SPDX-License-Identifier: BSD-3-Clause
"""Eigenvalues of the Hessian of single elements, and its definite part, at every kind of deformation gradient.

Elements of the rabbit are taken apart, so that the Hessian of each stands alone. A motion of its corners x_a -> x_a + G
X_a changes F by G, and forces f_a belong to a stress sum_a f_a (x) X_a / V, whatever the shape of the element: nine
motions give the 9x9 Hessian d2 Psi / dF2 of each.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation, discretise
from femgal.kernels.backend import Precision
from meshes.types import TetMesh
from verify.problems.bodies import mesh, rng
from verify.reference.elasticity import AssembledElasticity
from verify.suite.case import PRECISIONS, Kind, Measurement, case
from verify.suite.measure import compare
from verify.suite.use import Use

Floats = NDArray[np.float64]

COUNT = 100
GRADIENTS = ("rest", "random", "inverted", "singular")

_SMITH = "Smith, de Goes, Kim 2019"
_FORMULA = (
    "mu + c s_k, mu - c s_k, and those of mu I + lam z z^T + c [0 s2 s1; s2 0 s0; s1 s0 0], z = (s1 s2, s2 s0, s0 s1)"
)


@cache
def separate_elements() -> Discretisation:
    """Elements of the rabbit that share no vertex, with E over two decades and nu from 0 to 0.48."""
    whole = mesh("rabbit")
    cells = whole.cells[:: len(whole.cells) // COUNT][:COUNT]
    apart = TetMesh(whole.points[cells].reshape(-1, 3), np.arange(4 * COUNT, dtype=np.int32).reshape(-1, 4))
    E, nu = 10.0 ** rng(631).uniform(4.0, 6.0, COUNT), rng(632).uniform(0.0, 0.48, COUNT)
    return discretise(apart, E, nu, 1000.0)


@cache
def gradients(name: str) -> Floats:
    """A deformation gradient for each element, shape [COUNT, 3, 3]: of full rank, inverted, or of rank 2, 1 and 0."""
    random = rng(633)
    Q, R = (np.linalg.qr(random.standard_normal((COUNT, 3, 3)))[0] for _ in range(2))
    stretches = random.uniform(0.5, 1.5, (COUNT, 3))
    return {
        "rest": np.repeat(np.eye(3)[None], COUNT, axis=0),
        "random": np.eye(3) + 0.4 * random.standard_normal((COUNT, 3, 3)),
        "inverted": np.diag([-1.0, 1.1, 0.9]) + 0.1 * random.standard_normal((COUNT, 3, 3)),
        "singular": (Q * (stretches * np.tri(3, k=-1)[np.arange(COUNT) % 3])[:, None]) @ R,
    }[name]


def mapped(F: Floats) -> Floats:
    """Corners moved by F about the first corner of each element [m], shape [4 COUNT, 3]."""
    corners = separate_elements().mesh.points.reshape(-1, 4, 3)
    return ((corners - corners[:, :1]) @ F.transpose(0, 2, 1)).reshape(-1, 3)


def element_hessians(product: Callable[[Floats], Floats]) -> Floats:
    """d2 Psi / dF2 [Pa] of each element from products of the Hessian of all, shape [COUNT, 9, 9]."""
    disc = separate_elements()
    corners = disc.mesh.points.reshape(-1, 4, 3)
    columns = []
    for G in np.eye(9).reshape(9, 3, 3):
        forces = product(mapped(np.broadcast_to(G, (COUNT, 3, 3)))).reshape(-1, 4, 3)
        stress = np.einsum("eai,eaj->eij", forces, corners - corners[:, :1]) / disc.V[:, None, None]
        columns.append(stress.reshape(-1, 9))
    return np.stack(columns, axis=2)


def production_hessians(use: Use, precision: Precision, name: str, *, definite: bool = False) -> Floats:
    """Of production's products, symmetrised, shape [COUNT, 9, 9]."""
    x, backend = _positions(name), use.backend(separate_elements(), precision)
    return _symmetric(element_hessians(lambda d: backend.hessian_product(x, d, definite=definite)))


@cache
def assembled_hessians(name: str) -> Floats:
    """Of the assembled matrix, symmetrised, shape [COUNT, 9, 9]."""
    disc = separate_elements()
    H = AssembledElasticity(disc.mesh, disc.mu, disc.lam).hessian(_positions(name))
    return _symmetric(element_hessians(lambda d: H @ d.ravel()))


def analytic_eigenvalues(F: Floats, mu: Floats, lam: Floats) -> Floats:
    """Ascending eigenvalues of d2 Psi / dF2 from singular values, the last of which has the sign of det F; [k, 9]."""
    s = np.linalg.svd(F, compute_uv=False)
    s[:, 2] *= np.where(np.linalg.det(F) < 0.0, -1.0, 1.0)
    s0, s1, s2 = s.T
    c = lam * (s0 * s1 * s2 - 1.0) - mu
    z = np.stack([s1 * s2, s2 * s0, s0 * s1], axis=1)
    block = lam[:, None, None] * z[:, :, None] * z[:, None] + mu[:, None, None] * np.eye(3)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        block[:, i, j] += c * s[:, k]
        block[:, j, i] += c * s[:, k]
    pairs = c[:, None] * s
    values = [mu[:, None] + pairs, mu[:, None] - pairs, np.linalg.eigvalsh(block)]
    return np.sort(np.concatenate(values, axis=1), axis=1)


_ELEMENT = {"unit": "1", "kind": Kind.CLOSED_FORM, "formula": _FORMULA, "source": _SMITH}
_ROUNDING = {"float64": 1e-13, "float32": 5e-6}


@case(
    "eigenvalues/production",
    title="The nine eigenvalues of an element's Hessian are the analytic ones",
    quantity="largest difference of an eigenvalue, over the largest of its element",
    **_ELEMENT,
    tolerance=_ROUNDING,
    reason="unit roundoff times the share of the longest in the shortest edge and of lam in mu, up to 25",
    over={"precision": PRECISIONS, "state": GRADIENTS},
)
def production(use: Use, *, precision: Precision, state: str) -> Measurement:
    """By Hessian products of separate elements."""
    return _compare_eigenvalues(production_hessians(use, precision, state), state)


@case(
    "eigenvalues/assembled",
    title="The nine eigenvalues of an assembled element Hessian are the analytic ones",
    quantity="largest difference of an eigenvalue, over the largest of its element",
    **_ELEMENT,
    tolerance=_ROUNDING["float64"],
    reason="unit roundoff times the share of the longest in the shortest edge and of lam in mu, up to 25",
    over={"state": GRADIENTS},
    requires="scikit-fem",
)
def assembled(use: Use, *, state: str) -> Measurement:
    """What other cases call the assembled reference is itself checked here."""
    return _compare_eigenvalues(assembled_hessians(state), state)


@case(
    "eigenvalues/definite-part",
    title="The definite Hessian is the assembled one with its negative eigenvalues set to zero",
    quantity="largest difference of an entry of a 9x9 matrix, over the largest eigenvalue of its element",
    unit="1",
    kind=Kind.CROSS_CODE,
    formula="Q max(L, 0) Q^T of the assembled Q L Q^T, by a dense eigensolver",
    source="scikit-fem and LAPACK; " + _SMITH,
    tolerance=_ROUNDING,
    reason="unit roundoff times the share of the longest in the shortest edge and of lam in mu, up to 25",
    over={"precision": PRECISIONS, "state": GRADIENTS},
    requires="scikit-fem",
)
def definite_part(use: Use, *, precision: Precision, state: str) -> Measurement:
    """By definite Hessian products of separate elements."""
    values, modes = np.linalg.eigh(assembled_hessians(state))
    clamped = (modes * np.maximum(values, 0.0)[:, None]) @ modes.transpose(0, 2, 1)
    size = np.abs(values).max(axis=1)[:, None, None]
    note = f"{int((values < -1e-9 * size[:, 0]).sum())} of {values.size} eigenvalues are negative"
    return compare(production_hessians(use, precision, state, definite=True) / size, clamped / size, 1.0, note)


def _compare_eigenvalues(hessians: Floats, state: str) -> Measurement:
    disc = separate_elements()
    expected = analytic_eigenvalues(gradients(state), disc.mu, disc.lam)
    size = np.abs(expected).max(axis=1, keepdims=True)
    return compare(np.linalg.eigvalsh(hessians) / size, expected / size, 1.0)


def _positions(name: str) -> Floats:
    return mapped(gradients(name))


def _symmetric(A: Floats) -> Floats:
    return 0.5 * (A + A.transpose(0, 2, 1))
