# SPDX-License-Identifier: BSD-3-Clause
"""One step of an implicit method, solved iteration by iteration: how fast a solver goes down from one prediction.

Lu et al. 2025 (Fig. 2 and Fig. 7a, b) compare solvers like this, by eps18 over iterations and over time. Beside eps18
stand the energy gap and the distance from the minimiser: eps18 weighs the stiff modes, which the eye does not see.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femgal.failure import SolverFailure
from femgal.scene.model import Scene, SolverSettings
from femgal.simulation import Simulation
from femgal.solvers.solver import Solver, SolverState, minimise
from femgal.timestep.implicit import ImplicitMethod
from femgal.timestep.potential import IncrementalPotential, eps18
from femgal.timestep.state import MotionState
from meshes.errors import InputError
from verify.work_precision.request import Request
from verify.work_precision.run_motion import seat_solver

Floats = NDArray[np.float64]

# The motion up to the step, and the minimiser of the step.
_ACCURATE: dict[str, Any] = {"name": "newton-multigrid", "stepping": "backward-euler"}
_WAY = _ACCURATE | {"substeps": 8, "reduction": 1e-3}
_MINIMUM = _ACCURATE | {"reduction": 1e-9, "iterations": 50, "linear_iterations": 5000}


@dataclass(frozen=True)
class SubstepOptions:
    """Which step is solved, and for how long.

    Parameters
    ----------
    at_frame : The step is the first one after this frame; 0 for the first of all.
    iterations : Of the solver at most.
    seconds : CPU time of the solver at most [s]; the iteration that exceeds it is the last.
    until : Stop when eps18 is below this share of the prediction's.
    """

    at_frame: int = 0
    iterations: int = 200
    seconds: float = 60.0
    until: float = 1e-4


@dataclass(eq=False)
class _Step:
    """What a solver has to solve, and how far each iterate is from the solution.

    Parameters
    ----------
    potential : Of the step, on a backend of its own: measuring counts as no pass of the solver.
    x : Minimiser [m], shape [n, 3].
    """

    potential: IncrementalPotential
    x: Floats
    least: float = field(init=False)
    range: float = field(init=False)
    reach: float = field(init=False)

    def __post_init__(self) -> None:
        xhat = self.potential.xhat
        self.least = self.potential.value(self.x)
        self.range = self.potential.value(xhat) - self.least
        self.reach = self._length(xhat - self.x)

    def judge(self, x: Floats) -> dict[str, float | None]:
        """eps18 [m]; energy gap and distance from the minimiser, both 1 at the prediction."""
        return {
            "eps18": _finite(eps18(self.potential.residual(x))),
            "gap": _share(self.potential.value(x) - self.least, self.range),
            "distance": _share(self._length(x - self.x), self.reach),
        }

    def _length(self, d: Floats) -> float:
        return math.sqrt(float(self.potential.backend.disc.mass @ (d**2).sum(axis=1)))


def run_substep(scene: Scene, request: Request) -> dict[str, Any]:
    """JSON-ready: size, eps18 of prediction and minimiser, and one row per iterate, the first of them the start.

    Raises
    ------
    InputError
        The scene cannot be built, the solver cannot be had, or it is one that solves no step.
    """
    options = SubstepOptions(**request.options)
    simulation = Simulation.prepare(scene)
    seat_solver(simulation, request)
    stepper = simulation.stepper
    if not isinstance(stepper, ImplicitMethod):
        raise InputError("solves no equation", where="single substep", found=scene.solver.name)
    h = simulation.frame_duration / stepper.substeps
    try:
        state = _state(scene, options.at_frame) or simulation.start()
        step = _solved(scene, state, h)
    except SolverFailure as error:
        return {"failure": f"on the way to the step: {error}", "failure_kind": "solver"}
    ready, _ = stepper.begin_frame(state, simulation.frame_duration)
    simulation.compile(ready)
    rows = list(_rows(stepper, ready, h, step, options))
    return {
        "vertices": simulation.disc.n_vertices,
        "tets": simulation.disc.n_tets,
        "precision": simulation.backend.precision,
        "h": h,
        "prediction": step.judge(step.potential.xhat),
        "minimiser": step.judge(step.x),
        "rows": rows,
    }


def _state(scene: Scene, frame: int) -> MotionState | None:
    """Positions and velocities at a frame, without what another solver remembers; None for the start."""
    if frame == 0:
        return None
    *_, last = _with_solver(scene, _WAY | {"threads": scene.solver.threads}, frames=frame).frames()
    return MotionState(last.state.time, last.state.x, last.state.v)


def _solved(scene: Scene, state: MotionState, h: float) -> _Step:
    simulation = _with_solver(scene, _MINIMUM | {"threads": scene.solver.threads})
    stepper = simulation.stepper
    assert isinstance(stepper, ImplicitMethod)
    potential = stepper.potential(state, h)
    return _Step(potential, minimise(stepper.solver, potential, {}).x)


def _with_solver(scene: Scene, settings: dict[str, Any], **changes: Any) -> Simulation:
    solver = SolverSettings.model_validate(settings)
    return Simulation.prepare(scene.model_copy(update={"solver": solver, **changes}))


def _rows(
    stepper: ImplicitMethod, state: MotionState, h: float, step: _Step, options: SubstepOptions
) -> Iterator[dict[str, Any]]:
    """One row per iterate; times [s] and passes grow from row to row."""
    solver, backend = stepper.solver, stepper.backend
    # Without the state before the step all solvers start from the prediction; some have a better start of their own.
    potential = replace(stepper.potential(state, h), x_n=None)
    first = eps18(step.potential.residual(potential.xhat))
    # Once for nothing: what is compiled or allocated at first use is nobody's time.
    solver.step(potential, solver.init(potential, state.memory))
    passes, linear = backend.passes.total, _linear(solver)
    clocks = _Clocks()
    iterate: SolverState | None = None
    distance: float | None = math.nan
    for number in range(options.iterations + 1):
        clocks.start()
        iterate = solver.step(potential, iterate) if iterate else solver.init(potential, state.memory)
        clocks.stop()
        found = step.judge(iterate.x)
        yield {
            "iteration": number,
            "seconds": clocks.wall,
            "cpu_seconds": clocks.cpu,
            "passes": backend.passes.total - passes,
            "linear_iterations": None if linear is None else (_linear(solver) or 0) - linear,
            **found,
        }
        if _is_enough(found, first, options) or clocks.cpu > options.seconds or found["distance"] == distance:
            return
        distance = found["distance"]


def _is_enough(found: dict[str, float | None], first: float, options: SubstepOptions) -> bool:
    reached = found["eps18"]
    return reached is None or reached <= options.until * first


class _Clocks:
    """Wall and CPU time [s] of what stands between start and stop."""

    wall = cpu = 0.0

    def start(self) -> None:
        self._since = time.perf_counter(), time.process_time()

    def stop(self) -> None:
        wall, cpu = self._since
        self.wall += time.perf_counter() - wall
        self.cpu += time.process_time() - cpu


def _linear(solver: Solver) -> int | None:
    """Iterations of the linear solver so far, of those that count them over all steps."""
    effort: Any = getattr(getattr(solver, "solver", solver), "effort", None)
    return None if effort is None else int(effort.linear)


def _share(part: float, whole: float) -> float | None:
    return _finite(part / whole) if whole > 0.0 else None


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
