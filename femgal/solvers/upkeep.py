# SPDX-License-Identifier: BSD-3-Clause
"""When a preconditioner is made anew.

Made once it serves many steps, and it costs several iterations to make. It is kept until the iterations that it has
cost more than when it was new add up to the price of another: so the two never cost more than twice what the best
moments for it would have.

The positions at which it was made are part of the motion's memory: a run that goes on from a checkpoint makes it there
again, and takes the same bits on.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from femgal.solvers.preconditioner import Preconditioner
from femgal.timestep.potential import IncrementalPotential

Floats = NDArray[np.float64]
Memory = dict[str, NDArray]

# Where it was made [m], shape [n, 3], and [factor of the mass 1/s^2, iterations when new, iterations lost since].
PLACE, WEAR = "preconditioner/place", "preconditioner/wear"

# It serves steps whose factor of the mass differs by this share: rounding of the step's length. Tried and dropped: to
# share it among steps that differ by up to 1.6 times. That makes a few per cent fewer passes, but a factor that is too
# large lets the residuals of slow modes look small: a bunny under control erred by twice as much, which its estimate
# did not see.
SAME = 1e-6


@dataclass(eq=False)
class Upkeep:
    """A preconditioner that is as new as it is worth.

    Parameters
    ----------
    preconditioner : Made anew from time to time.
    """

    preconditioner: Preconditioner
    _place: Floats | None = field(default=None, init=False, repr=False)
    _factor: float = field(default=0.0, init=False, repr=False)

    def make_ready(self, potential: IncrementalPotential, x: Floats, memory: Memory) -> Memory:
        """The preconditioner that this memory knows of, or one made at x where that is worn out or of other steps.

        Returns
        -------
        memory : With the preconditioner that is there now.
        """
        factor = potential.inverse_h2
        if WEAR in memory:
            made_for, _, lost = memory[WEAR]
            if abs(made_for - factor) <= SAME * factor and lost < self.preconditioner.price:
                self._make(potential, memory[PLACE], made_for)
                return memory
        return self._anew(potential, x, memory)

    def renew(self, potential: IncrementalPotential, x: Floats, memory: Memory) -> Memory:
        """The preconditioner made at x for these steps, whatever it has cost so far."""
        backend = potential.backend
        same = abs(float(memory[WEAR][0]) - potential.inverse_h2) <= SAME * potential.inverse_h2
        if same and float(backend.largest(backend.difference(memory[PLACE], x))) == 0.0:
            return memory
        return self._anew(potential, x, memory)

    def _anew(self, potential: IncrementalPotential, x: Floats, memory: Memory) -> Memory:
        place, factor = potential.backend.copy(x), potential.inverse_h2
        self._make(potential, place, factor)
        return memory | {PLACE: place, WEAR: np.array([factor, 0.0, 0.0])}

    def _make(self, potential: IncrementalPotential, place: Floats, factor: float) -> None:
        if self._place is place and self._factor == factor:
            return
        at = replace(potential, h=factor**-0.5, inertia=1.0)
        self.preconditioner.refresh(at, place)
        self._place, self._factor = place, factor

    def note(self, iterations: int, memory: Memory) -> Memory:
        """The memory after a linear system that took so many iterations."""
        factor, when_new, lost = memory[WEAR]
        when_new = when_new or iterations
        return memory | {WEAR: np.array([factor, when_new, lost + max(0.0, iterations - when_new)])}
