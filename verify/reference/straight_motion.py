# SPDX-License-Identifier: BSD-3-Clause
"""Bodies whose points move along one direction only: finite strain, and yet exactly linear.

With u = (u1, 0, 0), G = grad u1 and F = I + e1 (x) G, det F = 1 + G1 and cof F = (1 + G1) I - G (x) e1. Put into
P = mu F + (lam (J - 1) - mu) cof F, the first row of P and the energy density are

    P_1j = mu G_j + lam G_1 delta_1j,        Psi = mu/2 |G|^2 + lam/2 G_1^2:

linear and quadratic in u1 at any amplitude, inverted elements included, on any mesh and with any material. On rollers,
which carry the other two rows, the body is a linear one with the stiffness K below. Longitudinal waves travel along e1
with sqrt((lam + mu) / rho), shear waves across it with sqrt(mu / rho). Time stepping of a linear body has closed forms,
mode by mode.
"""

from __future__ import annotations

import math

import numpy as np
import scipy.linalg as sla
import scipy.sparse as sp
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from verify.reference.elasticity import scalar_basis

Floats = NDArray[np.float64]


def straight_stiffness(disc: Discretisation, direction: int = 0) -> sp.csr_matrix:
    """K_ab = integral of mu grad N_a . grad N_b + lam d_1 N_a d_1 N_b [N/m], shape [n, n], by scikit-fem."""
    from skfem import BilinearForm

    def work(u: NDArray, v: NDArray, w: dict) -> NDArray:
        both = np.einsum("i...,i...", u.grad, v.grad)  # type: ignore[attr-defined]
        return w["mu"] * both + w["lam"] * u.grad[direction] * v.grad[direction]  # type: ignore[attr-defined]

    basis = scalar_basis(disc.mesh, degree=1, intorder=0)
    return BilinearForm(work).assemble(basis, mu=disc.mu[:, None], lam=disc.lam[:, None]).tocsr()


def lattice_frequency(speed: float, length: float, cells: int, half_waves: int = 1) -> float:
    """omega [1/s] of standing waves sin(k x), k = half_waves pi / length, between walls of a regular grid.

    omega = (2 c / d) sin(k d / 2) with d = length / cells: a chain of equal masses and springs. On a grid cut into
    Kuhn's tetrahedra every vertex inside has the share of stiffness and of lumped mass that its plane has.
    """
    d, k = length / cells, half_waves * math.pi / length
    return 2.0 * speed / d * math.sin(0.5 * k * d)


def verlet_angle(omega: Floats | float, h: float) -> Floats:
    """Phase per step of velocity Verlet: sin(theta / 2) = omega h / 2; from rest x_n = x_0 cos(n theta)."""
    return 2.0 * np.arcsin(0.5 * h * np.asarray(omega))


def backward_euler_factor(omega: Floats | float, h: float) -> NDArray[np.complex128]:
    """z_{n+1} / z_n of z = omega x - i v under backward Euler: 1 / (1 - i omega h); from rest x_n = x_0 Re factor^n.

    |factor| = 1 / sqrt(1 + omega^2 h^2) is the damping of a step, atan(omega h) its phase.
    """
    return 1.0 / (1.0 - 1j * h * np.asarray(omega))


def modes(disc: Discretisation, direction: int = 0) -> tuple[Floats, Floats]:
    """Frequencies [1/s], shape [k], and mass-orthonormal modes, shape [n, k], of the k free vertices."""
    free = np.flatnonzero(disc.free)
    K = straight_stiffness(disc, direction)[free][:, free].toarray()
    scale = 1.0 / np.sqrt(disc.mass[free])
    squares, vectors = sla.eigh(scale[:, None] * K * scale)
    shapes = np.zeros((disc.n_vertices, len(free)))
    shapes[free] = scale[:, None] * vectors
    return np.sqrt(np.maximum(squares, 0.0)), shapes
