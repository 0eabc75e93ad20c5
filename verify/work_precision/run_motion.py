# SPDX-License-Identifier: BSD-3-Clause
"""One motion: solve a scene, timing every frame, and keep where it went."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femgal.failure import SolverFailure
from femgal.frame import Frame
from femgal.hierarchy.layer import free_parts
from femgal.scene.model import Scene
from femgal.simulation import Simulation
from femgal.timestep.control import AccuracyControl
from femgal.timestep.implicit import ImplicitMethod
from meshes.connectivity import component_labels
from verify.benchmark.trajectory import momenta
from verify.work_precision.counted import CountedSolver
from verify.work_precision.request import Request

Arrays = dict[str, NDArray[Any]]


class _Stages:
    """Wall and CPU time [s] of what is announced, one after the other."""

    def __init__(self) -> None:
        self.seconds: dict[str, tuple[float, float]] = {}
        self._doing: str | None = None
        self._since = (0.0, 0.0)

    def __call__(self, text: str | None) -> None:
        now = (time.perf_counter(), time.process_time())
        if self._doing is not None:
            wall, cpu = self._since
            self.seconds[self._doing] = (now[0] - wall, now[1] - cpu)
        self._doing, self._since = text, now


def run_motion(
    scene: Scene, request: Request, on_ready: Callable[[], None] = lambda: None
) -> tuple[dict[str, Any], Arrays]:
    """Numbers and arrays of a scene's motion.

    Parameters
    ----------
    scene, request : What to solve, and how.
    on_ready : Called when all is built and compiled, before the first frame.

    Returns
    -------
    JSON-ready numbers; and mass [kg] and part of each vertex, whether it is held, and displacements [m] since the
    start, float32 from positions in double precision, shape [frames, n, 3].

    Raises
    ------
    InputError
        The scene cannot be built, or the solver cannot be had.
    """
    stages = _Stages()
    simulation = Simulation.prepare(scene, stages)
    stages("compiling and estimating")
    counted = seat_solver(simulation, request)
    simulation.compile()
    _warm_up(simulation)
    stages(None)
    if counted is not None:
        counted.forget()
    # All frames are measured here, those of a pilot too.
    simulation.solved.clear()
    motion = _Motion(simulation, counted)
    on_ready()
    motion.go()
    return motion.numbers() | {"stages": stages.seconds, "gaps": _gaps(counted)}, motion.arrays()


def _warm_up(simulation: Simulation) -> None:
    """Steps that are thrown away: methods of several steps compile the last of their kernels in the third."""
    state, h = simulation.start(), 1e-3 * simulation.frame_duration
    for _ in range(3):
        state = simulation.stepper.step(state, h)


def seat_solver(simulation: Simulation, request: Request) -> CountedSolver | None:
    """Put the solver that is asked for into its seat, and a counter around it; None for an explicit method."""
    stepper = simulation.stepper
    if isinstance(stepper, AccuracyControl):
        stepper = stepper.stepper
    if not isinstance(stepper, ImplicitMethod):
        return None
    if request.solver is not None:
        from verify.solvers.registry import reference_solver  # type: ignore[import-untyped]

        stepper.solver = reference_solver(request.solver, simulation, **request.settings)
    stepper.solver = counted = CountedSolver(stepper.solver, request.gaps)
    return counted


def _gaps(counted: CountedSolver | None) -> list[float]:
    if counted is None or not counted.solutions:
        return []
    from verify.work_precision.energy_gap import energy_gaps

    return energy_gaps(counted.solutions)


@dataclass(eq=False)
class _Motion:
    """The frames of a simulation, one after the other."""

    simulation: Simulation
    counted: CountedSolver | None
    rows: list[dict[str, Any]] = field(default_factory=list)
    moved: list[NDArray[np.float32]] = field(default_factory=list)
    failure: str | None = None

    def go(self) -> None:
        """Solve until the end, or until it fails."""
        try:
            for frame, cpu in _timed(self.simulation.frames()):
                self._keep(frame, cpu)
        except SolverFailure as error:
            self.failure = str(error)

    def _keep(self, frame: Frame, cpu: float) -> None:
        X, mass = self.simulation.disc.mesh.points, self.simulation.disc.mass
        self.moved.append((frame.state.x - X).astype(np.float32))
        counts: dict[str, Any] = {"cpu_seconds": cpu}
        if self.counted is not None:
            counts |= {"iterations": self.counted.iterations, "linear_iterations": self.counted.linear_iterations}
        row = frame.row | momenta(mass, frame.state.x, frame.state.v) | counts
        choice = self.simulation.choice
        if frame.index == 1 and choice is not None and choice.wasted_passes is not None:
            # A pilot that nothing came of is part of what the motion costs.
            passes = {kind: n + choice.wasted_passes[kind] for kind, n in row["passes_by_kind"].items()}
            row |= {"passes": sum(passes.values()), "passes_by_kind": passes}
            row["seconds"] += choice.wasted_seconds
            row["cpu_seconds"] += choice.wasted_cpu_seconds
        self.rows.append(row)

    def numbers(self) -> dict[str, Any]:
        """JSON-ready."""
        disc = self.simulation.disc
        return {
            "vertices": disc.n_vertices,
            "tets": disc.n_tets,
            "free": free_parts(disc) is not None,
            "threads": self.simulation.backend.threads,
            "precision": self.simulation.backend.precision,
            "rows": self.rows[1:],
            "start": self.rows[0],
            "estimated_error": self.rows[-1].get("estimated_error"),
            "choice": None if self.simulation.choice is None else self.simulation.choice.as_dict(),
            "failure": self.failure,
            "failure_kind": None if self.failure is None else "solver",
        }

    def arrays(self) -> Arrays:
        """Masses, parts and displacements; the first frame is the start, which may be deformed already."""
        disc = self.simulation.disc
        moved = np.stack(self.moved[1:]) - self.moved[0] if len(self.moved) > 1 else None
        return {
            "mass": disc.mass,
            "part": component_labels(disc.mesh.cells),
            "held": ~disc.free,
            "start": self.simulation.world.x0,
            "displacement": np.empty((0, disc.n_vertices, 3), np.float32) if moved is None else moved,
        }


def _timed(frames: Iterator[Frame]) -> Iterator[tuple[Frame, float]]:
    """Each frame with the CPU time [s] of all threads that it took."""
    while True:
        since = time.process_time()
        frame = next(frames, None)
        if frame is None:
            return
        yield frame, time.process_time() - since
