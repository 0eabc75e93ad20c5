# SPDX-License-Identifier: BSD-3-Clause
"""BDF2 with steps of any length (Hairer, Norsett & Wanner 1993, section III.5)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.backend import Backend
from femgal.timestep.implicit import ImplicitMethod, Past
from femgal.timestep.state import MotionState

Floats = NDArray[np.float64]

# Zero-stable up to this ratio of a step to the one before it.
LARGEST_RATIO = 1.0 + math.sqrt(2.0)


@dataclass(eq=False)
class BDF2(ImplicitMethod):
    """Second order; the first step, and one far longer than that before it, is backward Euler's.

    With r = h_n / h_{n-1}: y = ((1 + r)^2 x_n - r^2 x_{n-1}) / (1 + 2 r), w likewise of v, h_e = h (1 + r) / (1 + 2 r);
    for equal steps y = (4 x_n - x_{n-1}) / 3 and h_e = 2 h / 3. The velocities of vertices with prescribed motion
    follow the same formula.
    """

    # A solver that maps the prediction to x = T xhat gives x_{n+1} = T (24 x_n - 22 x_{n-1} + 8 x_{n-2} - x_{n-3}) / 9,
    # which alternates without growing for T = -9/55.
    least_response: ClassVar[float] = -9.0 / 55.0

    def past(self, state: MotionState, h: float) -> Past:
        """The last two states, or the last one where there is no other to use."""
        memory = state.memory
        r = h / float(memory["h_before"][0]) if "h_before" in memory else math.inf
        if r > LARGEST_RATIO:
            return Past(state.x, state.v, h)
        y = _extrapolated(self.backend, state.x, memory["x_before"], r)
        w = _extrapolated(self.backend, state.v, memory["v_before"], r)
        return Past(y, w, h * (1.0 + r) / (1.0 + 2.0 * r))

    def effective_step(self, h: float) -> float:
        """Two thirds of the step."""
        return 2.0 * h / 3.0

    def memory(self, state: MotionState, h: float) -> dict[str, NDArray]:
        """State before the step, and its length."""
        return {"x_before": state.x, "v_before": state.v, "h_before": np.array([h])}


def _extrapolated(backend: Backend, last: Floats, before: Floats, r: float) -> Floats:
    """((1 + r)^2 last - r^2 before) / (1 + 2 r) = last + r^2 (last - before) / (1 + 2 r)."""
    out = backend.difference(last, before, r * r / (1.0 + 2.0 * r))
    backend.add_scaled(out, 1.0, last)
    return out
