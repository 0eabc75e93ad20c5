# SPDX-License-Identifier: BSD-3-Clause
"""Selective mass scaling: a little mass where it lengthens the stable step of explicit integration most.

Steps of h are stable where m_i >= h^2 k_i / 4 at every vertex (`femgal.timestep.stable_step`), so the least mass that
makes h stable, by this bound, is h^2 k_i / 4 - m_i at the vertices where that is positive. The user says which share
of its mass a part of the scene may gain, and h is the longest step that this pays for.

The usual way, to raise the density of each element until its own step is long enough, adds more: it does not see the
mass that neighbours bring to the vertices of a sliver (tests/femgal/test_mass_scaling.py compares the two).

The added mass is heavy as well as inert: it replaces the lumped mass wherever that appears. Bodies in free fall so
stay free of stress, energy and momentum are those of one and the same, slightly heavier body, and the price is a weight
that is too large by the share reported. Inertia alone would leave the weight right, but scaled parts would lag behind
in free fall and be dragged along by the others.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.timestep.stable_step import guaranteed_step
from meshes.connectivity import component_labels

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# An added share beyond this changes what is simulated: the user is warned.
WARN_SHARE = 0.05

_BISECTIONS = 50


@dataclass(frozen=True)
class MassScaling:
    """What was added to the mass of a scene.

    Parameters
    ----------
    added, mass : Added mass, and mass before [kg].
    largest_share : Largest share that a connected part of the scene gained.
    vertices : Number of vertices that became heavier.
    step_before, step : Steps that are guaranteed to be stable at rest, before and after [s].
    """

    added: float
    mass: float
    largest_share: float
    vertices: int
    step_before: float
    step: float

    def __str__(self) -> str:
        return (
            f"{self.added:.4g} kg ({100.0 * self.added / self.mass:.3g} %) added at {self.vertices} vertices, "
            f"{self.step / self.step_before:.3g} times the stable step"
        )

    def as_dict(self) -> dict[str, Any]:
        """The same for run.json."""
        return {**asdict(self), "share": self.added / self.mass}

    @property
    def warning(self) -> str | None:
        """What to know about an added share beyond WARN_SHARE."""
        if self.largest_share <= WARN_SHARE:
            return None
        return (
            f"solver.mass_scaling adds {100.0 * self.largest_share:.3g} % to the mass and weight of a body: beyond "
            f"{100.0 * WARN_SHARE:g} % the motion itself changes"
        )


def scale_mass(disc: Discretisation, k: Floats, share: float) -> tuple[Discretisation, MassScaling]:
    """Add mass so that the guaranteed step is as long as it can be.

    Parameters
    ----------
    disc : The discretised bodies.
    k : Vertex stiffness [N/m], shape [n].
    share : Largest share of its mass that a connected part of the mesh may gain.
    """
    part = _parts(disc)
    added = added_mass(k, disc.mass, _longest_step(k, disc.mass, part, share))
    mass = disc.mass + added
    scaling = MassScaling(
        added=float(added.sum()),
        mass=float(disc.mass.sum()),
        largest_share=_largest_share(part, added, disc.mass),
        vertices=int((added > 0.0).sum()),
        step_before=guaranteed_step(k, disc.mass),
        step=guaranteed_step(k, mass),
    )
    return replace(disc, mass=mass), scaling


def added_mass(k: Floats, mass: Floats, step: float) -> Floats:
    """Least mass [kg] to add at each vertex so that steps of `step` seconds are stable, shape [n]."""
    return np.maximum(0.25 * step**2 * k - mass, 0.0)


def share_for(disc: Discretisation, k: Floats, step: float) -> float:
    """Largest share that a connected part has to gain for steps of `step` seconds to be stable."""
    return _largest_share(_parts(disc), added_mass(k, disc.mass, step), disc.mass)


def _parts(disc: Discretisation) -> Integers:
    """Connected part of each vertex, numbered from 0, shape [n]."""
    return np.unique(component_labels(disc.mesh.cells), return_inverse=True)[1].reshape(-1)


def _largest_share(part: Integers, added: Floats, mass: Floats) -> float:
    return float((np.bincount(part, added) / np.bincount(part, mass)).max())


def _longest_step(k: Floats, mass: Floats, part: Integers, share: float) -> float:
    """Longest step for which no part gains more than `share` of its mass; zero where nothing can move."""
    moves = np.bincount(part, k) > 0.0
    if not moves.any():
        return 0.0
    total = np.bincount(part, mass)
    # h^2 / 4 by bisection. The whole of k never needs less than what its vertices need together.
    low = 0.25 * guaranteed_step(k, mass) ** 2
    high = float(((1.0 + share) * total[moves] / np.bincount(part, k)[moves]).min())
    light = np.flatnonzero(high * k > mass)
    k, mass, part = k[light], mass[light], part[light]
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        added = np.bincount(part, np.maximum(middle * k - mass, 0.0), len(total))
        low, high = (middle, high) if (added <= share * total).all() else (low, middle)
    return 2.0 * math.sqrt(low)
