# SPDX-License-Identifier: BSD-3-Clause
"""Steps on a device that are recorded once and then launched again, without the solver's Python.

A step whose solver never looks at a number of the device makes the same launches whenever it begins with the same
small arrays of the host: step lengths, schedules, the step before. That is found out, not declared: a step during which
the host has waited for the device is not repeated. So with fixed step lengths (`spectral`, `lu2025`, two numbers)
explicit steps and those of `fas` and `jacobi` are repeated, also while blocks are kept; searches along corrections,
tolerances, conjugate gradients and the substep in which blocks are compared are not.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.backend import Backend, Passes
from femgal.solvers.blocks import SCHEDULE, aged, phase
from femgal.timestep.state import MotionState, TimeStepper

Floats = NDArray[np.float64]

# Kinds of steps that are kept; each keeps the arrays that it works on.
MOST_KINDS = 4


class Recording(Protocol):
    """A step that can be taken again."""

    passes: Passes
    outputs: tuple[Any, ...]

    @property
    def is_graph(self) -> bool:
        """Whether it is launched as one graph."""

    def run(self, arrays: list[Any], time: float) -> None:
        """Take it from a state with these arrays, at a time [s]."""


class RecordingBackend(Backend, Protocol):
    """A backend that can record."""

    def record(self, step: Any, arrays: list[Any], time: float) -> tuple[Any, Recording | None]:
        """Take a step from a state with these arrays; with its result a recording, None where it cannot be repeated.

        Parameters
        ----------
        step : Returns its result and the arrays of the state that it led to.
        """


@dataclass(frozen=True, eq=False)
class _Known:
    recording: Recording
    after: MotionState


@dataclass(eq=False)
class RepeatedSteps:
    """A time-stepping method whose steps are repeated where that gives the same; a `TimeStepper` itself.

    Parameters
    ----------
    stepper : Takes the steps that are not repeated.
    backend : Records.

    Attributes
    ----------
    repeated, taken : Steps that were repeated, and steps that the method itself has taken.
    """

    stepper: TimeStepper
    backend: RecordingBackend
    repeated: int = 0
    taken: int = 0
    _known: dict[Hashable, _Known] = field(default_factory=dict, init=False, repr=False)
    _seen: set[Hashable] = field(default_factory=set, init=False, repr=False)
    _hopeless: set[Hashable] = field(default_factory=set, init=False, repr=False)

    def init(self, x0: Floats, v0: Floats) -> MotionState:
        """State at time zero."""
        return self.stepper.init(x0, v0)

    def begin_frame(self, state: MotionState, duration: float, substeps: int | None = None) -> tuple[MotionState, int]:
        """As the method does."""
        return self.stepper.begin_frame(state, duration, substeps)

    def end_frame(self, state: MotionState, duration: float, substeps: int) -> tuple[MotionState, int | None]:
        """As the method does, with a state that no later step overwrites."""
        # Where nothing is repeated nothing is overwritten, and a solver may know the very array again.
        return self.stepper.end_frame(self._own(state) if self._known else state, duration, substeps)

    def residual(self, state: MotionState) -> Floats | None:
        """As the method does."""
        return self.stepper.residual(state)

    def step(self, state: MotionState, h: float) -> MotionState:
        """A step: as the method takes it the first time, recorded the second time, and from then on repeated."""
        kind = _kind(state, h)
        known = self._known.get(kind)
        if known is None and kind not in self._seen:
            self._seen.add(kind)
            return self._take(state, h)
        if known is None:
            return self._take(state, h) if kind in self._hopeless else self._record(kind, state, h)
        known.recording.run(_arrays(state), state.time)
        self.backend.passes.add(known.recording.passes)
        self.repeated += 1
        return replace(known.after, time=state.time + h, memory=known.after.memory | aged(state.memory))

    def _take(self, state: MotionState, h: float) -> MotionState:
        self.taken += 1
        return self.stepper.step(state, h)

    def _record(self, kind: Hashable, state: MotionState, h: float) -> MotionState:
        # Repeating it overwrites where it began, which somebody may still want to go back to.
        state = self._own(state)

        def step() -> tuple[MotionState, list[Any]]:
            after = self._take(state, h)
            return after, _arrays(after)

        after, recording = self.backend.record(step, _arrays(state), state.time)
        if recording is None or sorted(state.memory) != sorted(after.memory):
            self._hopeless.add(kind)
            return after
        while len(self._known) >= MOST_KINDS:
            del self._known[next(iter(self._known))]
        self._known[kind] = _Known(recording, after)
        return after

    def _own(self, state: MotionState) -> MotionState:
        """The state with copies of its arrays."""
        copy = self.backend.copy
        memory = {name: copy(array) if array.ndim == 2 else array for name, array in state.memory.items()}
        return replace(state, x=copy(state.x), v=copy(state.v), memory=memory)

    @property
    def graphs(self) -> bool:
        """Whether some steps are launched as one graph each."""
        return any(known.recording.is_graph for known in self._known.values())


def repeated(stepper: TimeStepper, backend: Backend) -> TimeStepper:
    """The method itself, or where the backend can record, the method with its steps repeated."""
    return RepeatedSteps(stepper, cast(RecordingBackend, backend)) if hasattr(backend, "record") else stepper


def _kind(state: MotionState, h: float) -> Hashable:
    """What decides which launches a step makes."""
    arrays = sorted(state.memory.items())
    small = tuple((name, array.tobytes()) for name, array in arrays if array.ndim == 1 and name != SCHEDULE)
    rows = tuple((name, array.shape) for name, array in arrays if array.ndim == 2)
    return h, small, rows, phase(state.memory)


def _arrays(state: MotionState) -> list[Any]:
    """Arrays of the device in a state, by name."""
    return [state.x, state.v, *(array for _, array in sorted(state.memory.items()) if array.ndim == 2)]
