# SPDX-License-Identifier: BSD-3-Clause
"""The error of a second-order method, from the accelerations that it computes anyway.

A mode that swings at omega swings in steps of h at omega (1 + c (omega h)^2), with velocity Verlet ahead, c = 1/24, and
with TR-BDF2 behind, c = sqrt(1/2) - 2/3 in size: to leading order amplitudes stay, phases are lost. After a time t the
error of A cos(omega t) is A omega t c (omega h)^2 sin(...), which is a multiple of the mode's third derivative,
whatever its frequency. So, for all modes at once and at every vertex,

    e(t) = c (integral of h^2 over 0 ... t) da/dt,

and da/dt is known from step to step. Modes whose phases are already lost, omega^3 h^2 t c > 1, are at most wrong by
their own amplitude, and there the formula gives too much. They are left out by taking means of a over w = 2, 4, 8, ...
steps before its slope, and counted by their amplitude instead: what the mean over w steps leaves out of that over w / 2
swings at pi / (w h) or more, so its amplitude is at most that part of a over (pi / (w h))^2. The least sum over all
widths is the estimate. A motion that begins with an implicit Euler step of h_e has lost h_e^2 a / 2 there, for good.

It costs no element pass. On seven scenes, soft and stiff, heavy and light, driven and hung, the error of the whole
motion was estimated at 0.9 to 1.7 times the true one (tests/verify/test_accuracy_promise.py), and it is as good where
implicit steps are so long that the motion is wrong altogether (tests/femgal/test_frequency_shift.py). Only the first
frame after a sudden start, where there is no past to look at, may be a third of what it should be.

What it replaced for TR-BDF2: the same motion with half the substeps beside it. That cost half as much again and mostly
took the error for several times what it was; where both motions were wrong alike, for less than half.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.backend import Backend
from femgal.timestep.state import MotionState

Floats = NDArray[np.float64]

# Vertices whose accelerations are looked at, and steps at the end of a frame; no more memory than this is taken.
MOST_VERTICES = 256
MOST_STEPS = 64

SEED = 740_261_983


@dataclass(eq=False)
class FrequencyShift:
    """Looks at accelerations of some vertices; an `ErrorEstimator` for methods that keep one in their memory.

    Parameters
    ----------
    backend : Has the accelerations.
    shift : c, the relative change of a frequency omega over (omega h)^2.
    fewest : See `ErrorEstimator`.
    euler_share : h_e over the first step h, of a method that begins with implicit Euler; else zero.
    """

    backend: Backend
    shift: float
    fewest: int
    euler_share: float = 0.0
    _sample: NDArray[np.int64] = field(init=False, repr=False)
    _weights: Floats = field(init=False, repr=False)
    _seen: list[Callable[[], Floats]] = field(default_factory=list, init=False, repr=False)
    _skip: int = field(default=0, init=False, repr=False)
    _started: bool = field(default=True, init=False, repr=False)

    def __post_init__(self) -> None:
        disc = self.backend.disc
        free = np.flatnonzero(disc.free)
        if len(free) > MOST_VERTICES:
            free = np.sort(np.random.default_rng(SEED).choice(free, MOST_VERTICES, replace=False))
        self._sample, mass = free, disc.mass
        # As heavy as all free vertices together.
        self._weights = mass[free] * (mass[disc.free].sum() / max(mass[free].sum(), np.finfo(float).tiny))

    def init(self, state: MotionState) -> dict[str, NDArray]:
        """No time has passed, nothing is lost."""
        return {"h2_time": np.zeros(1), "lost": np.zeros(1)}

    def begin_frame(self, state: MotionState, substeps: int) -> None:
        """Forget the frame before."""
        self._skip = max(0, substeps - MOST_STEPS)
        self._started = "acceleration" in state.memory
        self._seen = [self._look(state)] if self._started else []

    def observe(self, state: MotionState) -> None:
        """Keep the accelerations of the last steps of the frame."""
        if self._skip > 0:
            self._skip -= 1
            self._seen = []
        self._seen.append(self._look(state))

    def _look(self, state: MotionState) -> Callable[[], Floats]:
        """The accelerations of the sample; nobody waits for them before the frame's end."""
        return self.backend.fetch(self.backend.rows(state.memory["acceleration"], self._sample))

    def end_frame(
        self, memory: Mapping[str, NDArray], state: MotionState, duration: float, substeps: int
    ) -> tuple[dict[str, NDArray], float]:
        """The integral of h^2 [s^3] with what the start lost [sqrt(kg) m], and the estimate [sqrt(kg) m]."""
        h = duration / substeps
        h2_time, lost = memory["h2_time"] + h * h * duration, memory["lost"]
        a = np.stack([look() for look in self._seen])
        if not self._started:
            lost = np.array([0.5 * (self.euler_share * h) ** 2 * self._size(a[:1])])
        after = {"h2_time": h2_time, "lost": lost}
        if len(a) == 1:
            return after, float(lost[0])
        return after, math.hypot(float(lost[0]), self.estimate(a, h, float(h2_time[0])))

    def estimate(self, a: Floats, h: float, h2_time: float) -> float:
        """|e| [sqrt(kg) m] from accelerations [m/s^2] at times h apart, shape [times, k, 3]: the least one."""
        phase, lost = self.shift * h2_time, 0.0
        estimates, w = [self._size(np.diff(a, axis=0)) / h * phase], 1
        while 4 * w < len(a):
            # Means over twice as many steps, and what they leave out.
            wider = 0.5 * (a[:-w] + a[w:])
            lost += self._size(a[w // 2 : w // 2 + len(wider)] - wider) * (2 * w * h / math.pi) ** 2
            a, w = wider, 2 * w
            estimates.append(self._size(a[w:] - a[:-w]) / (w * h) * phase + lost)
        return min(estimates)

    def _size(self, u: Floats) -> float:
        """Root mean square over steps of the norm weighted by mass."""
        return math.sqrt(float(np.einsum("tij,tij,i->", u, u, self._weights)) / len(u))
