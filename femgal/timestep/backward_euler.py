# SPDX-License-Identifier: BSD-3-Clause
"""Backward Euler (Lu et al. 2025, Eq. 1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from femgal.timestep.implicit import ImplicitMethod, Past
from femgal.timestep.state import MotionState


@dataclass(eq=False)
class BackwardEuler(ImplicitMethod):
    """v_{n+1} = (x_{n+1} - x_n) / h: first order, and never gains energy, however long the step."""

    # A solver that maps the prediction to x = T xhat gives x_{n+1} = T (2 x_n - x_{n-1}), bounded for -1/3 <= T <= 1.
    least_response: ClassVar[float] = -1.0 / 3.0

    def past(self, state: MotionState, h: float) -> Past:
        """The last state."""
        return Past(state.x, state.v, h)

    def effective_step(self, h: float) -> float:
        """The step itself."""
        return h
