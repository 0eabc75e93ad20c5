# SPDX-License-Identifier: BSD-3-Clause
"""The choice of a solver that keeps an accuracy at the lower cost: `solver.name = "auto"`.

Velocity Verlet's substeps are known from the stable step, and at that step its error is mostly 1e-4 or less: where
they are few, nothing is cheaper. Else a pilot solves the first frames with `newton-multigrid` under the same control of
the error, and what its last frame cost decides. Costs are counted in element passes and so the same on every machine:
a scene has one choice, and a run that is resumed has the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from femgal.failure import SolverFailure
from femgal.scene.model import Scene, SolverSettings
from femgal.timestep.control import MOST_SUBSTEPS
from meshes.errors import InputError

if TYPE_CHECKING:
    from femgal.simulation import Simulation

# Frames of the pilot. The first ones are the hardest, as little has moved yet; the pilot ends when they get no cheaper.
FEWEST_FRAMES, MOST_FRAMES = 3, 12
STILL_FALLING = 0.85

# Time of one of Newton's passes, with the sums of conjugate gradients, over that of one of Verlet's gradient passes;
# work of the preconditioner is counted among the passes. One thread, bunnies of 2,000 and 20,000 vertices.
COST_OF_NEWTON_PASS = 1.1

# The cheapest frame of Newton: two substeps and one of the companion, two solves each, of some thirteen passes.
LEAST_NEWTON_COST = 3 * 2 * 13 * COST_OF_NEWTON_PASS

# A pilot that has cost this share of the whole motion with Verlet is given up.
MOST_PILOT_SHARE = 0.15

Assemble = Callable[[Scene], "Simulation"]


@dataclass(frozen=True)
class Choice:
    """What was chosen, and why.

    Parameters
    ----------
    solver : Name of the solver.
    substeps : Substeps that a frame begins with.
    reason : In words.
    verlet_cost : Gradient passes per frame of velocity Verlet.
    newton_cost : What a frame of newton-multigrid costs in the same unit; None where no pilot was needed or it was
        given up.
    """

    solver: str
    substeps: int
    reason: str
    verlet_cost: float
    newton_cost: float | None = None

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return asdict(self)

    def __str__(self) -> str:
        return f"{self.solver}: {self.reason}"


def choose(scene: Scene, assemble: Assemble) -> Choice:
    """Choose between `verlet` and `newton-multigrid`.

    Parameters
    ----------
    scene : With `solver.name = "auto"`.
    assemble : Makes a simulation of the same bodies with another solver.

    Raises
    ------
    InputError
        No solver can keep the accuracy with a sensible number of substeps.
    """
    explicit = assemble(with_solver(scene, "verlet"))
    _, substeps = explicit.stepper.begin_frame(explicit.start(), explicit.frame_duration)
    if substeps <= LEAST_NEWTON_COST:
        return Choice("verlet", substeps, f"stable with {substeps} substeps a frame", substeps)
    found = _pilot(assemble(with_solver(scene, "newton-multigrid")), MOST_PILOT_SHARE * scene.frames * substeps)
    if found is None or found[0] >= substeps:
        _check_substeps(scene, substeps)
        other = "newton-multigrid needs more" if found is None else f"newton-multigrid costs as much as {found[0]:.0f}"
        reason = f"{substeps} substeps a frame; {other}"
        return Choice("verlet", substeps, reason, substeps, None if found is None else found[0])
    cost, begin = found
    reason = f"a frame costs as much as {cost:.0f} substeps of verlet, which needs {substeps}"
    return Choice("newton-multigrid", begin, reason, substeps, cost)


def with_solver(scene: Scene, name: str, substeps: int | None = None) -> Scene:
    """The scene with a solver under the same accuracy, threads and precision."""
    settings = scene.solver
    given: dict[str, Any] = {"name": name, "accuracy": settings.accuracy}
    given |= {"threads": settings.threads, "precision": settings.precision}
    if name != "verlet":
        given["substeps"] = substeps
    return scene.model_copy(update={"solver": SolverSettings.model_validate(given)})


def _pilot(simulation: Simulation, most: float) -> tuple[float, int] | None:
    """Cost of a frame of Newton's method [gradient passes] and its substeps; None when it costs too much."""
    from femgal.simulation import Stopped

    spent = 0.0

    def goes_on(substep: int, substeps: int) -> bool:
        return COST_OF_NEWTON_PASS * (spent + simulation.backend.passes.total) < most

    cost, substeps = math.inf, 0
    try:
        for frame in simulation.frames(on_substep=goes_on):
            if frame.index == 0:
                continue
            # Attempts that were too coarse cost less than the last one; later frames have none.
            before, cost = cost, COST_OF_NEWTON_PASS * frame.row["passes"] / (1 + frame.row["retakes"])
            substeps = frame.row["substeps"]
            spent += frame.row["passes"]
            if frame.index >= FEWEST_FRAMES and (cost > STILL_FALLING * before or frame.index >= MOST_FRAMES):
                break
    except (Stopped, SolverFailure):
        return None
    return cost, substeps


def _check_substeps(scene: Scene, substeps: int) -> None:
    if substeps > MOST_SUBSTEPS:
        raise InputError(
            "the accuracy cannot be kept",
            where=scene.name,
            found=f"{substeps} substeps a frame",
            allowed=f"up to {MOST_SUBSTEPS}",
            advice="a mesh without slivers, a softer body, or less accuracy",
        )
