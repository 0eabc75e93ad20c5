# SPDX-License-Identifier: BSD-3-Clause
"""Velocity Verlet: explicit, second order, and hard to beat wherever its stable step is not tiny."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.backend import Backend
from femgal.solvers.spectrum import largest_frequency_squared, random_start
from femgal.timestep.state import Motion, MotionState, least_substeps, place

Floats = NDArray[np.float64]

# Products with the Hessian in each frame to follow the stable step as the body deforms. All are made: an old mode has a
# small residual from the first one on, whatever has become faster meanwhile. Measured against converged frequencies,
# four are within 5 % where a body hangs and sways and as good as six where it is torn to twenty times its length.
FOLLOW_ITERATIONS = 4

# Relative change of a frequency omega over (omega h)^2: modes run ahead.
FREQUENCY_SHIFT = 1.0 / 24.0

# Share of the extra substeps, learnt from a frame taken again, that is left one frame later. With 0.95 a fifth fewer
# passes were made on bodies that snap back, and the energy drifted ten times as far.
CAUTION_KEPT = 0.99


@dataclass(eq=False)
class VelocityVerlet:
    """v += h/2 a; x += h v; a = g - M^-1 grad E(x); v += h/2 a; stable for h < 2 / omega_max.

    omega_max^2, the largest eigenvalue of M^-1 K, comes from a power iteration at the start and is followed from frame
    to frame. Mass-proportional damping alpha enters the two half kicks as a centred (Crank-Nicolson) term.

    Parameters
    ----------
    backend : Element passes.
    gravity : g [m/s^2], shape [3].
    damping : alpha [1/s].
    motions : Prescribed motions of the constrained vertices.
    safety : Fraction of the stable step to use, 0 < safety <= 1.
    substeps : Steps per frame; None takes as many as stability asks for.
    """

    backend: Backend
    gravity: Floats
    damping: float = 0.0
    motions: Sequence[Motion] = ()
    safety: float = 0.9
    substeps: int | None = None

    def init(self, x0: Floats, v0: Floats) -> MotionState:
        """State at time zero; its memory holds the acceleration, the fastest mode and its frequency."""
        backend, X = self.backend, self.backend.disc.mesh.points
        x, v = backend.to_device(x0.copy()), backend.to_device(v0.copy())
        place(backend, self.motions, 0.0, x)
        memory = {"acceleration": self._accelerate(x, backend.copy(v), 0.0)}
        if self.substeps is None:
            omega2, mode = largest_frequency_squared(backend, backend.to_device(X), random_start(len(X)))
            now = omega2
            if not np.array_equal(backend.to_host(x), X):
                now, mode = largest_frequency_squared(backend, x, mode)
            memory |= {
                "caution": np.ones(1),
                "mode": mode,
                "omega2_rest": np.array([omega2]),
                "omega2": np.array([now]),
            }
        return MotionState(0.0, x, v, memory)

    def begin_frame(self, state: MotionState, duration: float, substeps: int | None = None) -> tuple[MotionState, int]:
        """Substeps of at most `safety` times the stable step.

        The stiffer of the rest state and the present one counts: a body on its way back to rest must not be met by
        the step of its soft state.
        """
        if substeps is not None or self.substeps is not None:
            return state, substeps or self.substeps or 1
        return state, self._planned(state, duration, float(state.memory["caution"][0]))

    def _planned(self, state: MotionState, duration: float, caution: float) -> int:
        omega2 = max(float(state.memory["omega2_rest"][0]), float(state.memory["omega2"][0]))
        return max(least_substeps(state), math.ceil(caution * duration * math.sqrt(omega2) / (2.0 * self.safety)))

    def end_frame(self, state: MotionState, duration: float, substeps: int) -> tuple[MotionState, int | None]:
        """Estimate the stable step at the end of a frame; asks for more substeps if those taken were too long."""
        if self.substeps is not None:
            return state, None
        if not self.backend.is_finite(state.x):
            return state, 2 * substeps
        omega2, mode = largest_frequency_squared(
            self.backend, state.x, state.memory["mode"], max_iterations=FOLLOW_ITERATIONS, tolerance=0.0
        )
        # A motion that has run away gives huge frequencies, or none: that is no measure of the motion that should have
        # been, so the substeps grow by steps.
        needed = duration * math.sqrt(omega2) / 2.0 if math.isfinite(omega2) else math.inf
        if substeps < needed:
            return state, math.ceil(min(needed / self.safety, 4 * substeps))
        # A frame that had to be taken again says that the body was stiffer between the two looks than at either: the
        # next frames take the same care, which fades.
        caution = max(1.0, CAUTION_KEPT * float(state.memory["caution"][0]))
        if substeps > self._planned(state, duration, float(state.memory["caution"][0])):
            caution = max(1.0, substeps / max(self._planned(state, duration, 1.0), needed / self.safety))
        memory = {"mode": mode, "omega2": np.array([omega2]), "caution": np.array([caution])}
        return replace(state, memory=state.memory | memory), None

    def step(self, state: MotionState, h: float) -> MotionState:
        """One kick-drift-kick step."""
        decay = 1.0 - 0.5 * h * self.damping
        x, v = self.backend.kick_drift(state.x, state.v, state.memory["acceleration"], h, decay)
        place(self.backend, self.motions, state.time + h, x)
        a = self._accelerate(x, v, h)
        for motion in self.motions:
            self.backend.place_velocities(v, motion.vertices, x, state.x, h)
        return MotionState(state.time + h, x, v, state.memory | {"acceleration": a})

    def residual(self, state: MotionState) -> None:
        """None: an explicit step solves no equation."""
        return None

    def _accelerate(self, x: Floats, v: Floats, h: float) -> Floats:
        """Acceleration at x [m/s^2], shape [n, 3]; the second half kick of h is added to v in place."""
        a = self.backend.gradient(x)
        self.backend.accelerate_kick(a, v, self.gravity, h, 1.0 / (1.0 + 0.5 * h * self.damping))
        return a
