# SPDX-License-Identifier: BSD-3-Clause
"""Keeping a preconditioner for as long as it is worth it.

1. It is made once, and again when the iterations lost add up to its price; the first system after that says how many
   there are when it is new.
2. Another step length makes it anew, at the positions of then; damping changes the factor of the mass as a step does.
3. It is made anew on demand, unless that is where and what it was made for.
4. What serves a memory is what was made where the memory says, also for an object that has never seen that motion.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.kernels.plain.backend import PlainBackend
from femgal.solvers.upkeep import PLACE, WEAR, Upkeep
from femgal.timestep.potential import IncrementalPotential
from verify.problems.bodies import distorted_box, uniform

MESH = distorted_box((2, 1, 1))
BACKEND = PlainBackend(uniform(MESH))
X = MESH.points


class Recorder:
    """Notes where it is made, and for which factor of the mass."""

    price = 3.0

    def __init__(self) -> None:
        self.made: list[tuple[float, float]] = []

    def refresh(self, potential: IncrementalPotential, x) -> None:
        self.made.append((float(x[0, 0]), potential.inverse_h2))

    def apply(self, r):
        return r


def potential(h: float = 0.01, inertia: float = 1.0) -> IncrementalPotential:
    return IncrementalPotential(BACKEND, X.copy(), h, inertia)


def test_made_anew_when_the_loss_is_its_price():
    made = Recorder()
    upkeep, memory = Upkeep(made), {}
    for place, iterations in enumerate([4, 5, 4, 6, 9]):
        memory = upkeep.note(iterations, upkeep.make_ready(potential(), X + place, memory))
    # 1 + 0 + 2 lost by the fourth system: the fifth has a new one, and 9 iterations are what that takes.
    assert [at - X[0, 0] for at, _ in made.made] == [0.0, 4.0]
    assert memory[WEAR][1:].tolist() == [9.0, 0.0]
    assert np.array_equal(memory[PLACE], X + 4)


@pytest.mark.parametrize("other", [potential(0.02), potential(0.01, 1.1)])
def test_steps_of_another_length(other):
    made = Recorder()
    upkeep = Upkeep(made)
    memory = upkeep.make_ready(potential(), X, {})
    upkeep.make_ready(other, X + 1, upkeep.make_ready(potential(), X + 1, memory))
    assert [at - X[0, 0] for at, _ in made.made] == [0.0, 1.0]
    np.testing.assert_allclose([factor for _, factor in made.made], [1e4, other.inverse_h2], rtol=1e-12)


def test_made_anew_on_demand():
    made = Recorder()
    upkeep = Upkeep(made)
    memory = upkeep.note(5, upkeep.make_ready(potential(), X, {}))
    assert upkeep.renew(potential(), X.copy(), memory) is memory
    memory = upkeep.renew(potential(0.012), X.copy(), memory)
    assert made.made[1] == (X[0, 0], pytest.approx(potential(0.012).inverse_h2))
    memory = upkeep.renew(potential(0.012), X + 1, memory)
    assert [at - X[0, 0] for at, _ in made.made] == [0.0, 0.0, 1.0]
    assert np.array_equal(memory[PLACE], X + 1)
    assert memory[WEAR][1:].tolist() == [0.0, 0.0]


def test_the_memory_says_where():
    made = Recorder()
    memory = Upkeep(made).make_ready(potential(), X, {})
    copied = {name: array.copy() for name, array in memory.items()}
    after = Upkeep(made).make_ready(potential(), X + 1, copied)
    assert [at - X[0, 0] for at, _ in made.made] == [0.0, 0.0]
    assert made.made[0][1] == pytest.approx(made.made[1][1], rel=1e-12)
    assert np.array_equal(after[PLACE], X)
