# SPDX-License-Identifier: BSD-3-Clause
"""The incremental potential whose minimiser is the next state of an implicit step."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femgal.hierarchy.layer import Layer
from femgal.kernels.backend import Backend

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class IncrementalPotential:
    """phi(x) = |x - xhat|^2_M / (2 h^2) (1 + alpha h) + E(x) (Lu et al. 2025, Eq. 1).

    Mass-proportional damping alpha [1/s] adds alpha |x - x_n|^2_M / (2 h); completing the square scales the inertia by
    1 + alpha h and moves xhat towards x_n, which is what `xhat` holds then.

    Parameters
    ----------
    backend : Element passes.
    xhat : Prediction of the free vertices, prescribed positions of the others [m], shape [n, 3].
    h : Time step [s]; of a multistep formula the effective one, h_e (`femgal.timestep.implicit`).
    inertia : 1 + alpha h.
    x_n : State before the step with the constrained vertices where they have to be after it [m]; None when unknown.
    least_response : Least T for which steps that always end at x = T xhat, as one sweep does on the stiffest modes,
        make a bounded motion.
    time : Of the minimiser [s]; None where it belongs to no motion.
    """

    backend: Backend
    xhat: Floats
    h: float
    inertia: float = 1.0
    x_n: Floats | None = None
    least_response: float = -1.0 / 3.0
    time: float | None = None

    @property
    def inverse_h2(self) -> float:
        """Factor of the mass in the Hessian [1/s^2]."""
        return self.inertia / self.h**2

    def elastic_acceleration(self, x: Floats) -> Floats:
        """-M^-1 grad E [m/s^2] at the minimiser x, shape [n, 3], zero at constrained vertices: (x - xhat) / h^2."""
        return self.backend.difference(x, self.xhat, self.inverse_h2)

    def value(self, x: Floats) -> float:
        """phi(x) [J]; constrained vertices, which x must hold at their prescribed positions, add nothing."""
        kinetic = 0.5 * self.inverse_h2 * float(self.backend.disc.mass @ ((x - self.xhat) ** 2).sum(axis=1))
        return kinetic + float(self.backend.energies(x)[0].sum())

    def gradient(self, x: Floats) -> Floats:
        """grad phi(x) [N] at the free vertices, shape [n, 3], zero at constrained ones."""
        g = self.backend.gradient(x)
        self.backend.add_inertia(g, x, self.xhat, self.inverse_h2)
        return g

    def hessian_product(self, x: Floats, d: Floats) -> Floats:
        """(d2 phi / dx2)(x) d [N] at the free vertices, shape [n, 3]."""
        Hd = self.backend.hessian_product(x, d)
        free = self.backend.disc.free
        Hd[free] += self.inverse_h2 * self.backend.disc.mass[free, None] * d[free]
        return Hd

    def along(self, layer: Layer, x: Floats, d: Floats) -> Floats:
        """Coefficients of t, t^2, ..., t^6 in phi(x + t d) - phi(x) [J], shape [6].

        Parameters
        ----------
        layer : Layer whose nodes make d; only its active elements are visited.
        x, d : Positions and direction [m], shape [n, 3].
        """
        coefficients = self.backend.energies_along(layer, x, d)
        coefficients[:2] += self.backend.inertia_along(x, self.xhat, d, self.inverse_h2)
        return coefficients

    def residual(self, x: Floats) -> Floats:
        """h^2 M^-1 grad phi [m], shape [n, 3]: (x - xhat) + h^2 M^-1 grad E where there is no damping."""
        return self.backend.divided_by_mass(self.gradient(x), self.h**2)

    def eps18(self, x: Floats) -> float:
        """The function of this name, of the residual at x [m]."""
        residual = self.residual(x)
        return eps18(residual, self.backend.norm(residual))


def eps18(residual: Floats, norm: float | None = None) -> float:
    """Error measure of Lu et al. 2025, Eq. 18: |residual| / sqrt(N) [m], residual of shape [N, 3].

    With `norm` its norm is known already. It falls with h^2 even where the motion is wrong; compare it only at one h.
    """
    return (float(np.linalg.norm(residual)) if norm is None else norm) / math.sqrt(len(residual))
