# SPDX-License-Identifier: BSD-3-Clause
"""The state that time stepping hands on, and what every time-stepping method offers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.backend import Backend
from femgal.kernels.deferred import Number

Floats = NDArray[np.float64]

# Entry of a state's memory: substeps of the next frame at the least, for reasons that are not the method's own.
LEAST_SUBSTEPS = "least_substeps"


@dataclass(frozen=True, eq=False)
class MotionState:
    """Everything that the next step depends on; a checkpoint holds exactly this.

    Arrays of two dimensions belong to the backend, those of one to the host (`femgal.kernels.backend`).

    Parameters
    ----------
    time : [s].
    x, v : Positions [m] and velocities [m/s], shape [n, 3].
    memory : Further arrays that the method carries from step to step, by name.
    corrections : Largest correction [m] that each layer made in the last step, finest first; a diagnosis, not state.
    converged : Whether the last step met its tolerance; None where none was asked for.
    """

    time: float
    x: Floats
    v: Floats
    memory: dict[str, NDArray] = field(default_factory=dict)
    corrections: tuple[Number, ...] = ()
    converged: bool | None = None


class Motion(Protocol):
    """Prescribed motion of some vertices."""

    @property
    def vertices(self) -> NDArray[np.int64]:
        """Indices of the vertices, shape [k]."""

    @property
    def is_fixed(self) -> bool:
        """Whether the vertices never move."""

    def positions(self, time: float) -> Floats:
        """Positions [m] at a time [s], shape [k, 3]."""


class TimeStepper(Protocol):
    """A time-stepping method: init / begin_frame / step / end_frame."""

    def init(self, x0: Floats, v0: Floats) -> MotionState:
        """State at time zero."""

    def begin_frame(self, state: MotionState, duration: float, substeps: int | None = None) -> tuple[MotionState, int]:
        """Number of substeps that the method takes over the next frame of `duration` seconds.

        With `substeps`, as many as an earlier attempt at this frame has asked for.
        """

    def step(self, state: MotionState, h: float) -> MotionState:
        """State one step of h seconds later."""

    def end_frame(self, state: MotionState, duration: float, substeps: int) -> tuple[MotionState, int | None]:
        """Look back on a frame: None to accept it, or the number of substeps to take it again with."""

    def residual(self, state: MotionState) -> Floats | None:
        """Residual [m] of the last step's equation, shape [n, 3]; None where no equation is solved."""


def place(backend: Backend, motions: Sequence[Motion], time: float, x: Floats) -> None:
    """Put the constrained vertices where they have to be at a time, in place."""
    for motion in motions:
        backend.place(x, motion, time)


def least_substeps(state: MotionState) -> int:
    """Substeps of the next frame that somebody else than the method asks for; 1 where nobody does."""
    return int(state.memory.get(LEAST_SUBSTEPS, (1,))[0])
