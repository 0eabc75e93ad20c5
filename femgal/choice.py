# SPDX-License-Identifier: BSD-3-Clause
"""The choice of a solver that keeps an accuracy at the lower cost: `solver.name = "auto"`.

Velocity Verlet's substeps are known from the stable step, and at that step its error is mostly 1e-4 or less: where
they are few, nothing is cheaper. Else a pilot solves the first frames with `newton-multigrid` under the same control of
the error, and what a frame will cost on average, judged by them, decides. If it is for Newton's method, the pilot's
frames are the first ones of the run. Costs are counted in element passes and so the same on every machine: a scene has
one choice, and a run that is resumed has the same.

The first frames are not like the rest. Of a body that was set off suddenly most of the error comes at once; one that
swings freely loses its phase as time goes on; where a motion only gathers speed, the error falls behind it. So what the
error is to be at the end is led on from the pilot's frames as a power of time, and the substeps follow from it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from femgal.failure import SolverFailure
from femgal.frame import Frame, Stopped
from femgal.kernels.backend import Passes
from femgal.scene.model import Scene, SolverSettings
from femgal.timestep.control import AIM, MOST_SUBSTEPS
from femgal.timestep.tr_bdf2 import ORDER
from meshes.errors import InputError

if TYPE_CHECKING:
    from femgal.simulation import Simulation

# Frames of the pilot, which ends when what it expects gets no cheaper.
FEWEST_FRAMES, MOST_FRAMES = 4, 12
STILL_FALLING = 0.85

# A frame of S substeps costs as much as S to this power: shorter steps are easier to solve. In the rows of
# newton-multigrid of `femgal bench` on bunnies and beams of 2,000 vertices, 1 to 32 substeps, it is 0.72 to 0.92.
COST_POWER = 0.8

# Time of one of Newton's passes, with the sums of conjugate gradients, over that of one of Verlet's gradient passes;
# work of the preconditioner is counted among the passes. One thread, bunnies of 2,000 and 20,000 vertices.
COST_OF_NEWTON_PASS = 1.1

# The cheapest frame of Newton: one substep of two solves, some seventeen passes each.
LEAST_NEWTON_COST = 2 * 17 * COST_OF_NEWTON_PASS

# A pilot ends when it has cost this share of the whole motion with Verlet. Most of that is the first frame, which is
# taken again until its steps are short enough: with 0.15 pilots of 20 frames saw no other. With 0.25 those of a beam
# that is released at rest see two, each far dearer than all that come later, and give Newton's method up though it
# would be cheaper. Tried: 0.3 sees no more there, and 0.35 makes pilots that come to nothing dearer everywhere else.
MOST_PILOT_SHARE = 0.25

# What the pilot's frames do not show yet: most motions cost 1.3 to 2.4 times what their first frames let expect, beams
# that are released at rest 0.9 to 3.6 times, as nothing in those says how they will swing. `femgal bench` tells for
# each row of `auto` what was expected, this factor included, and what the motion took.
UNSEEN = 1.7

Assemble = Callable[[Scene], "Simulation"]


@dataclass(frozen=True)
class Choice:
    """What was chosen, and why.

    Parameters
    ----------
    solver : Name of the solver.
    substeps : Substeps of the first frame.
    reason : In words.
    verlet_cost : Gradient passes per frame of velocity Verlet.
    newton_cost : What a frame of newton-multigrid costs in the same unit; None where no pilot was needed or it was
        given up.
    wasted_passes : Element passes of a pilot that nothing came of, by kind; None where there was none.
    wasted_seconds, wasted_cpu_seconds : Wall time of it, and CPU time of all threads [s].
    """

    solver: str
    substeps: int
    reason: str
    verlet_cost: float
    newton_cost: float | None = None
    wasted_passes: dict[str, float] | None = None
    wasted_seconds: float = field(default=0.0, compare=False)
    wasted_cpu_seconds: float = field(default=0.0, compare=False)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return asdict(self)

    def __str__(self) -> str:
        return f"{self.solver}: {self.reason}"


def choose(scene: Scene, assemble: Assemble) -> Simulation:
    """Choose between `verlet` and `newton-multigrid`.

    Parameters
    ----------
    scene : With `solver.name = "auto"`.
    assemble : Makes a simulation of the same bodies with another solver.

    Returns
    -------
    simulation : With the solver that was chosen, the choice, and the frames that a pilot has solved.

    Raises
    ------
    InputError
        No solver can keep the accuracy with a sensible number of substeps.
    """
    explicit = assemble(with_solver(scene, "verlet"))
    _, substeps = explicit.stepper.begin_frame(explicit.start(), explicit.frame_duration)
    if substeps <= LEAST_NEWTON_COST:
        explicit.choice = Choice("verlet", substeps, f"stable with {substeps} substeps a frame", substeps)
        return explicit
    implicit = assemble(with_solver(scene, "newton-multigrid"))
    implicit.compile()
    began = time.perf_counter(), time.process_time()
    pilot = _fly(implicit, MOST_PILOT_SHARE * scene.frames * substeps)
    if pilot.cost is None or pilot.cost >= substeps:
        _check_substeps(scene, substeps)
        other = "newton-multigrid needs more" if pilot.cost is None else f"newton-multigrid costs {pilot.cost:.0f}"
        reason = f"{substeps} substeps a frame; {other}"
        seconds = time.perf_counter() - began[0], time.process_time() - began[1]
        explicit.choice = Choice("verlet", substeps, reason, substeps, pilot.cost, pilot.passes.as_dict(), *seconds)
        return explicit
    reason = f"a frame costs as much as {pilot.cost:.0f} substeps of verlet, which needs {substeps}"
    begin = int(pilot.frames[1].row["substeps"])
    implicit.choice = Choice("newton-multigrid", begin, reason, substeps, pilot.cost)
    implicit.plan = replace(implicit.plan, substeps=begin)
    implicit.solved = pilot.frames
    return implicit


def with_solver(scene: Scene, name: str) -> Scene:
    """The scene with a solver under the same accuracy, threads, precision and device."""
    settings = scene.solver
    given: dict[str, Any] = {"name": name, "accuracy": settings.accuracy}
    given |= {"threads": settings.threads, "precision": settings.precision, "device": settings.device}
    return scene.model_copy(update={"solver": SolverSettings.model_validate(given)})


@dataclass(frozen=True, eq=False)
class _Pilot:
    """What a pilot came to.

    Parameters
    ----------
    frames : From the start on.
    cost : Expected of a frame of Newton's method [gradient passes]; None when it failed, or the first frame alone cost
        too much.
    passes : Element passes of it.
    """

    frames: list[Frame]
    cost: float | None
    passes: Passes


def _fly(simulation: Simulation, most: float) -> _Pilot:
    """Frames of Newton's method, until what they let expect gets no cheaper or they have cost so much."""
    frames: list[Frame] = []
    passes, cost = Passes(), math.inf

    def goes_on(substep: int, substeps: int) -> bool:
        return COST_OF_NEWTON_PASS * (passes.total + simulation.backend.passes.total) < most

    try:
        for frame in simulation.frames(on_substep=goes_on):
            frames.append(frame)
            if frame.index == 0:
                continue
            passes.add(Passes(**frame.row["passes_by_kind"]))
            rows = [frame.row for frame in frames[1:]]
            before, cost = cost, expected_cost(rows, simulation.scene.frames, simulation.scene.solver.accuracy or 1.0)
            if frame.index >= FEWEST_FRAMES and (cost > STILL_FALLING * before or frame.index >= MOST_FRAMES):
                break
    except (SolverFailure, Stopped) as end:
        passes.add(simulation.backend.passes)
        if isinstance(end, SolverFailure):
            return _Pilot(frames, None, passes)
        # What its frames let expect still counts; without one, Newton's method is too dear for certain.
    return _Pilot(frames, cost if len(frames) > 1 else None, passes)


def expected_cost(rows: list[dict[str, Any]], frames: int, accuracy: float) -> float:
    """Mean cost of a motion's frames [gradient passes of velocity Verlet], from the first ones under control.

    Parameters
    ----------
    rows : Of these frames: substeps S, error estimated so far R, passes, retakes.
    frames : Of the whole motion.
    accuracy : Relative error asked for.
    """
    k = np.arange(1, len(rows) + 1)
    S, R = (np.array([row[name] for row in rows], float) for name in ("substeps", "estimated_error"))
    # Attempts that were too coarse cost less than the last one; later frames have none.
    last = COST_OF_NEWTON_PASS * rows[-1]["passes"] / (1 + rows[-1]["retakes"])
    if not (np.isfinite(R) & (R > 0.0)).all():
        return UNSEEN * last
    # R = r S^-p; r grows like k^q. Nothing is built on errors that fall, nor on the first frame where there are more.
    r, q = R * S**ORDER, 0.0
    if len(rows) > 2:
        q = float(np.clip(np.polyfit(np.log(k[1:]), np.log(r[1:]), 1)[0], 0.0, 1.0))
    needed = np.maximum(1.0, (r[-1] * (np.arange(1, frames + 1) / k[-1]) ** q / (AIM * accuracy)) ** (1.0 / ORDER))
    return UNSEEN * last * float(np.mean((needed / S[-1]) ** COST_POWER))


def _check_substeps(scene: Scene, substeps: int) -> None:
    if substeps > MOST_SUBSTEPS:
        raise InputError(
            "the accuracy cannot be kept",
            where=scene.name,
            found=f"{substeps} substeps a frame",
            allowed=f"up to {MOST_SUBSTEPS}",
            advice="a mesh without slivers, a softer body, or less accuracy",
        )
