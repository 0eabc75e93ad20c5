# SPDX-License-Identifier: BSD-3-Clause
"""Motion of the semi-discrete body without error in time: ordinary differential equations at a tight tolerance.

    x' = v,   M v' = M g - grad E(x)   at the free vertices

integrated by DOP853 (Hairer, Norsett & Wanner 1993, section II.10). Forces are summed in plain NumPy, because they are
asked for some thousand times; tests hold them against scikit-fem's. Small vibrations have closed forms: the modes of
K phi = omega^2 M phi, from a dense eigenvalue solver.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from meshes.types import TetMesh
from verify.integrators.under_test import Material, State
from verify.reference.elasticity import AssembledElasticity, cofactor, lumped_mass

Floats = NDArray[np.float64]

RELATIVE_TOLERANCE = 1e-11


def element_forces(mesh: TetMesh, material: Material) -> Callable[[Floats], Floats]:
    """Function from positions [m] to the gradient of the elastic energy [N] at all vertices, both of shape [n, 3]."""
    cells = mesh.cells
    corners = np.concatenate([np.ones((len(cells), 4, 1)), mesh.points[cells]], axis=2)
    # Rows 1 to 3 of the inverse of [1 X] are the gradients of the four shape functions.
    grad = np.ascontiguousarray(np.linalg.inv(corners)[:, 1:, :])
    volume = np.abs(np.linalg.det(corners)) / 6.0

    def gradient(x: Floats) -> Floats:
        F = np.einsum("eai,eja->ije", x[cells], grad)
        C = cofactor(F)
        J = (F * C).sum(axis=(0, 1)) / 3.0
        P = material.mu * F + (material.lam * (J - 1.0) - material.mu) * C
        out = np.zeros_like(x)
        np.add.at(out, cells, np.einsum("ije,eja->eai", volume * P, grad))
        return out

    return gradient


def exact_motion(
    mesh: TetMesh,
    material: Material,
    state: State,
    duration: float,
    path: Callable[[float], Floats] | None = None,
) -> State:
    """The state after so many seconds.

    Parameters
    ----------
    path : Positions [m] of the constrained vertices at a time [s] from the start, shape [k, 3]; they stay where they
        are when None. Their velocities in the result are those of the start.

    Raises
    ------
    RuntimeError
        The integrator gave up.
    """
    from scipy.integrate import solve_ivp

    gradient, mass = element_forces(mesh, material), lumped_mass(mesh, material.rho)[:, None]
    shape = (2, *state.x.shape)

    def rate(time: float, y: Floats) -> Floats:
        x, v = y.reshape(shape)
        if path is not None:
            x = x.copy()
            x[state.constrained] = path(time)
        a = state.gravity - gradient(x) / mass
        a[state.constrained] = 0.0
        return np.stack([v, a]).ravel()

    start = np.stack([state.x, state.v]).ravel()
    # Absolute tolerances of positions, and of velocities that would make as much in the time.
    size = np.repeat(float(np.ptp(mesh.points)) * np.array([1.0, 1.0 / duration]), start.size // 2)
    done = solve_ivp(rate, (0.0, duration), start, "DOP853", rtol=RELATIVE_TOLERANCE, atol=RELATIVE_TOLERANCE * size)
    if not done.success:
        raise RuntimeError(done.message)
    x, v = done.y[:, -1].reshape(shape)
    if path is not None:
        x[state.constrained] = path(duration)
    return replace(state, x=x, v=v)


def modes(mesh: TetMesh, material: Material, constrained: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Frequencies omega [1/s], ascending, shape [k], and modes at rest, shape [k, n, 3], phi^T M phi = 1."""
    from scipy.linalg import eigh

    free = np.setdiff1d(np.arange(len(mesh.points)), constrained)
    dofs = (3 * free[:, None] + np.arange(3)).ravel()
    K = AssembledElasticity(mesh, material.mu, material.lam).hessian(mesh.points)[dofs][:, dofs].toarray()
    root = np.sqrt(np.repeat(lumped_mass(mesh, material.rho)[free], 3))
    omega2, y = eigh(K / np.outer(root, root))
    phi = np.zeros((len(omega2), len(mesh.points), 3))
    phi[:, free] = (y / root[:, None]).T.reshape(len(omega2), len(free), 3)
    return np.sqrt(np.maximum(omega2, 0.0)), phi
