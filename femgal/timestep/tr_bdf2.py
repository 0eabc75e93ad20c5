# SPDX-License-Identifier: BSD-3-Clause
"""TR-BDF2: the trapezoidal rule to t + gamma h, then BDF2 to t + h (Bank et al. 1985; Hosea & Shampine 1996)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from femgal.timestep.implicit import ImplicitMethod, Past
from femgal.timestep.state import MotionState

Floats = NDArray[np.float64]

# With this gamma both stages have the same h_e, hence the same matrix, and the error is least.
GAMMA = 2.0 - math.sqrt(2.0)

# Size of the relative change of a frequency omega over (omega h)^2, (3 gamma^2 - 4 gamma + 2) / (12 (2 - gamma)): modes
# lag behind.
FREQUENCY_SHIFT = math.sqrt(0.5) - 2.0 / 3.0

# The error falls like h^ORDER, cautiously: 2 where the steps resolve all that moves, 1.2 was seen after sudden starts.
ORDER = 1.5

# x_{n+1} = A_GAMMA x_{n+gamma} + A_0 x_n + h_e v_{n+1}
A_GAMMA = 1.0 / (GAMMA * (2.0 - GAMMA))
A_0 = 1.0 - A_GAMMA


@dataclass(eq=False)
class TRBDF2(ImplicitMethod):
    """Second order, for stiff modes as strongly damped as backward Euler, and with two solves a step.

    With h_e = gamma h / 2, gamma = 2 - sqrt(2), and a the acceleration:

        x_{n+gamma} = x_n + h_e (v_n + v_{n+gamma}),                 v_{n+gamma} = v_n + h_e (a_n + a_{n+gamma})
        x_{n+1}     = A_gamma x_{n+gamma} + A_0 x_n + h_e v_{n+1},   likewise v_{n+1} with a_{n+1}

    The leading error is 0.04 h^3 against 0.33 h^3 of BDF2 and 0.08 h^3 of BDF2 at half the step, which costs the same.
    No state but the last one is needed, so steps of any lengths may follow each other. a_{n+1} comes from the second
    formula, not from the forces at x_{n+1}: what the solver has left undone in stiff modes is not amplified by their
    stiffness. For the same reason a motion begins with a step of backward Euler, h_e long: the forces of a start that
    is not smooth would throw the body far away.

    For solvers that solve their steps. Slow modes are hardly damped, so a sweep or a cycle per solve, which makes them
    lag a little, also makes them grow.
    """

    # The spectral radius of the map from one (x, v, a) to the next is 1 there (tests/femgal/test_tr_bdf2.py).
    least_response: ClassVar[float] = -0.0938

    def past(self, state: MotionState, h: float) -> Past:
        """Of the first stage, the trapezoidal rule."""
        h_e, backend = self.effective_step(h), self.backend
        y, w = backend.copy(state.x), backend.copy(state.v)
        backend.add_scaled(y, h_e, state.v)
        backend.add_scaled(w, h_e, state.memory["acceleration"])
        return Past(y, w, h_e)

    def effective_step(self, h: float) -> float:
        """gamma h / 2, in both stages."""
        return 0.5 * GAMMA * h

    def step(self, state: MotionState, h: float) -> MotionState:
        """Both stages; of the first step of a motion, a short one of backward Euler before them."""
        if "acceleration" not in state.memory:
            h_e = self.effective_step(h)
            state = self._accelerated(self.solve(state, Past(state.x, state.v, h_e), state.time + h_e), state.v, h_e)
            h -= h_e
        middle = self.solve(state, self.past(state, h), state.time + GAMMA * h)
        y, w = self._combined(middle.x, state.x), self._combined(middle.v, state.v)
        past = Past(y, w, self.effective_step(h))
        after = self.solve(middle, past, state.time + h)
        solved = after.converged if middle.converged is not False else False
        return self._accelerated(replace(after, converged=solved), w, past.h_e)

    def _accelerated(self, state: MotionState, w: Floats, h_e: float) -> MotionState:
        """The state with its acceleration in memory, (v - w) / h_e."""
        return replace(state, memory=state.memory | {"acceleration": self.backend.difference(state.v, w, 1.0 / h_e)})

    def _combined(self, middle: Floats, before: Floats) -> Floats:
        """A_gamma middle + A_0 before = middle - A_0 (middle - before)."""
        out = self.backend.difference(middle, before, -A_0)
        self.backend.add_scaled(out, 1.0, middle)
        return out
