# SPDX-License-Identifier: BSD-3-Clause
"""A displacement that somebody chose, and the body force and interface load that make it the exact solution.

With P = mu F + c C, c = lam (J - 1) - mu and C = cof F, the cofactor is free of divergence (Piola), so where mu and
lam are constant

    Div P = mu lap u + lam C grad J,       (grad J)_k = C_ij u_i,jk       (C = dJ/dF)

and b = -Div P needs no more than first and second derivatives of u. Where the material jumps across a plane with
normal N, from minus to plus, the equilibrium of the plane asks for the load (P_minus - P_plus) N per area.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from verify.reference.elasticity import cofactor

Floats = NDArray[np.float64]

# A function of one coordinate with its first and second derivative.
Factor = Callable[[Floats], tuple[Floats, Floats, Floats]]

# Just beside the interface [m]: kinks have two slopes on it.
_BESIDE = 1e-12


def sine(k: float, phase: float = 0.0) -> Factor:
    """sin(k s + phase)."""
    return lambda s: (np.sin(k * s + phase), k * np.cos(k * s + phase), -(k**2) * np.sin(k * s + phase))


def linear(a: float, b: float) -> Factor:
    """a + b s."""
    return lambda s: (a + b * s, np.full_like(s, b), np.zeros_like(s))


def kink(b: float, at: float) -> Factor:
    """s + b |s - at|."""
    return lambda s: (s + b * np.abs(s - at), 1.0 + b * np.sign(s - at), np.zeros_like(s))


class ManufacturedField:
    """u_i = amplitude f_i(x) g_i(y) h_i(z); points have shape [3, ...].

    Parameters
    ----------
    factors : (f_i, g_i, h_i) of each component.
    amplitude : [m].
    """

    def __init__(self, factors: tuple[tuple[Factor, Factor, Factor], ...], amplitude: float) -> None:
        self.factors, self.amplitude = factors, amplitude

    def displacement(self, X: Floats) -> Floats:
        """u [m], shape [3, ...]."""
        return self._product(X, (0, 0, 0))

    def gradient(self, X: Floats) -> Floats:
        """u_i,j, shape [3, 3, ...]."""
        return np.stack([self._product(X, _orders(j)) for j in range(3)], axis=1)

    def second(self, X: Floats) -> Floats:
        """u_i,jk [1/m], shape [3, 3, 3, ...]."""
        rows = [np.stack([self._product(X, _orders(j, k)) for k in range(3)], axis=1) for j in range(3)]
        return np.stack(rows, axis=1)

    def stress(self, X: Floats, mu: Floats | float, lam: Floats | float) -> Floats:
        """P [Pa], shape [3, 3, ...]."""
        F = self._deformation_gradient(X)
        C = cofactor(F)
        return mu * F + (lam * (_determinant(F, C) - 1.0) - mu) * C

    def body_force(self, X: Floats, mu: Floats | float, lam: Floats | float) -> Floats:
        """b = -Div P [N/m^3], shape [3, ...], where mu and lam [Pa] are constant nearby."""
        C, D2u = cofactor(self._deformation_gradient(X)), self.second(X)
        grad_J = np.einsum("ij...,ijk...->k...", C, D2u)
        return -(mu * np.einsum("ijj...->i...", D2u) + lam * np.einsum("ik...,k...->i...", C, grad_J))

    def interface_load(self, X: Floats, minus: tuple[float, float], plus: tuple[float, float]) -> Floats:
        """(P_minus - P_plus) e_x [N/m^2] on a plane x = const, shape [3, ...], from (mu, lam) on either side."""
        beside = np.zeros_like(X)
        beside[0] = _BESIDE
        return (self.stress(X - beside, *minus) - self.stress(X + beside, *plus))[:, 0]

    def _deformation_gradient(self, X: Floats) -> Floats:
        G = self.gradient(X)
        return G + np.eye(3).reshape(3, 3, *[1] * (G.ndim - 2))

    def _product(self, X: Floats, orders: tuple[int, int, int]) -> Floats:
        """Derivative of the given order along each axis, for the three components."""
        i, j, k = orders
        parts = [f(X[0])[i] * g(X[1])[j] * h(X[2])[k] for f, g, h in self.factors]
        return self.amplitude * np.stack(parts)


def smooth_field(amplitude: float = 0.1) -> ManufacturedField:
    """Sines and linear functions of all three coordinates; slopes up to 0.6 at the default amplitude."""
    pi, one = math.pi, linear(1.0, 1.0)
    s = linear(0.0, 1.0)
    rows = ((sine(pi), sine(1.0, pi / 2.0), one), (s, sine(pi), s), (s, s, sine(pi, pi / 2.0)))
    return ManufacturedField(rows, amplitude)


def kinked_field(at: float, amplitude: float = 0.1) -> ManufacturedField:
    """The same with two components whose slopes along x jump at a plane, as at an interface of materials."""
    (first, second, third), bent = smooth_field().factors, kink(0.5, at)
    return ManufacturedField((first, (bent, *second[1:]), (bent, *third[1:])), amplitude)


def _orders(*axes: int) -> tuple[int, int, int]:
    return axes.count(0), axes.count(1), axes.count(2)


def _determinant(F: Floats, C: Floats) -> Floats:
    return np.einsum("ij...,ij...->...", F, C) / 3.0
