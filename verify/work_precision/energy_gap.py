# SPDX-License-Identifier: BSD-3-Clause
"""How far from the minimum a solver stops: the energy gap of a substep (Wang et al. 2018, Fig. 4)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from femgal.solvers.solver import minimise
from femgal.timestep.potential import IncrementalPotential
from verify.reference.newton import ReferenceNewton

Floats = NDArray[np.float64]


def energy_gaps(solutions: Sequence[tuple[IncrementalPotential, Floats]]) -> list[float]:
    """(phi(x) - phi*) / (phi(xhat) - phi*) of each (potential, solution x).

    phi* is the minimum, from Newton's method with a direct solver; every gap is measured from the prediction xhat,
    whatever the solver starts from, so that those of all solvers mean the same.
    """
    return [_gap(potential, x) for potential, x in solutions]


def _gap(potential: IncrementalPotential, x: Floats) -> float:
    least = potential.value(minimise(ReferenceNewton(potential.backend.disc), potential, {}).x)
    first = potential.value(potential.xhat) - least
    return (potential.value(x) - least) / first if first > 0.0 else 0.0
