# SPDX-License-Identifier: BSD-3-Clause
"""Uniform deformations of a stable neo-Hookean body in closed form.

From Psi = mu/2 (I_C - 3) - mu (J - 1) + lam/2 (J - 1)^2 and P = mu F + (lam (J - 1) - mu) cof F, simplified by hand for
each deformation; the von Mises norm is that of the Cauchy stress P F^T / J.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

UNIFORM_STATES = ("uniaxial", "equibiaxial", "confined", "shear", "dilation", "everted")


@dataclass(frozen=True)
class UniformState:
    """One deformation and what it does to the material.

    Parameters
    ----------
    F : Deformation gradient, shape [3, 3].
    J : Volume ratio det F.
    P : First Piola-Kirchhoff stress [Pa], shape [3, 3].
    energy : Psi [Pa].
    von_mises : Of the Cauchy stress [Pa].
    """

    F: Floats
    J: float
    P: Floats
    energy: float
    von_mises: float


def uniform_state(name: str, mu: float, lam: float) -> UniformState:
    """A named deformation of a material with the parameters mu and lam [Pa] of the energy above."""
    return {
        "uniaxial": lambda: uniaxial(1.5, mu, lam),
        "equibiaxial": lambda: equibiaxial(0.8, mu, lam),
        "confined": lambda: confined(0.6, mu, lam),
        "shear": lambda: simple_shear(0.4, mu),
        "dilation": lambda: dilation(1.2, mu, lam),
        "everted": lambda: confined(-0.7, mu, lam),
    }[name]()


def uniaxial(s: float, mu: float, lam: float) -> UniformState:
    """F = diag(s, t, t) with free sides: J = 1 + mu/lam (1 - 1/s), t^2 = J/s, P11 = mu (s - J/s^2)."""
    J = 1.0 + mu / lam * (1.0 - 1.0 / s)
    t = np.sqrt(J / s)
    stress = mu * (s - J / s**2)
    energy = 0.5 * mu * (s**2 + 2.0 * J / s - 3.0) - mu * (J - 1.0) + 0.5 * lam * (J - 1.0) ** 2
    return UniformState(np.diag([s, t, t]), J, np.diag([stress, 0.0, 0.0]), energy, abs(stress / t**2))


def equibiaxial(s: float, mu: float, lam: float) -> UniformState:
    """F = diag(s, s, t) with free thickness: t = (lam + mu) s^2 / (mu + lam s^4), P11 = P22 = mu (s - t^2/s)."""
    t = (lam + mu) * s**2 / (mu + lam * s**4)
    J = s**2 * t
    stress = mu * (s - t**2 / s)
    energy = 0.5 * mu * (2.0 * s**2 + t**2 - 3.0) - mu * (J - 1.0) + 0.5 * lam * (J - 1.0) ** 2
    return UniformState(np.diag([s, s, t]), J, np.diag([stress, stress, 0.0]), energy, abs(stress / (s * t)))


def confined(s: float, mu: float, lam: float) -> UniformState:
    """F = diag(s, 1, 1), s < 0 inside out: P11 = (lam + mu) (s - 1), P22 = P33 = (s - 1) (lam s - mu)."""
    side = (s - 1.0) * (lam * s - mu)
    P = np.diag([(lam + mu) * (s - 1.0), side, side])
    return UniformState(np.diag([s, 1.0, 1.0]), s, P, 0.5 * (lam + mu) * (s - 1.0) ** 2, mu * abs(s**2 - 1.0) / abs(s))


def simple_shear(g: float, mu: float) -> UniformState:
    """F = I + g e1 (x) e2, J = 1: P12 = P21 = mu g, Psi = mu g^2 / 2, Cauchy s12 = mu g and s11 = mu g^2."""
    F, P = np.eye(3), np.zeros((3, 3))
    F[0, 1], P[0, 1], P[1, 0] = g, mu * g, mu * g
    return UniformState(F, 1.0, P, 0.5 * mu * g**2, mu * g * np.sqrt(g**2 + 3.0))


def dilation(s: float, mu: float, lam: float) -> UniformState:
    """F = s I: P = (mu s + (lam (s^3 - 1) - mu) s^2) I."""
    stress = mu * s + (lam * (s**3 - 1.0) - mu) * s**2
    energy = 1.5 * mu * (s**2 - 1.0) - mu * (s**3 - 1.0) + 0.5 * lam * (s**3 - 1.0) ** 2
    return UniformState(s * np.eye(3), s**3, stress * np.eye(3), energy, 0.0)
