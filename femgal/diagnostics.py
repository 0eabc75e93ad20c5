# SPDX-License-Identifier: BSD-3-Clause
"""Numbers of one frame: energies, smallest J, residual; and the bound that tells a runaway from a lively motion."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.backend import Backend
from femgal.timestep.state import Motion, MotionState, place

Floats = NDArray[np.float64]

# No method here creates energy: backward Euler loses it and Verlet keeps it. Ten times all that ever went in is not a
# matter of discretisation.
RUNAWAY_FACTOR = 10.0

# Times within a frame at which prescribed vertices are looked at.
SAMPLES = 4


@dataclass(frozen=True)
class Energies:
    """Energies of a state [J] and its smallest volume ratio.

    Parameters
    ----------
    kinetic : sum m v^2 / 2.
    elastic : Sum over the tetrahedra, zero at rest.
    potential : Of gravity, zero at the rest positions.
    min_J : Smallest det F; negative where a tetrahedron is inverted.
    """

    kinetic: float
    elastic: float
    potential: float
    min_J: float

    @property
    def total(self) -> float:
        """Kinetic + elastic + potential."""
        return self.kinetic + self.elastic + self.potential

    def as_row(self) -> dict[str, float]:
        """Entries of a row of run.json."""
        return {
            "kinetic_energy": self.kinetic,
            "elastic_energy": self.elastic,
            "potential_energy": self.potential,
            "total_energy": self.total,
            "min_J": self.min_J,
        }


def energies_of(backend: Backend, state: MotionState, gravity: Floats) -> tuple[Energies, Floats, Floats]:
    """Energies of a state; with them the elastic energy [J] and J of each tetrahedron."""
    energy, J = backend.energies(state.x)
    kinetic, potential = backend.kinetic_energy(state.v), backend.weight_energy(state.x, gravity)
    return Energies(kinetic, backend.total(energy), potential, backend.smallest(J)), energy, J


class EnergyGuard:
    """Tells when a motion has more energy than anything can have given it.

    The bound is the first total energy plus RUNAWAY_FACTOR times a scale: what the body had at the start, what gravity
    gives it over its own height, and what its prescribed vertices may have put in. The last is bounded frame by frame
    by the elastic energy that moving them alone, and nothing else, would store; a path that goes out and back between
    two of the SAMPLES in a frame is not seen.
    """

    def __init__(self, backend: Backend, gravity: Floats, motions: Sequence[Motion]) -> None:
        self._backend, self._gravity = backend, gravity
        self._moving = [motion for motion in motions if not motion.is_fixed]
        self.injected = 0.0
        self._pending = 0.0
        self.start: Energies | None = None
        self.last: Energies | None = None

    def begin(self, energies: Energies) -> None:
        """Take the energies at the start of the run as the reference, and forget what was before."""
        self.start, self.last = energies, None
        self.injected = self._pending = 0.0

    def memory(self) -> dict[str, Any]:
        """What a checkpoint has to keep, JSON-ready."""
        return {
            "injected": self.injected,
            "start": asdict(self.start) if self.start else None,
            "last": asdict(self.last) if self.last else None,
        }

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Continue with what `memory` kept."""
        self.injected = float(memory["injected"])
        self.start = Energies(**memory["start"])
        self.last = Energies(**memory["last"]) if memory["last"] else None

    def allow_for_motion(self, state: MotionState, duration: float) -> None:
        """Allow for what the prescribed vertices may put in over the next frame; costs nothing when none moves."""
        if not self._moving:
            return
        backend, most = self._backend, 0.0
        before = backend.total(backend.energies(state.x)[0])
        x = backend.copy(state.x)
        for sample in range(1, SAMPLES + 1):
            share = duration * sample / SAMPLES
            place(backend, self._moving, state.time + share, x)
            stored = backend.total(backend.energies(x)[0]) - before
            dragged = 0.5 * backend.mass_distance(x, state.x) / share**2
            most = max(most, stored + dragged)
        self._pending = most

    def accept(self, energies: Energies) -> None:
        """A frame is good: what was allowed for it counts from now on."""
        self.injected += self._pending
        self._pending = 0.0
        self.last = energies

    @property
    def least_scale(self) -> float:
        """Energy [J] of a strain of one in a million: a body at rest without load has no scale of its own."""
        return 1e-12 * float(self._backend.disc.Vmu.sum())

    def limit(self) -> float:
        """Largest total energy [J] that is still believed."""
        assert self.start is not None
        disc = self._backend.disc
        height = float(np.ptp(disc.mesh.points, axis=0).max())
        falling = float(disc.mass.sum()) * float(np.linalg.norm(self._gravity)) * height
        scale = self.start.kinetic + self.start.elastic + falling + self.injected + self._pending + self.least_scale
        return self.start.total + RUNAWAY_FACTOR * scale

    def complaint(self, energies: Energies) -> str | None:
        """What is wrong with a state, or None."""
        if not math.isfinite(energies.total):
            return "the energy is not finite"
        if energies.total > self.limit():
            return (
                f"runaway: total energy {energies.total:.4g} J, more than anything can have put in "
                f"(limit {self.limit():.4g} J)"
            )
        return None
