# SPDX-License-Identifier: BSD-3-Clause
"""Largest eigenvalues: Lanczos for the step lengths of smoothers, power iteration for explicit integration."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femgal.hierarchy.layer import Layer
from femgal.kernels.backend import Backend
from femgal.timestep.potential import IncrementalPotential

Floats = NDArray[np.float64]

SEED = 60_091_837

# A small residual says that some mode has been found; it takes iterations to be sure that none is faster.
FEWEST_ITERATIONS = 30

# Vertices that are stirred in search of the fastest mode.
STIFFEST_VERTICES = 20

# Lanczos' method stops when its largest value is known to this share, not before so many products with the matrix: a
# value that has settled early may be that of the second largest eigenvalue.
LANCZOS_ACCURACY = 0.02
LEAST_LANCZOS = 14


def random_start(n: int) -> Floats:
    """A start vector with a share of every mode, the same in every run; shape [n, 3]."""
    return np.random.default_rng(SEED).standard_normal((n, 3))


def largest_frequency_squared(
    backend: Backend, x: Floats, start: Floats, *, max_iterations: int = 60, tolerance: float = 0.02
) -> tuple[float, Floats]:
    """Estimate of omega_max^2, the largest eigenvalue of M^-1 K at x [1/s^2], and its mode.

    The Rayleigh quotient theta of the iterate lies below the eigenvalue; |M^-1 K v - theta v|_M, the distance within
    which some eigenvalue lies, is added to it. After FEWEST_ITERATIONS the iteration stops when that is `tolerance`
    theta. Where many modes have nearly the largest frequency the estimate can still be low, by some per cent.

    Parameters
    ----------
    backend : Element passes.
    x : Positions [m], shape [n, 3].
    start : First iterate, such as a mode found earlier, shape [n, 3]. A mode alone would be blind to every other one
        that has become faster since, so as much of `stiffest_motion` is mixed in.
    """
    v = backend.unit_mode(backend.to_device(start))
    backend.add_scaled(v, 1.0, backend.to_device(stiffest_motion(backend, x)))
    theta = bound = 0.0
    for iteration in range(max_iterations):
        theta, bound, v = backend.power_step(x, v)
        if iteration >= FEWEST_ITERATIONS and bound <= tolerance * abs(theta):
            break
    return abs(theta) + bound, backend.unit_mode(v)


def stiffest_motion(backend: Backend, x: Floats) -> Floats:
    """A random motion, of unit mass norm, of the vertices whose own blocks are largest over their mass; shape [n, 3].

    An array of the host.

    The fastest mode of a mesh sits where its elements are smallest or most deformed.
    """
    H = backend.to_host(backend.gradient_and_blocks(backend.vertices, x, x, 0.0)[1])
    mass = backend.disc.mass[:, None]
    # |H_i|_F / m_i, within sqrt(3) of the vertex's own omega^2.
    rate = np.sqrt((H**2 @ np.array([1.0, 2.0, 2.0, 1.0, 2.0, 1.0])) / backend.disc.mass[backend.disc.free] ** 2)
    fastest = np.flatnonzero(backend.disc.free)[np.argsort(rate, kind="stable")[-STIFFEST_VERTICES:]]
    motion = np.zeros((backend.disc.n_vertices, 3))
    motion[fastest] = random_start(len(fastest))
    return motion / _mass_norm(mass, motion)


def _mass_norm(mass: Floats, v: Floats) -> float:
    return float(np.sqrt((mass * v * v).sum()))


def largest_block_jacobi_eigenvalue(
    potential: IncrementalPotential, layer: Layer, x: Floats, *, scalar: bool = False, iterations: int = 60
) -> float:
    """lambda_max(D_l^-1 A_l) of a layer, A_l = P^T (d2 phi) P at x and D_l its diagonal blocks (or diagonal).

    Lanczos' method in the inner product of D (Paige 1971), with u = D v beside every vector v so that D itself is
    never needed: D^-1 A v_j = beta_{j-1} v_{j-1} + alpha_j v_j + beta_j v_{j+1}. The largest eigenvalue of the
    tridiagonal matrix lies below lambda_max, and no farther from an eigenvalue than beta_k times the last entry of
    its eigenvector, which says when to stop.
    """
    backend = potential.backend
    x = backend.to_device(x)
    _, H = backend.gradient_and_blocks(layer, x, x, potential.inverse_h2)
    r = random_start(layer.n_nodes)
    u = np.zeros_like(r)
    alphas: list[float] = []
    betas: list[float] = []
    beta, value = 0.0, 1.0
    for _ in range(iterations):
        w = backend.to_host(backend.solve(backend.to_device(r), H, -1.0, scalar=scalar))
        beta = float(np.sqrt(max(0.0, (w * r).sum())))
        if alphas:
            value, distance = _largest_ritz(alphas, betas, beta)
            # An invariant subspace ends the recurrence: nothing is left to find.
            if beta <= 1e-10 * value or (len(alphas) >= LEAST_LANCZOS and distance <= LANCZOS_ACCURACY * value):
                break
            betas.append(beta)
        v, u, before = w / beta, r / beta, u
        d = backend.zeros(backend.disc.n_vertices)
        backend.prolong(layer, backend.to_device(v), d)
        Av = backend.to_host(backend.nodal_product(layer, x, d, potential.inverse_h2))
        alphas.append(float((Av * v).sum()))
        r = Av - alphas[-1] * u - (betas[-1] if betas else 0.0) * before
    # The blocks D^-1 A_ii are identities, so the eigenvalues average 1 and the largest is no less.
    return max(1.0, value)


def _largest_ritz(alphas: list[float], betas: list[float], beta: float) -> tuple[float, float]:
    """Largest eigenvalue of the tridiagonal matrix, and how far the nearest true one may be."""
    values, vectors = np.linalg.eigh(np.diag(alphas) + np.diag(betas, 1) + np.diag(betas, -1))
    return float(values[-1]), beta * abs(float(vectors[-1, -1]))
