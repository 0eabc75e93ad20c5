# SPDX-License-Identifier: BSD-3-Clause
"""Substeps that keep the error of a whole motion below what was asked for.

An estimator tells after each frame how far the positions are from the exact motion, all frames before included. With
it, the relative error so far is

    R_k = sqrt(sum over frames 1 ... k of |e|^2) / sqrt(sum over the same frames of |x - x_0|^2),

norms weighted by mass; of bodies that nothing holds the motion of the centre of mass is taken out of the second sum.
At the last frame this is the error that was promised to stay below the accuracy. Of n frames, frame k may have spent
the share AT_ONCE + (1 - AT_ONCE) k / n of it: what is lost at once, as when a pin stops a body suddenly, and phase
errors, which grow with time. A frame that has spent more is taken again; the next one's substeps aim lower.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from femgal.timestep.state import LEAST_SUBSTEPS, MotionState, TimeStepper

Floats = NDArray[np.float64]

# Share of the promise that the first frame may spend, and share of what a frame may spend that its steps aim at.
AT_ONCE = 0.5
AIM = 0.7

# From frame to frame, and from attempt to attempt, substeps change by these factors at most. Halving keeps BDF2 stable.
LEAST_FACTOR, LARGEST_FACTOR = 0.5, 2.0
LARGEST_RETAKE = 4.0

# Substeps within these factors of the present ones are not worth a change: equal steps are the most accurate.
KEPT = (0.75, 1.1)

# A frame is taken again for its error at most so often, and only while that takes a tenth off.
MOST_RETAKES = 5
LEAST_GAIN = 0.9

# No frame gets more substeps than this for the sake of accuracy.
MOST_SUBSTEPS = 1_000_000

PREFIX = "control/"


class ErrorEstimator(Protocol):
    """Tells how far a motion is from the exact one.

    Attributes
    ----------
    order : The estimate falls like h^order, cautiously.
    multiple : Substeps of a frame come in multiples of this.
    fewest : With fewer substeps in a frame it knows too little.
    """

    order: float
    multiple: int
    fewest: int

    def init(self, state: MotionState) -> dict[str, NDArray]:
        """What the estimate needs at time zero, for the state's memory."""

    def begin_frame(self, state: MotionState, substeps: int) -> None:
        """A frame begins with this state; also when it is taken again."""

    def observe(self, state: MotionState) -> None:
        """A substep led to this state."""

    def end_frame(
        self, memory: Mapping[str, NDArray], state: MotionState, duration: float, substeps: int
    ) -> tuple[dict[str, NDArray], float]:
        """The memory after the frame and |e| of its last state [sqrt(kg) m].

        Parameters
        ----------
        memory : What `init` or the last accepted frame returned.
        """


@dataclass(eq=False)
class AccuracyControl:
    """A time-stepping method whose substeps follow from an accuracy; a `TimeStepper` itself.

    Everything that the next frame depends on is in the state's memory, under names that begin with PREFIX.

    Parameters
    ----------
    stepper : Takes the steps, and says how many it needs for reasons of its own.
    estimator : Of its error.
    accuracy : Relative error asked for.
    frames : Number of frames that share it.
    mass : Vertex masses [kg], shape [n].
    free : Whether there are bodies that nothing holds.
    substeps : To begin with.
    """

    stepper: TimeStepper
    estimator: ErrorEstimator
    accuracy: float
    frames: int
    mass: Floats
    free: bool = False
    substeps: int = 1
    # The frame's errors in its attempts so far; it begins anew with every frame.
    _attempts: list[float] = field(default_factory=list, init=False, repr=False)
    # Substeps that the error asks for in this frame; what stability asks for is the method's own business.
    _asked: int = field(default=1, init=False, repr=False)

    def init(self, x0: Floats, v0: Floats) -> MotionState:
        """State at time zero."""
        state = self.stepper.init(x0, v0)
        own = {"start": state.x.copy(), "sums": np.zeros(2), "frame": np.zeros(1, np.int64)}
        own |= {"substeps": np.array([self.substeps])}
        return _with(state, own | self.estimator.init(state))

    def begin_frame(self, state: MotionState, duration: float, substeps: int | None = None) -> tuple[MotionState, int]:
        """The substeps that the last frame's error asks for, or more where stability does."""
        multiple = self.estimator.multiple
        if substeps is None:
            self._attempts, self._asked = [], int(state.memory[PREFIX + "substeps"][0])
        least = multiple * math.ceil(max(self._asked, self.estimator.fewest) / multiple)
        state = replace(state, memory=state.memory | {LEAST_SUBSTEPS: np.array([least])})
        state, substeps = self.stepper.begin_frame(state, duration, substeps)
        if substeps % multiple:
            state, substeps = self.stepper.begin_frame(state, duration, substeps + multiple - substeps % multiple)
        self.estimator.begin_frame(state, substeps)
        return state, substeps

    def step(self, state: MotionState, h: float) -> MotionState:
        """A step of the method."""
        after = self.stepper.step(state, h)
        self.estimator.observe(after)
        return _with(after, _own(state))

    def end_frame(self, state: MotionState, duration: float, substeps: int) -> tuple[MotionState, int | None]:
        """Take the frame again with more substeps while its error is too large and they help."""
        own = _own(state)
        state, wanted = self.stepper.end_frame(state, duration, substeps)
        if wanted is not None or not np.isfinite(state.x).all():
            return state, wanted
        memory, error = self.estimator.end_frame(own, state, duration, substeps)
        sums = own["sums"] + (error**2, self._moved(state.x - own["start"]) ** 2)
        frame = int(own["frame"][0]) + 1
        spent = _relative(sums) / self._allowed(frame)
        if self._retake_helps(spent, substeps):
            factor = min(LARGEST_RETAKE, max(1.5, (spent / AIM) ** (1.0 / self.estimator.order)))
            self._asked = math.ceil(factor * substeps)
            return state, self._asked
        after = self._next(_relative(sums) / self._allowed(frame + 1), substeps)
        memory |= {"start": own["start"], "sums": sums, "frame": np.array([frame]), "substeps": np.array([after])}
        return _with(state, memory), None

    def _allowed(self, frame: int) -> float:
        return self.accuracy * (AT_ONCE + (1.0 - AT_ONCE) * min(1.0, frame / self.frames))

    def _retake_helps(self, spent: float, substeps: int) -> bool:
        before, self._attempts = self._attempts, [*self._attempts, spent]
        if not spent > 1.0 or len(before) >= MOST_RETAKES or substeps >= MOST_SUBSTEPS:
            return False
        return not before or spent < LEAST_GAIN * before[-1]

    def _next(self, spent: float, substeps: int) -> int:
        """Substeps of the next frame, after one with these substeps and this share of the next one's allowance."""
        factor = (spent / AIM) ** (1.0 / self.estimator.order) if math.isfinite(spent) else LARGEST_FACTOR
        if KEPT[0] <= factor <= KEPT[1]:
            return substeps
        return min(MOST_SUBSTEPS, math.ceil(substeps * min(LARGEST_FACTOR, max(LEAST_FACTOR, factor))))

    def _moved(self, u: Floats) -> float:
        """Size of a motion [sqrt(kg) m]."""
        if self.free:
            u = u - self.mass @ u / self.mass.sum()
        return mass_norm(self.mass, u)

    def residual(self, state: MotionState) -> Floats | None:
        """That of the method."""
        return self.stepper.residual(state)

    def estimated_error(self, state: MotionState) -> float:
        """R of all frames that led to a state; zero at the start."""
        return _relative(state.memory[PREFIX + "sums"])


def mass_norm(mass: Floats, u: Floats) -> float:
    """sqrt(sum of m |u|^2) [sqrt(kg) m] for displacements of shape [n, 3]."""
    return math.sqrt(float(mass @ np.einsum("ij,ij->i", u, u)))


def _relative(sums: Floats) -> float:
    """R; where nothing has moved, an error is infinitely large."""
    error, moved = float(sums[0]), float(sums[1])
    if error == 0.0:
        return 0.0
    return math.sqrt(error / moved) if moved > 0.0 else math.inf


def _own(state: MotionState) -> dict[str, NDArray]:
    """The control's part of the memory."""
    return {name.removeprefix(PREFIX): array for name, array in state.memory.items() if name.startswith(PREFIX)}


def _with(state: MotionState, own: Mapping[str, NDArray]) -> MotionState:
    return replace(state, memory=state.memory | {PREFIX + name: array for name, array in own.items()})
