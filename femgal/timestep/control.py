# SPDX-License-Identifier: BSD-3-Clause
"""Substeps that keep the error of a whole motion below what was asked for.

An estimator tells after each frame how far the positions are from the exact motion, all frames before included. With
it, the relative error so far is

    R_k = sqrt(sum over frames 1 ... k of |e|^2) / sqrt(sum over the same frames of |x - x_0|^2),

norms weighted by mass; of bodies that nothing holds the motion of the centre of mass is taken out of the second sum.
At the last frame this is the error that was promised to stay below the accuracy. What is lost stays lost, so the
substeps of the next frame follow from what R will be at the end. With S_j substeps in frame j and G_k = sum of S_j^-2,
phase errors of a body that swings grow like G, and what is lost at once, as when a pin stops it suddenly, does not grow
any more. Most of what is lost is of the first kind, and the error is led on by

    |e_j|^2 = g G_j^p,    j > k,    p = 1.75,    g = sum of w_i |e_i|^2 / sum of w_i G_i^p,  i = 1 ... k,

weights w that fade, because single frames have small or large errors by chance: |e| of a body is least where it turns.
The motion is led on by what it is still gathering (`size_ahead`). A frame that has spent too much of what all the
others need is taken again.

Tried and dearer on bunnies and beams of 2,000 and 20,000 vertices: p = 1 and 2, g of the last frame alone, and a motion
of the present size. All of them begin with too short steps or leave too little for the end.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.backend import Backend
from femgal.timestep.state import LEAST_SUBSTEPS, MotionState, TimeStepper

Floats = NDArray[np.float64]

# Share of the promise that the substeps aim at.
AIM = 0.9

# Where the promise is spent already, the rest of the motion may still add this share to |e|^2: no number of substeps
# takes away what has been lost, and very short steps would only cost.
LEAST_GROWTH = 0.05

# From frame to frame, and from attempt to attempt, substeps change by these factors at most.
LEAST_FACTOR, LARGEST_FACTOR = 0.5, 2.0
LARGEST_RETAKE = 4.0

# Substeps within these factors of the present ones are not worth a change: equal steps are the most accurate.
KEPT = (0.7, 1.15)

# How far ahead R is led on: no more frames than these, or so many times those that have been seen; and by this share
# beyond the end, or nothing would keep the last steps short.
LEAST_HORIZON, HORIZON, BEYOND = 20, 4, 0.1

# p, and what is left of the weight of a frame in the next one.
POWER, FADING = 1.75, 0.8

# A motion that begins at rest has u ~ t^2, steepness 2; what is steeper is something else. At the second, |u|^2 of a
# swing is its mean, 1 - cos theta = sqrt(1.5).
STEEPEST, SWINGING = 2.2, 1.432
_THETA = np.linspace(1e-2, math.pi, 1000)

# A frame is taken again when it should have had so many times its substeps and has spent so much of G; at most so
# often, and only while that takes a tenth off its error.
TOO_FEW, LARGE_SHARE = 1.5, 0.3
RETAKE_ORDER = 1.5
MOST_RETAKES = 5
LEAST_GAIN = 0.9

# No frame gets more substeps than this for the sake of accuracy.
MOST_SUBSTEPS = 1_000_000

PREFIX = "control/"


class ErrorEstimator(Protocol):
    """Tells how far a motion is from the exact one.

    Attributes
    ----------
    fewest : With fewer substeps in a frame it knows too little.
    """

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
    backend : Of the states.
    free : Whether there are bodies that nothing holds.
    substeps : To begin with.
    """

    stepper: TimeStepper
    estimator: ErrorEstimator
    accuracy: float
    frames: int
    backend: Backend
    free: bool = False
    substeps: int = 1
    # The frame's errors in its attempts so far; it begins anew with every frame.
    _attempts: list[float] = field(default_factory=list, init=False, repr=False)
    # Substeps that the error asks for in this frame; what stability asks for is the method's own business.
    _asked: int = field(default=1, init=False, repr=False)

    def init(self, x0: Floats, v0: Floats) -> MotionState:
        """State at time zero."""
        state = self.stepper.init(x0, v0)
        own = {"start": self.backend.copy(state.x), "sums": np.zeros(2), "frame": np.zeros(1, np.int64)}
        own |= {"substeps": np.array([self.substeps]), "G": np.zeros(1), "growth_sums": np.zeros(2)}
        return _with(state, own | self.estimator.init(state))

    def begin_frame(self, state: MotionState, duration: float, substeps: int | None = None) -> tuple[MotionState, int]:
        """The substeps that the last frame's error asks for, or more where stability does."""
        if substeps is None:
            self._attempts, self._asked = [], int(state.memory[PREFIX + "substeps"][0])
        least = max(self._asked, self.estimator.fewest)
        state = replace(state, memory=state.memory | {LEAST_SUBSTEPS: np.array([least])})
        state, substeps = self.stepper.begin_frame(state, duration, substeps)
        self.estimator.begin_frame(state, substeps)
        return state, substeps

    def step(self, state: MotionState, h: float) -> MotionState:
        """A step of the method."""
        # The method's steps depend on nothing of the control's: on a device they are then the same from frame to frame.
        after = self.stepper.step(_without(state), h)
        self.estimator.observe(after)
        return _with(after, _own(state))

    def end_frame(self, state: MotionState, duration: float, substeps: int) -> tuple[MotionState, int | None]:
        """Take the frame again with more substeps while its error is too large and they help."""
        own = _own(state)
        state, wanted = self.stepper.end_frame(state, duration, substeps)
        if wanted is not None or not self.backend.is_finite(state.x):
            return state, wanted
        memory, error = self.estimator.end_frame(own, state, duration, substeps)
        u = self._centred(self.backend.to_host(self.backend.difference(state.x, own["start"])))
        v = self._centred(self.backend.to_host(state.v))
        now = np.array([error**2, mass_norm(self.backend.disc.mass, u) ** 2])
        sums, G_before, frame = own["sums"] + now, float(own["G"][0]), int(own["frame"][0]) + 1
        G, left = G_before + substeps**-2.0, self._left(frame)
        steepness = frame * duration * _inner(self.backend.disc.mass, u, v) / now[1] if now[1] > 0.0 else 0.0
        # Both sums of g, and the sum of |x - x_0|^2 at the end.
        growth = FADING * own["growth_sums"] + np.array([now[0], G**POWER])
        g = float(growth[0] / growth[1])
        moved = float(sums[1] + max(left * sums[1] / frame, now[1] * size_ahead(steepness, frame, left)))
        factor = self._needed(float(own["sums"][0]), moved, g, G_before, left + 1) / substeps
        if factor > TOO_FEW and substeps**-2.0 > LARGE_SHARE * G and self._retake_helps(error, substeps):
            # By the formula above |e_1| falls like 1 / S; what a frame takes back falls faster.
            self._asked = math.ceil(min(LARGEST_RETAKE, factor ** (1.0 / RETAKE_ORDER)) * substeps)
            return state, self._asked
        after = self._next(self._needed(float(sums[0]), moved, g, G, left) / substeps, substeps)
        memory |= {"start": own["start"], "sums": sums, "frame": np.array([frame]), "substeps": np.array([after])}
        return _with(state, memory | {"G": np.array([G]), "growth_sums": growth}), None

    def _left(self, frame: int) -> int:
        """Frames after one that are looked ahead."""
        return min(math.ceil((1.0 + BEYOND) * self.frames) - frame, max(LEAST_HORIZON, HORIZON * frame))

    def _needed(self, spent: float, moved: float, g: float, G: float, frames: int) -> float:
        """Substeps of each of the frames that are left, for R at the end to be what is aimed at.

        Parameters
        ----------
        spent : Sum of |e|^2 so far [kg m^2].
        moved : Sum of |x - x_0|^2 at the end [kg m^2].
        g : |e_j|^2 / G_j^p [kg m^2].
        G : Sum of S^-2 so far.
        frames : That are left.
        """
        if g == 0.0 or not math.isfinite(g):
            return g
        j = np.arange(1, frames + 1)
        for_sure = spent + frames * g * G**POWER
        most = max((AIM * self.accuracy) ** 2 * moved, (1.0 + LEAST_GROWTH) * for_sure)
        if not most > 0.0:
            return math.inf
        low, high = -10.0, math.log2(MOST_SUBSTEPS)
        while high - low > 1e-3:
            middle = 0.5 * (low + high)
            total = spent + g * float(((G + j * 4.0**-middle) ** POWER).sum())
            low, high = (middle, high) if total > most else (low, middle)
        return 2.0**high

    def _retake_helps(self, error: float, substeps: int) -> bool:
        before, self._attempts = self._attempts, [*self._attempts, error]
        if len(before) >= MOST_RETAKES or substeps >= MOST_SUBSTEPS:
            return False
        return not before or error < LEAST_GAIN * before[-1]

    def _next(self, factor: float, substeps: int) -> int:
        """Substeps of the next frame, after one that should have had some factor of its own."""
        if KEPT[0] <= factor <= KEPT[1] or math.isnan(factor):
            return substeps
        return min(MOST_SUBSTEPS, math.ceil(substeps * min(LARGEST_FACTOR, max(LEAST_FACTOR, factor))))

    def _centred(self, u: Floats) -> Floats:
        """Displacements or velocities, of free bodies without those of the centre of mass."""
        mass = self.backend.disc.mass
        return u - mass @ u / mass.sum() if self.free else u

    def residual(self, state: MotionState) -> Floats | None:
        """That of the method."""
        return self.stepper.residual(state)

    def estimated_error(self, state: MotionState) -> float:
        """R of all frames that led to a state; zero at the start."""
        return _relative(state.memory[PREFIX + "sums"])


def size_ahead(steepness: float, frame: int, left: int) -> float:
    """Sum of |x - x_0|^2 over the frames that are left, over that of the last frame.

    At present |u| grows like t^s, s = t (u . v) / |u|^2 its steepness. It is led on halfway between that and its
    present size: |u|^2 like t^s. What has been at rest and swings about its equilibrium moves like
    u = A (1 - cos theta), theta = omega t; s = theta / tan(theta / 2) then tells theta, so A, and |u|^2 is not led on
    beyond its mean, 1.5 A^2. Beyond the middle of its way out it cannot be told from one that moves evenly, and is led
    on like that.

    Parameters
    ----------
    steepness : s at the end of the frame.
    frame : Frames so far.
    left : Frames to come.
    """
    s = float(np.clip(steepness, 0.0, 2.0)) if steepness <= STEEPEST else 0.0
    along = 1.0 + np.arange(1, left + 1) / frame
    if s > SWINGING:
        theta = float(np.interp(-s, -_THETA / np.tan(0.5 * _THETA), _THETA))
        return float(np.minimum(along**s, max(1.0, 1.5 / (1.0 - math.cos(theta)) ** 2)).sum())
    # Where a swing would have its mean behind it, nothing is led on; even motion, s = 1, is led on in full.
    fading = min(1.0, (SWINGING - s) / (SWINGING - 1.0))
    return float((along ** (s * fading)).sum())


def _inner(mass: Floats, u: Floats, v: Floats) -> float:
    return float(mass @ np.einsum("ij,ij->i", u, v))


def mass_norm(mass: Floats, u: Floats) -> float:
    """sqrt(sum of m |u|^2) [sqrt(kg) m] for displacements of shape [n, 3]."""
    return math.sqrt(_inner(mass, u, u))


def _relative(sums: Floats) -> float:
    """R; where nothing has moved, an error is infinitely large."""
    error, moved = float(sums[0]), float(sums[1])
    if error == 0.0:
        return 0.0
    return math.sqrt(error / moved) if moved > 0.0 else math.inf


def _own(state: MotionState) -> dict[str, NDArray]:
    """The control's part of the memory."""
    return {name.removeprefix(PREFIX): array for name, array in state.memory.items() if name.startswith(PREFIX)}


def _without(state: MotionState) -> MotionState:
    kept = {name: array for name, array in state.memory.items() if not name.startswith(PREFIX)}
    return replace(state, memory=kept)


def _with(state: MotionState, own: Mapping[str, NDArray]) -> MotionState:
    return replace(state, memory=state.memory | {PREFIX + name: array for name, array in own.items()})
