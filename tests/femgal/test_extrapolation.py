# SPDX-License-Identifier: BSD-3-Clause
"""Where a step is expected to end.

1. Accelerations that are linear in time are met exactly, steps of unequal length and damping included.
2. Of one step known, its acceleration is taken; of none, or with a potential without time, there is none.
3. After a step that became too much longer the last acceleration alone is taken.
4. Only the last two are remembered.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.kernels.plain.backend import PlainBackend
from femgal.solvers.extrapolation import BEFORE, LAST, TIMES, expected_offset, with_acceleration
from femgal.timestep.potential import IncrementalPotential
from verify.problems.bodies import distorted_box, uniform

MESH = distorted_box((2, 1, 1))
BACKEND = PlainBackend(uniform(MESH))
X = MESH.points
FIRST, SLOPE = np.random.default_rng(60_091).standard_normal((2, *X.shape))


def ended(time: float | None, inertia: float = 1.2) -> tuple[IncrementalPotential, np.ndarray]:
    """A potential, and a step that ended with the acceleration FIRST + time SLOPE."""
    potential = IncrementalPotential(BACKEND, X + 0.1, 0.05, inertia, time=time)
    return potential, potential.xhat + (FIRST + (time or 0.0) * SLOPE) / potential.inverse_h2


def remembered(*times: float) -> dict[str, np.ndarray]:
    memory: dict[str, np.ndarray] = {}
    for time in times:
        memory = with_acceleration(*ended(time), memory)
    return memory


@pytest.mark.parametrize("next_", [0.9, 1.1])
def test_linear_in_time(next_):
    potential, x = ended(next_)
    memory = remembered(0.0, 0.1, 0.6)
    np.testing.assert_allclose(potential.xhat + expected_offset(potential, memory), x, rtol=0, atol=1e-14)
    assert memory[TIMES].tolist() == [0.1, 0.6]
    assert memory[LAST].shape == memory[BEFORE].shape == X.shape


@pytest.mark.parametrize(("known", "next_"), [((0.5,), 0.6), ((0.5, 0.6), 1.0)])
def test_the_last_one_alone(known, next_):
    potential, _ = ended(next_)
    expected = (FIRST + known[-1] * SLOPE) / potential.inverse_h2
    np.testing.assert_allclose(expected_offset(potential, remembered(*known)), expected, rtol=0, atol=1e-14)


def test_nothing_known():
    for potential, memory in ((ended(0.1)[0], {}), (ended(None)[0], remembered(0.1, 0.2))):
        assert expected_offset(potential, memory) is None
    assert with_acceleration(*ended(None), {}) == {}
