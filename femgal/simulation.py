# SPDX-License-Identifier: BSD-3-Clause
"""A scene made ready to run, and the loop over its frames. Writes nothing: `femgal.runner` does."""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femgal.choice import Choice, choose
from femgal.device_choice import check_device, make_backend
from femgal.diagnostics import Energies, EnergyGuard, energies_of
from femgal.discretisation import Discretisation, discretise
from femgal.failure import SolverFailure
from femgal.frame import Frame, Stopped
from femgal.hierarchy.hierarchy import Hierarchy, build_constant_hierarchy, build_linear_hierarchy
from femgal.kernels.backend import Backend, Passes
from femgal.scene.build import World, build_world
from femgal.scene.model import Scene, SolverSettings
from femgal.scene.plan import Plan, make_plan, needs_hierarchy
from femgal.solvers.blocks import with_blocks_to_use
from femgal.timestep.build import build_stepper, prepare_mass
from femgal.timestep.control import AccuracyControl
from femgal.timestep.mass_scaling import MassScaling
from femgal.timestep.potential import eps18
from femgal.timestep.state import MotionState, TimeStepper

Floats = NDArray[np.float64]

# Raised when the memory of a state changes its names or their meaning: checkpoints of before are refused.
MEMORY_FORMAT = 2

# A frame that its method rejects is taken again with more substeps, at most so often.
MOST_RETAKES = 8

# Velocity Verlet keeps the energy up to an oscillation that falls with h^2, backward Euler loses some. A frame in which
# it grows by more than this share has taken steps that are too long for the method, or for its step lengths.
MOST_GAIN = 0.01

# Called with what is being done now: "building mesh", "compiling", ...
Announce = Callable[[str], None]
# Called after each substep with (substep, substeps); returns False to stop after the last complete frame.
OnSubstep = Callable[[int, int], bool]


@dataclass(frozen=True, eq=False)
class _Attempt:
    """One way through a frame.

    Parameters
    ----------
    state : Where it led.
    wanted : Substeps to take the frame again with; None when that is not wanted or would be of no use.
    complaint : What is wrong with the state; None to accept it.
    measured : Its energies, when they have been computed.
    lost_at : Substep after which positions were not finite.
    """

    state: MotionState
    wanted: int | None
    complaint: str | None
    measured: tuple[Energies, Floats, Floats] | None = None
    lost_at: int | None = None


@dataclass(eq=False)
class Simulation:
    """A scene with its mesh, hierarchy, plan and time-stepping method.

    Parameters
    ----------
    scene : What to solve.
    world : Mesh, material, start and prescribed motion of all bodies.
    disc : The discretised bodies.
    hierarchy : Layers of the multigrid solver; None for the others.
    plan : Stages that run, and those that are skipped.
    backend : Element passes.
    stepper : Time-stepping method.
    mass_scaling : What was added to the mass of `disc` for longer steps; None when nothing was asked for.
    choice : Which solver was chosen and why; None where the scene names one.

    Attributes
    ----------
    solved : Frames from the start on that were solved when the solver was chosen; `frames` begins with them, once.
    """

    scene: Scene
    world: World
    disc: Discretisation
    hierarchy: Hierarchy | None
    plan: Plan
    backend: Backend
    stepper: TimeStepper
    mass_scaling: MassScaling | None = None
    choice: Choice | None = None
    guard: EnergyGuard = field(init=False)
    solved: list[Frame] = field(default_factory=list, init=False, repr=False)
    _start: MotionState | None = field(default=None, init=False, repr=False)
    # Substeps of the present frame that missed the tolerance asked for.
    _unconverged: int = field(default=0, init=False, repr=False)
    _compiled: bool = field(default=False, init=False, repr=False)

    def __post_init__(self) -> None:
        self.gravity = np.asarray(self.scene.gravity, np.float64)
        self.guard = EnergyGuard(self.backend, self.gravity, self.world.motions)

    @classmethod
    def prepare(cls, scene: Scene, announce: Announce = lambda text: None) -> Simulation:
        """Build everything that a scene needs.

        Where its solver is `auto`, one is chosen, which may take a few frames; the simulation's scene names it, and
        `frames` hands on what has been solved.

        Raises
        ------
        InputError
            The scene cannot be built; the message says where, what was found and what is allowed.
        """
        check_device(scene.solver)
        announce("building the mesh")
        world = build_world(scene)
        if scene.solver.name != "auto":
            return cls.assemble(scene, world, announce)
        announce("choosing a solver")
        return choose(scene, lambda candidate: cls.assemble(candidate, world))

    @classmethod
    def assemble(cls, scene: Scene, world: World, announce: Announce = lambda text: None) -> Simulation:
        """A simulation of bodies that have been built; the scene names its solver.

        Raises
        ------
        InputError
            The bodies cannot be solved with these settings, or do not fit into the device's memory.
        """
        constrained = np.concatenate([np.empty(0, np.int64), *(motion.vertices for motion in world.motions)])
        disc = discretise(world.mesh, world.E, world.nu, world.rho, constrained)
        disc, scaling, warnings = prepare_mass(scene.solver, disc)
        world = replace(world, warnings=(*world.warnings, *warnings))
        hierarchy = None
        if needs_hierarchy(scene.solver):
            announce("building the hierarchy")
            hierarchy = _build_hierarchy(disc, scene.solver)
        plan = make_plan(scene, world, disc, hierarchy, scaling)
        backend = make_backend(scene.solver, disc, hierarchy)
        stepper = build_stepper(scene, plan, backend, hierarchy, world.motions)
        return cls(scene, world, disc, hierarchy, plan, backend, stepper, scaling)

    @property
    def frame_duration(self) -> float:
        """Seconds from frame to frame."""
        return 1.0 / self.scene.frames_per_second

    @cached_property
    def fingerprint(self) -> str:
        """Digest of all that a result depends on; a checkpoint fits only a simulation with the same one.

        The number of frames, the output, names, paths and the threads do not count: a run may go on with others, and
        of a mesh its content counts.
        """
        from femgal import __version__

        left_out: Any = {"name": True, "description": True, "frames": True, "output": True, "solver": {"threads"}}
        settings = self.scene.model_dump(mode="json", exclude=left_out | {"bodies": {"__all__": {"mesh"}}})
        text = f"{__version__} {MEMORY_FORMAT} {self.world.mesh.content_hash} {sorted(settings.items())}"
        return hashlib.sha256(text.encode()).hexdigest()

    def static_fields(self) -> tuple[dict[str, NDArray], dict[str, NDArray]]:
        """Output fields that never change: (per vertex, per tetrahedron)."""
        world = self.world
        cell: dict[str, NDArray] = {"region": world.mesh.regions, "body": world.body}
        if "material" in self.plan.fields:
            moduli = np.stack([world.E, world.nu, world.rho], axis=1)
            cell["material"] = np.unique(moduli, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int32)
        point: dict[str, NDArray] = {}
        for number, layer in enumerate(self.hierarchy.layers if self.hierarchy else ()):
            point[f"cluster_{number}"] = layer.parent[:, 0]
        wanted = self.plan.fields
        return {k: v for k, v in point.items() if k in wanted}, {k: v for k, v in cell.items() if k in wanted}

    def start(self) -> MotionState:
        """State at time zero; what the method estimates before its first step is done once."""
        if self._start is None:
            state = self.stepper.init(self.world.x0, self.world.v0)
            self._start, _ = self.stepper.begin_frame(state, self.frame_duration)
        return self._start

    def compile(self, state: MotionState | None = None) -> None:
        """Take steps from a state, or from the start, and throw them away: no frame's time contains compilation.

        What has been done once is not done again.
        """
        if self._compiled:
            return
        self._compiled = True
        h = 1e-3 * self.frame_duration
        first = self.stepper.step(self.start() if state is None else self.on_device(state), h)
        kept = with_blocks_to_use(first.memory)
        if kept is not None:
            # Blocks are made in one step, compared in another and used in a third.
            self.stepper.step(first, h)
            self.stepper.step(replace(first, memory=kept), h)
        self._measure(0, first)

    def frames(
        self,
        resume: tuple[int, MotionState, Mapping[str, Any]] | None = None,
        on_substep: OnSubstep = lambda substep, substeps: True,
    ) -> Iterator[Frame]:
        """Frame 0 and all after it, or those after a checkpoint.

        Parameters
        ----------
        resume : (frame, state, guard) of a checkpoint: its frame is not yielded again.
        on_substep : Called after each substep; when it returns False, `Stopped` is raised.

        Raises
        ------
        SolverFailure
            The motion ran away; every frame yielded before is good.
        Stopped
            on_substep asked for it.
        """
        solved, self.solved = self.solved, []
        if resume is None and solved:
            resume = (solved[-1].index, solved[-1].state, solved[-1].guard)
            while solved:
                # Frames that have been handed on are let go, with what they hold of a device.
                yield solved.pop(0)
        if resume is None:
            state, first = self.start(), 1
            frame, energies = self._measure(0, state)
            self.guard.begin(energies)
            yield replace(frame, guard=self.guard.memory())
        else:
            index, state, guard = resume
            state, first = self.on_device(state), index + 1
            self.guard.restore(guard)
        for index in range(first, self.scene.frames + 1):
            frame, energies, state = self._advance(index, state, on_substep)
            self.guard.accept(energies)
            yield replace(frame, guard=self.guard.memory())

    def on_device(self, state: MotionState) -> MotionState:
        """A state of the host, as of a checkpoint, as the backend has it."""
        put = self.backend.to_device
        memory = {name: put(array) if array.ndim == 2 else array for name, array in state.memory.items()}
        return replace(state, x=put(state.x), v=put(state.v), memory=memory)

    def _advance(self, index: int, state: MotionState, on_substep: OnSubstep) -> tuple[Frame, Energies, MotionState]:
        began, self.backend.passes = time.perf_counter(), Passes()
        self.guard.allow_for_motion(state, self.frame_duration)
        ready, substeps = self.stepper.begin_frame(state, self.frame_duration)
        for retakes in range(MOST_RETAKES + 1):
            attempt = self._attempt(index, ready, substeps, on_substep)
            if attempt.wanted is None or retakes == MOST_RETAKES:
                break
            ready, substeps = self.stepper.begin_frame(state, self.frame_duration, attempt.wanted)
        if attempt.complaint:
            again = f" after {retakes} retakes, the last with {substeps} substeps" if retakes else ""
            raise self._failure(attempt.complaint + again, index, attempt.lost_at, attempt.state)
        frame, energies = self._measure(index, attempt.state, attempt.measured)
        by_kind = self.backend.passes.as_dict()
        frame.row.update(
            seconds=time.perf_counter() - began,
            substeps=substeps,
            retakes=retakes,
            unconverged=self._unconverged,
            passes=sum(by_kind.values()),
            passes_by_kind=by_kind,
        )
        return frame, energies, attempt.state

    def _attempt(self, index: int, state: MotionState, substeps: int, on_substep: OnSubstep) -> _Attempt:
        """Take a frame with a number of substeps, and judge it."""
        self._unconverged = 0
        after, done = self._substeps(state, substeps, on_substep)
        after, wanted = self.stepper.end_frame(after, self.frame_duration, substeps)
        # Adding h many times drifts; the frame's own time does not.
        after = replace(after, time=index * self.frame_duration)
        if done < substeps or not self.backend.is_finite(after.x):
            return _Attempt(after, wanted, "positions are not finite", lost_at=done)
        if wanted is not None:
            return _Attempt(after, wanted, "the steps are too long for a stable motion")
        measured = energies_of(self.backend, after, self.gravity)
        complaint = self.guard.complaint(measured[0])
        if complaint is None and self.plan.runs("energy check"):
            complaint = self._gain(measured[0])
        if complaint and self._may_take_again:
            wanted = math.ceil(1.5 * substeps)
        return _Attempt(after, wanted, complaint, measured)

    @property
    def _may_take_again(self) -> bool:
        """Whether more substeps are the method's own business: who gives them to Verlet wants no others."""
        settings = self.scene.solver
        return settings.name != "verlet" or settings.substeps is None

    def _gain(self, energies: Energies) -> str | None:
        """What is wrong when a method that should keep the energy or lose some has let it grow over the frame."""
        before = self.guard.last or self.guard.start
        assert before is not None
        gain = energies.total - before.total
        if gain <= MOST_GAIN * (before.kinetic + before.elastic + self.guard.least_scale):
            return None
        return f"the energy grew by {gain:.4g} J in one frame, which nothing has put in"

    def _substeps(self, state: MotionState, substeps: int, on_substep: OnSubstep) -> tuple[MotionState, int]:
        """The substeps of one frame, and how many were made before the positions ceased to be finite."""
        h = self.frame_duration / substeps
        for substep in range(1, substeps + 1):
            state = self.stepper.step(state, h)
            self._unconverged += state.converged is False
            if not self.backend.looks_finite(state.x):
                return state, substep
            if not on_substep(substep, substeps):
                raise Stopped
        return state, substeps

    def _measure(
        self, index: int, state: MotionState, measured: tuple[Energies, Floats, Floats] | None = None
    ) -> tuple[Frame, Energies]:
        energies, energy, J = measured or energies_of(self.backend, state, self.gravity)
        residual = self.stepper.residual(state) if index > 0 and self.plan.runs("residual") else None
        row = {
            "frame": index,
            "time": state.time,
            "seconds": 0.0,
            "substeps": 0,
            "retakes": 0,
            "unconverged": 0,
            "passes": 0.0,
            "passes_by_kind": Passes().as_dict(),
            "eps18": None if residual is None else eps18(residual, self.backend.norm(residual)),
            **energies.as_row(),
        }
        if isinstance(self.stepper, AccuracyControl):
            row["estimated_error"] = self.stepper.estimated_error(state)
        fetch, n = self.backend.fetch, self.disc.n_vertices
        x, v = fetch(state.x), fetch(state.v)
        begun: dict[str, Callable[[], Callable[[], NDArray]]] = {
            "displacement": lambda: x,
            "velocity": lambda: v,
            "residual": lambda: fetch(np.zeros((n, 3)) if residual is None else residual),
            "von_mises": lambda: fetch(self.backend.von_mises(state.x)),
            "J": lambda: fetch(J),
            "energy_density": lambda: fetch(energy),
        }
        finished: dict[str, Callable[[NDArray], NDArray]] = {
            "displacement": lambda x: x - self.disc.mesh.points,
            "residual": lambda r: np.linalg.norm(r, axis=1),
            "energy_density": lambda energy: energy / self.disc.V,
        }
        arriving = {name: begun[name]() for name in self.plan.fields if name in begun}

        def fields() -> dict[str, NDArray]:
            return {name: finished.get(name, lambda a: a)(values()) for name, values in arriving.items()}

        return Frame(index, row, lambda: replace(state, x=x(), v=v()), fields), energies

    def _failure(self, what: str, frame: int, substep: int | None, state: MotionState) -> SolverFailure:
        layer = None
        if self.hierarchy and state.corrections:
            sizes = np.asarray([float(size) for size in state.corrections])
            # Layers are corrected from coarse to fine: of several that are no numbers, the coarsest was the first.
            lost = np.flatnonzero(~np.isfinite(sizes))
            number = int(lost[-1] if len(lost) else np.argmax(sizes))
            layer = f"layer {number} ({self.hierarchy.layers[number].name})"
        last = self.guard.last or self.guard.start
        energies = {} if last is None else {k: v for k, v in last.as_row().items() if k.endswith("energy")}
        return SolverFailure(what, frame=frame, substep=substep, layer=layer, energies=energies, advice=self._advice())

    def _advice(self) -> str:
        settings = self.scene.solver
        if settings.name == "verlet":
            return "leave solver.substeps out, or lower solver.safety; or take --solver fas"
        advice = f"more substeps (--substeps {2 * (self.plan.substeps or 1)})"
        if settings.steps in ("exact", "backtracking"):
            return advice
        advice += ", or --set solver.steps=exact"
        return advice if settings.chebyshev is None else f"{advice}, or leave solver.chebyshev out"


def _build_hierarchy(disc: Discretisation, settings: SolverSettings) -> Hierarchy:
    if settings.transfer == "linear":
        return build_linear_hierarchy(disc, settings.layers)
    return build_constant_hierarchy(disc, settings.ratio, settings.layers)
