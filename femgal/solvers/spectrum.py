# SPDX-License-Identifier: BSD-3-Clause
"""Largest eigenvalues by power iteration: step lengths of smoothers and the stable step of explicit integration."""

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
    mass = backend.disc.mass[:, None]
    v = np.where(backend.disc.free[:, None], start, 0.0)
    v = v / _mass_norm(mass, v) + stiffest_motion(backend, x)
    theta = bound = 0.0
    for iteration in range(max_iterations):
        v /= _mass_norm(mass, v)
        Kv = backend.hessian_product(x, v)
        theta = float((v * Kv).sum())
        w = Kv / mass
        bound = _mass_norm(mass, w - theta * v)
        v = w
        if iteration >= FEWEST_ITERATIONS and bound <= tolerance * abs(theta):
            break
    return abs(theta) + bound, v / _mass_norm(mass, v)


def stiffest_motion(backend: Backend, x: Floats) -> Floats:
    """A random motion, of unit mass norm, of the vertices whose own blocks are largest over their mass; shape [n, 3].

    The fastest mode of a mesh sits where its elements are smallest or most deformed.
    """
    _, H = backend.gradient_and_blocks(backend.vertices, x, x, 0.0)
    mass = backend.disc.mass[:, None]
    # |H_i|_F / m_i, within sqrt(3) of the vertex's own omega^2.
    rate = np.sqrt((H**2 @ np.array([1.0, 2.0, 2.0, 1.0, 2.0, 1.0])) / backend.disc.mass[backend.disc.free] ** 2)
    fastest = np.flatnonzero(backend.disc.free)[np.argsort(rate, kind="stable")[-STIFFEST_VERTICES:]]
    motion = np.zeros_like(x)
    motion[fastest] = random_start(len(fastest))
    return motion / _mass_norm(mass, motion)


def _mass_norm(mass: Floats, v: Floats) -> float:
    return float(np.sqrt((mass * v * v).sum()))


def largest_block_jacobi_eigenvalue(
    potential: IncrementalPotential, layer: Layer, x: Floats, *, scalar: bool = False, iterations: int = 30
) -> float:
    """lambda_max(D_l^-1 A_l) of a layer, A_l = P^T (d2 phi) P at x and D_l its diagonal blocks (or diagonal)."""
    backend = potential.backend
    _, H = backend.gradient_and_blocks(layer, x, x, potential.inverse_h2)
    v = random_start(layer.n_nodes)
    value = 0.0
    for iteration in range(iterations):
        d = np.zeros_like(x)
        backend.prolong(layer, v, d)
        Av = backend.nodal_product(layer, x, d, potential.inverse_h2)
        w = backend.solve(Av, H, -1.0, scalar=scalar)
        # Rayleigh quotient of D^-1 A at v in the inner product of A: converges twice as fast as the iterate's growth.
        previous, value = value, float((Av * w).sum() / (Av * v).sum())
        v = w / np.linalg.norm(w)
        if iteration >= 6 and abs(value - previous) <= 4e-3 * value:
            break
    # The blocks D^-1 A_ii are identities, so the eigenvalues average 1 and the largest is no less.
    return max(1.0, value)
