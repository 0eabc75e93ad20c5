# SPDX-License-Identifier: BSD-3-Clause
"""The error of velocity Verlet, from the accelerations that it computes anyway.

A mode that swings at omega swings in steps of h at omega (1 + (omega h)^2 / 24): Verlet's amplitudes stay, its phases
run ahead. After a time t the error of A cos(omega t) is A omega t (omega h)^2 / 24 sin(...), which is a multiple of the
mode's third derivative, whatever its frequency. So, for all modes at once and at every vertex,

    e(t) = (1/24) (integral of h^2 over 0 ... t) da/dt,

and da/dt is known from step to step. Modes whose phases are already lost, omega^3 h^2 t / 24 > 1, are at most wrong by
their own amplitude, and there the formula gives too much. They are left out by taking means of a over w = 2, 4, 8, ...
steps before its slope, and counted by their amplitude instead: what the mean over w steps leaves out of that over w / 2
swings at pi / (w h) or more, so its amplitude is at most that part of a over (pi / (w h))^2. The least sum over all
widths is the estimate.

On seven scenes, soft and stiff, heavy and light, driven and hung, the error of the whole motion was estimated at 1.0 to
1.5 times the true one (tests/verify/test_accuracy_promise.py). It costs no element pass. Only the first frame after a
sudden start, where there is no past to look at, may be a third of what it should be.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.timestep.state import MotionState

Floats = NDArray[np.float64]

# Vertices whose accelerations are looked at, and steps at the end of a frame; no more memory than this is taken.
MOST_VERTICES = 256
MOST_STEPS = 64

# With two steps in a frame the third derivative was 0.3 of what it should be, just after a sudden start.
FEWEST_STEPS = 8

SEED = 740_261_983


@dataclass(eq=False)
class FrequencyShift:
    """Looks at accelerations of some vertices; an `ErrorEstimator` for `VelocityVerlet`.

    Parameters
    ----------
    disc : The discretised bodies.
    """

    disc: Discretisation
    order: float = 2.0
    multiple: int = 1
    fewest: int = FEWEST_STEPS
    _sample: NDArray[np.int64] = field(init=False, repr=False)
    _weights: Floats = field(init=False, repr=False)
    _seen: list[Floats] = field(default_factory=list, init=False, repr=False)
    _skip: int = field(default=0, init=False, repr=False)

    def __post_init__(self) -> None:
        free = np.flatnonzero(self.disc.free)
        if len(free) > MOST_VERTICES:
            free = np.sort(np.random.default_rng(SEED).choice(free, MOST_VERTICES, replace=False))
        self._sample, mass = free, self.disc.mass
        # As heavy as all free vertices together.
        self._weights = mass[free] * (mass[self.disc.free].sum() / max(mass[free].sum(), np.finfo(float).tiny))

    def init(self, state: MotionState) -> dict[str, NDArray]:
        """No time has passed."""
        return {"h2_time": np.zeros(1)}

    def begin_frame(self, state: MotionState, substeps: int) -> None:
        """Forget the frame before."""
        self._skip = max(0, substeps - MOST_STEPS)
        self._seen = [state.memory["acceleration"][self._sample]]

    def observe(self, state: MotionState) -> None:
        """Keep the accelerations of the last steps of the frame."""
        if self._skip > 0:
            self._skip -= 1
            self._seen = []
        self._seen.append(state.memory["acceleration"][self._sample])

    def end_frame(
        self, memory: Mapping[str, NDArray], state: MotionState, duration: float, substeps: int
    ) -> tuple[dict[str, NDArray], float]:
        """The sum of h^2 over time [s^3], and the least estimate over all windows [sqrt(kg) m]."""
        h = duration / substeps
        h2_time = memory["h2_time"] + h * h * duration
        a = np.stack(self._seen)
        return {"h2_time": h2_time}, self.estimate(a, h, float(h2_time[0]))

    def estimate(self, a: Floats, h: float, h2_time: float) -> float:
        """|e| [sqrt(kg) m] from accelerations [m/s^2] at times h apart, shape [times, k, 3]."""
        phase, lost = h2_time / 24.0, 0.0
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
