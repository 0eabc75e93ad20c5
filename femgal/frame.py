# SPDX-License-Identifier: BSD-3-Clause
"""What a simulation hands on: one frame after the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from numpy.typing import NDArray

from femgal.timestep.state import MotionState


class Stopped(Exception):
    """The caller asked to stop in the middle of a frame."""


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame of a run; frame 0 is the start.

    Parameters
    ----------
    index : Number of the frame.
    row : The numbers of the frame, as in run.json.
    fetch_state, fetch_fields : Wait for what is on its way from the device, and return it.
    guard : Memory of the energy guard after this frame; a checkpoint holds it beside the state.
    """

    index: int
    row: dict[str, Any]
    fetch_state: Callable[[], MotionState]
    fetch_fields: Callable[[], dict[str, NDArray]]
    guard: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def state(self) -> MotionState:
        """Positions, velocities and everything else that the next frame depends on.

        Arrays of its memory that have rows are still the backend's.
        """
        return self.fetch_state()

    @cached_property
    def fields(self) -> dict[str, NDArray]:
        """The output fields that the plan names, one array per name; static ones are not repeated here."""
        return self.fetch_fields()
