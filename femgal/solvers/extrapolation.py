# SPDX-License-Identifier: BSD-3-Clause
"""Where the next step is expected to end, from the elastic accelerations of the last ones.

xhat leaves elastic forces out, so it misses the end of a step by h^2 a, however short the step is: a solver that
reduces this by a given factor leaves an error in the acceleration that no number of steps removes. With the
acceleration of the last two steps, drawn on linearly, the miss is of order h^4 where the motion is smooth: the same
reduction leaves less and less.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from femgal.timestep.potential import IncrementalPotential

Floats = NDArray[np.float64]
Memory = dict[str, NDArray]

# Elastic accelerations of the last step and the one before it [m/s^2], shape [n, 3], and their times, ascending [s].
LAST, BEFORE, TIMES = "newton/acceleration", "newton/acceleration_before", "newton/times"

# They are drawn on by so many times the distance of the two: stages of TR-BDF2 need 1.41. After a step that became
# much longer the last acceleration alone is better.
LARGEST_SHARE = 1.5


def expected_offset(potential: IncrementalPotential, memory: Memory) -> Floats | None:
    """h^2 a [m], shape [n, 3]: from xhat to where the step should end; None where there is no step to draw on."""
    if LAST not in memory or potential.time is None:
        return None
    backend, h2, times = potential.backend, 1.0 / potential.inverse_h2, memory[TIMES]
    last = memory[LAST]
    offset = backend.zeros(len(last))
    backend.add_scaled(offset, h2, last)
    # Two steps that end at one time are those of somebody who takes a step again.
    apart = float(times[-1] - times[0])
    share = float(potential.time - times[-1]) / apart if apart > 0.0 else 0.0
    if 0.0 < share <= LARGEST_SHARE:
        backend.add_scaled(offset, h2 * share, backend.difference(last, memory[BEFORE]))
    return offset


def with_acceleration(potential: IncrementalPotential, x: Floats, memory: Memory) -> Memory:
    """The memory with the elastic acceleration of a step that ended at x, and that of the step before."""
    if potential.time is None:
        return memory
    known = {LAST: potential.elastic_acceleration(x), TIMES: np.array([potential.time])}
    if TIMES in memory:
        known |= {BEFORE: memory[LAST], TIMES: np.concatenate([memory[TIMES][-1:], known[TIMES]])}
    return memory | known
