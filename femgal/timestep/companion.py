# SPDX-License-Identifier: BSD-3-Clause
"""The error of an implicit method, from the same motion with half the substeps.

With errors that fall like h^p, the companion's is 2^p times that of the motion, and their difference is 2^p - 1 times.
p is 2 where the steps resolve all that moves, and falls to about 0.7 where a body was set off suddenly and much of the
motion is faster than the steps. The difference itself, p = 1, is taken for the error. It was 0.9 to 3.8 times the true
one with BDF2 (0.5 on stiff beams that are pulled slowly) and 1.4 to 6.2 times with TR-BDF2, most where the companion
takes one step a frame (tests/verify/test_accuracy_promise.py). A promise is worth more than the last substep: with half
the steps the cost falls by some 30 % only, as each is harder to solve.

Where both sets of steps are too long for what moves, they may agree on a motion that is wrong: a light beam that rings
was 56 % off with one and with two steps a frame, 7 % apart. What saves the promise is that it holds from the first
frame on, when little has moved: there the two were 39 % apart.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femgal.timestep.control import mass_norm
from femgal.timestep.implicit import ImplicitMethod
from femgal.timestep.state import MotionState

Floats = NDArray[np.float64]

PREFIX = "companion/"


@dataclass(eq=False)
class Companion:
    """Takes every frame with half the substeps; an `ErrorEstimator`.

    Parameters
    ----------
    stepper : Takes the steps; of the same kind as the method that is judged, but with a solver of its own, as solvers
        keep what they have made for one step length.
    mass : Vertex masses [kg], shape [n].
    """

    stepper: ImplicitMethod
    mass: Floats
    order: float = 1.5
    multiple: int = 2
    fewest: int = 2

    def init(self, state: MotionState) -> dict[str, NDArray]:
        """Both motions start together."""
        return _packed(state)

    def begin_frame(self, state: MotionState, substeps: int) -> None:
        """Nothing: the companion moves when the frame is done."""

    def observe(self, state: MotionState) -> None:
        """Nothing."""

    def end_frame(
        self, memory: Mapping[str, NDArray], state: MotionState, duration: float, substeps: int
    ) -> tuple[dict[str, NDArray], float]:
        """The companion's state after the frame, and its distance from the motion [sqrt(kg) m]."""
        companion = _unpacked(memory)
        companion, half = self.stepper.begin_frame(companion, duration, substeps // 2)
        for _ in range(half):
            companion = self.stepper.step(companion, duration / half)
        return _packed(companion), mass_norm(self.mass, state.x - companion.x)


def _packed(state: MotionState) -> dict[str, NDArray]:
    arrays = {
        "time": np.array([state.time]),
        "x": state.x,
        "v": state.v,
        **{f"memory/{name}": array for name, array in state.memory.items()},
    }
    return {PREFIX + name: array for name, array in arrays.items()}


def _unpacked(memory: Mapping[str, NDArray]) -> MotionState:
    own = {name.removeprefix(PREFIX): array for name, array in memory.items() if name.startswith(PREFIX)}
    rest = {name.removeprefix("memory/"): array for name, array in own.items() if name.startswith("memory/")}
    return MotionState(float(own["time"][0]), own["x"], own["v"], rest)
