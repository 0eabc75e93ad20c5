# SPDX-License-Identifier: BSD-3-Clause
"""The plan: which stages a scene needs, how much each costs, and what is skipped because nothing in it needs that.

`femgal plan SCENE` prints it. Time stepping and frames are put together from the stages that run; the passes of a stage
are those that the run log counts.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Literal

import numpy as np

from femgal.diagnostics import SAMPLES
from femgal.discretisation import Discretisation
from femgal.hierarchy.hierarchy import FEWEST_NODES, Hierarchy
from femgal.output.fields import FIELDS, find_field
from femgal.scene.build import World
from femgal.scene.model import Scene, SolverSettings
from femgal.scene.problems import Problem, SceneError
from femgal.scene.solver import RELAXATIONS
from femgal.solvers.chebyshev import largest_stable_radius
from femgal.solvers.cycle import Cycle, shown
from femgal.solvers.smoother import LINE_SEARCHES
from femgal.timestep.mass_scaling import MassScaling
from femgal.timestep.velocity_verlet import FOLLOW_ITERATIONS
from meshes.connectivity import component_labels

# Substeps per frame where the scene leaves them open. With exact steps these cost what 100 substeps of Lu et al. 2025
# cost with given ones. Newton's method solves its steps whatever their length; the last is for a controlled error.
DEFAULT_SUBSTEPS = 50
NEWTON_SUBSTEPS = 8
CONTROLLED_SUBSTEPS = 2

# Newton's method takes as many iterations as it needs; for its cost in a plan, what soft bodies usually take.
USUAL_ITERATIONS = 5

# Preconditioners that are made of the layers of a hierarchy.
LAYERED = ("layers", "cycle")

When = Literal["start", "substep", "frame"]


@dataclass(frozen=True)
class Stage:
    """One stage of a run.

    Parameters
    ----------
    name : Unique within a plan.
    when : "start", each "substep", or each "frame".
    runs : False when the scene has no use for it.
    note : What it does, or why it is skipped.
    unknowns : Nodes whose positions it solves for.
    elements : Tetrahedra that it visits.
    passes : Element passes over the finest mesh that one call costs.
    """

    name: str
    when: When
    runs: bool
    note: str = ""
    unknowns: int = 0
    elements: int = 0
    passes: float = 0.0


@dataclass(frozen=True)
class Plan:
    """Stages in the order in which they run, the skipped ones among them.

    A substep consists of `solves` solves, and each makes the passes of all stages of a substep.
    """

    stages: tuple[Stage, ...]
    substeps: int | None
    iterations: int
    fields: tuple[str, ...]
    solves: int = 1

    def runs(self, name: str) -> bool:
        """Whether the stage of this name runs."""
        return any(stage.runs for stage in self.stages if stage.name == name)

    @property
    def passes_per_substep(self) -> float:
        """Element passes over the finest mesh in one substep, at most."""
        return self.solves * self._passes("substep")

    @property
    def passes_per_frame(self) -> float:
        """Element passes over the finest mesh in one frame beside its substeps."""
        return self._passes("frame")

    def _passes(self, when: When) -> float:
        return sum(stage.passes for stage in self.stages if stage.when == when and stage.runs)

    def rows(self) -> list[tuple[str, ...]]:
        """One row per stage: when, name, runs or skipped, unknowns, elements, passes, note."""
        return [
            (
                stage.when,
                stage.name,
                "runs" if stage.runs else "skipped",
                f"{stage.unknowns}" if stage.unknowns else "",
                f"{stage.elements}" if stage.elements else "",
                f"{stage.passes:.3f}" if stage.passes else "",
                stage.note,
            )
            for stage in self.stages
        ]


def needs_hierarchy(settings: SolverSettings) -> bool:
    """Whether a solver has coarse layers."""
    return settings.name == "fas" or (settings.name == "newton-multigrid" and settings.preconditioner in LAYERED)


def make_plan(
    scene: Scene, world: World, disc: Discretisation, hierarchy: Hierarchy | None, scaling: MassScaling | None = None
) -> Plan:
    """Decide what a scene needs.

    Raises
    ------
    SceneError
        An output field that this scene cannot have.
    """
    settings = scene.solver
    explicit = settings.name == "verlet"
    substeps = settings.substeps if settings.substeps or explicit else _default_substeps(settings)
    _check_fields(scene, hierarchy, explicit)
    stages = (
        *_start_stages(scene, disc, hierarchy, scaling),
        *_motion_stages(scene, world, disc),
        *_controlled(scene, _solver_stages(scene, disc, hierarchy)),
        *_frame_stages(scene, disc, explicit, any(not motion.is_fixed for motion in world.motions)),
    )
    solves = 1 if explicit else STAGES[settings.stepping]
    return Plan(stages, substeps, settings.iterations, tuple(scene.output.fields), solves)


def _default_substeps(settings: SolverSettings) -> int:
    if settings.name != "newton-multigrid":
        return DEFAULT_SUBSTEPS
    return NEWTON_SUBSTEPS if settings.accuracy is None else CONTROLLED_SUBSTEPS


def _controlled(scene: Scene, stages: list[Stage]) -> list[Stage]:
    """The stages of a substep, and what it takes to know the error that it leaves."""
    accuracy = scene.solver.accuracy
    note = "no accuracy asked for" if accuracy is None else f"below {100.0 * accuracy:g}% of the motion, by substeps"
    control = Stage("error control", "frame", accuracy is not None, note)
    return [*stages, control]


def _check_fields(scene: Scene, hierarchy: Hierarchy | None, explicit: bool) -> None:
    n_coarse = len(hierarchy.layers) - 1 if hierarchy else 0
    impossible = {f"cluster_{k}" for k in range(1000)} - {f"cluster_{k}" for k in range(1, n_coarse + 1)}
    if explicit:
        impossible.add("residual")
    for name in scene.output.fields:
        if name in impossible:
            possible = [*FIELDS, *(f"cluster_{k}" for k in range(1, n_coarse + 1))]
            if explicit:
                possible.remove("residual")
            why = (
                f"the solver has {n_coarse} coarse layers on this mesh"
                if name.startswith("cluster")
                else "an explicit method has no residual"
            )
            problem = Problem("output.fields", why, repr(name), ", ".join(possible), "leave the field out")
            raise SceneError([problem], source=scene.name)


def _start_stages(
    scene: Scene, disc: Discretisation, hierarchy: Hierarchy | None, scaling: MassScaling | None
) -> list[Stage]:
    name = scene.solver.name
    n_free = int(disc.free.sum())
    stages = [Stage("discretisation", "start", True, f"{disc.n_vertices} vertices", n_free, disc.n_tets)]
    stages.append(Stage("mass scaling", "start", scaling is not None, str(scaling or "not asked for")))
    if hierarchy is None:
        stages.append(Stage("hierarchy", "start", False, f"{name} works on the finest mesh only"))
    else:
        stages.append(Stage("hierarchy", "start", True, _summary(hierarchy)))
    if name == "verlet":
        given = scene.solver.substeps is not None
        note = "substeps given" if given else "largest frequency by power iteration, followed every frame"
        stages.append(Stage("first stable step", "start", not given, note))
    elif name in RELAXATIONS or name == "jacobi-explicit":
        spectral = scene.solver.steps == "spectral"
        note = "smoothing and stability bounds of each layer, by power iteration" if spectral else "not asked for"
        stages.append(Stage("spectral step lengths", "start", spectral, note))
    return stages


def _summary(hierarchy: Hierarchy) -> str:
    return f"{hierarchy.transfer} transfer, ratio {hierarchy.ratio}, {len(hierarchy.layers)} layers"


def _motion_stages(scene: Scene, world: World, disc: Discretisation) -> list[Stage]:
    fixed = sum(len(motion.vertices) for motion in world.motions if motion.is_fixed)
    moving = sum(len(motion.vertices) for motion in world.motions if not motion.is_fixed)
    return [
        Stage("prediction", "substep", True, _formula(scene.solver), int(disc.free.sum())),
        Stage("damping", "substep", scene.damping > 0.0, f"alpha = {scene.damping:g} 1/s"),
        Stage("fixed vertices", "substep", fixed > 0, f"{fixed} vertices"),
        Stage("moving vertices", "substep", moving > 0, f"{moving} vertices"),
    ]


# Solves per substep.
STAGES = {"backward-euler": 1, "bdf2": 1, "tr-bdf2": 2}

_FORMULAS = {
    "backward-euler": "xhat = x + h v + h^2 g",
    "bdf2": "BDF2: xhat = y + h_e w + h_e^2 g, h_e = 2h/3, y and w from the last two states",
    "tr-bdf2": "TR-BDF2, twice per substep: xhat = y + h_e w + h_e^2 g, h_e = 0.293 h",
}


def _formula(settings: SolverSettings) -> str:
    return _FORMULAS["backward-euler" if settings.name == "verlet" else settings.stepping]


def _solver_stages(scene: Scene, disc: Discretisation, hierarchy: Hierarchy | None) -> list[Stage]:
    n_free, iterations = int(disc.free.sum()), scene.solver.iterations
    if scene.solver.name == "verlet":
        return [Stage("acceleration", "substep", True, "gradient", n_free, disc.n_tets, 1.0)]
    if scene.solver.name == "newton-multigrid":
        return [*_newton_stages(scene, disc, hierarchy, n_free), _momentum(disc)]
    if hierarchy is None:
        stages = [_single_layer(scene.solver, n_free, disc.n_tets)]
        searched, finest = float(disc.n_tets), float(disc.n_tets)
    else:
        cycle = Cycle(scene.solver.cycle, scene.solver.pre, scene.solver.post)
        sequence = cycle.schedule(len(hierarchy.layers))
        stages = _layer_stages(scene, disc, hierarchy, sequence)
        stages.insert(0, Stage("cycle", "substep", True, f"{cycle}, layers {shown(sequence)}"))
        searched = float(sum(len(hierarchy.layers[number].active) for number in sequence))
        finest = float(len(hierarchy.layers[0].active))
    stages.append(_line_search(scene, searched / disc.n_tets))
    stages.append(_chebyshev(scene, finest / disc.n_tets))
    stages.append(_kept_blocks(scene))
    stages.append(_momentum(disc))
    test = scene.solver.tolerance is not None
    note = f"eps18 <= {scene.solver.tolerance:g} m, at most" if test else "no tolerance"
    return [*stages, Stage("stopping test", "substep", test, note, passes=float(iterations + 1) if test else 0.0)]


def _single_layer(settings: SolverSettings, n_free: int, n_tets: int) -> Stage:
    """Sweeps over the finest mesh; those on a matrix make no element pass but the gradient of each system."""
    if not settings.name.endswith("-explicit"):
        return Stage("layer 0", "substep", True, settings.name, n_free, n_tets, float(settings.iterations))
    systems = -(-settings.iterations // settings.sweeps)
    note = f"{settings.name}, {systems} assembled matrices of {settings.sweeps} sweeps at most"
    return Stage("layer 0", "substep", True, note, n_free, n_tets, float(systems))


def _newton_stages(scene: Scene, disc: Discretisation, hierarchy: Hierarchy | None, n_free: int) -> list[Stage]:
    """One Newton iteration with as many products as usual; the counts of a run are in its log."""
    settings, m = scene.solver, disc.n_tets
    made = hierarchy.complexity if hierarchy else 1.0
    visited = 2 * made - 2 if settings.preconditioner == "cycle" else 0.0
    products = f"of conjugate gradients, some {USUAL_ITERATIONS} to a reduction of {settings.reduction:g}"
    each = "made anew where it has aged, counted once a frame"
    return [
        Stage("gradient", "substep", True, "once per Newton iteration", n_free, m, 1.0),
        Stage("preconditioner", "frame", True, f"{settings.preconditioner}, {each}", n_free, m, made),
        Stage("Hessian products", "substep", True, products, n_free, m, USUAL_ITERATIONS * (1.0 + visited)),
        Stage("line search", "substep", True, "to the first minimum along each direction", n_free, m, 2.0),
    ]


def _momentum(disc: Discretisation) -> Stage:
    held = not _has_free_parts(disc)
    note = "every part is held by a constraint" if held else "centre of mass of parts that no constraint holds"
    return Stage("momentum of free parts", "substep", not held, note)


def _searches(scene: Scene) -> bool:
    return scene.solver.name in RELAXATIONS and scene.solver.steps in LINE_SEARCHES


def _line_search(scene: Scene, passes: float) -> Stage:
    """One line from the last state to the prediction, then one along the correction of each smoothing."""
    if not _searches(scene):
        return Stage("line search", "substep", False, "no correction is searched along")
    how = "to its first minimum" if scene.solver.steps == "exact" else "1, 1/2, 1/4, ... of it until that falls"
    note = f"energy along each correction, {how}"
    return Stage("line search", "substep", True, note, passes=1.0 + scene.solver.iterations * passes)


def _chebyshev(scene: Scene, passes: float) -> Stage:
    """One line beyond each iterate after the first, where the minimum along it says how far."""
    rho, iterations = scene.solver.chebyshev, scene.solver.iterations
    if rho is None:
        return Stage("Chebyshev", "substep", False, "no extrapolation of the iterates")
    if rho == "auto" or _searches(scene):
        note = "extrapolated as far as the energy falls" + ("" if rho == "auto" else f", at most as for rho = {rho:g}")
        return Stage("Chebyshev", "substep", True, note, passes=(iterations - 1) * passes)
    bound = largest_stable_radius(iterations)
    risk = f": above {bound:.3f} so few iterations may let stiff motions grow" if rho > bound else ""
    return Stage("Chebyshev", "substep", True, f"rho = {rho:g}{risk}")


def _kept_blocks(scene: Scene) -> Stage:
    keeps = scene.solver.blocks == "auto" and scene.solver.name in RELAXATIONS
    note = "at most; gradients alone while old blocks change next to nothing" if keeps else "made at every smoothing"
    # A refresh is followed by one gradient that judges it; where blocks are kept at all, for two substeps or more.
    return Stage("kept blocks", "substep", keeps, note, passes=0.5 if keeps else 0.0)


def _has_free_parts(disc: Discretisation) -> bool:
    part = component_labels(disc.mesh.cells)
    return bool(np.setdiff1d(part, part[~disc.free]).size)


def _layer_stages(scene: Scene, disc: Discretisation, hierarchy: Hierarchy, sequence: tuple[int, ...]) -> list[Stage]:
    """Layers from coarse to fine, with the elements that each leaves out."""
    times = Counter(sequence)
    n_free, iterations = int(disc.free.sum()), scene.solver.iterations
    stages = [_unneeded_layer(scene, n_free, hierarchy)]
    finest = max(1, hierarchy.layers[0].n_pairs)
    for number, layer in reversed(list(enumerate(hierarchy.layers))):
        passes = iterations * times[number] * layer.n_pairs / finest
        stages.append(Stage(f"layer {number}", "substep", True, layer.name, layer.n_nodes, len(layer.active), passes))
        if number > 0:
            interior = disc.n_tets - len(layer.active)
            where = "inside one cluster" if hierarchy.transfer == "constant" else "without a free vertex"
            note = f"{interior} elements {where} contribute exactly zero"
            stages.append(Stage(f"interior of layer {number}", "substep", False, note, 0, interior))
    return stages


def _unneeded_layer(scene: Scene, n_free: int, hierarchy: Hierarchy) -> Stage:
    """The first coarse layer that the hierarchy does not have."""
    number = len(hierarchy.layers)
    constant = hierarchy.transfer == "constant"
    what = f"clusters of {hierarchy.ratio**number}" if constant else "lattice twice as wide"
    asked = scene.solver.layers != "full" and number > scene.solver.layers
    few = f"{n_free} free vertices make fewer than {FEWEST_NODES} of them, or few more than of the finer layer"
    why = "not asked for" if asked else few
    return Stage(f"layer {number}", "substep", False, f"{what}: {why}")


def _softens(scene: Scene) -> bool:
    """Whether fixed step lengths below 1 apply a share of the elastic force only, as h -> 0.

    The body then moves as a softer one and may come to have more energy than it began with, weight included; more
    substeps do not help. Steps of 1 or more are another matter: they overshoot, and shorter substeps cure that.
    """
    steps = scene.solver.steps
    return steps == "lu2025" or (not isinstance(steps, str) and max(steps) < 1.0)


def _frame_stages(scene: Scene, disc: Discretisation, explicit: bool, moving: bool) -> list[Stage]:
    output = scene.output
    follow = explicit and scene.solver.substeps is None
    softens = not explicit and _softens(scene)
    # Newton's steps are solved: what energy they gain is the formula's oscillation, which more substeps need not cure.
    solved = scene.solver.name == "newton-multigrid"
    check = (follow or not explicit) and not (moving or softens or solved)
    unchecked = "step lengths below 1 soften the body" if softens else "driven, or substeps given"
    unchecked = "every step is solved" if solved else unchecked
    residual_note = "an explicit method has no residual" if explicit else "eps18 and its field"
    stages = [
        Stage(
            "work of moving vertices", "frame", moving, "bound for the energy", passes=1.0 + SAMPLES if moving else 0.0
        ),
        Stage(
            "stable step",
            "frame",
            follow,
            "followed as the body deforms" if follow else "no stability limit to follow",
            passes=1.0 + FOLLOW_ITERATIONS if follow else 0.0,
        ),
        Stage(
            "energy check",
            "frame",
            check,
            "a frame whose energy grows is taken again" if check else unchecked,
        ),
        Stage("energies", "frame", True, "energies and smallest J", 0, disc.n_tets, 1.0),
        Stage("residual", "frame", not explicit, residual_note, 0, disc.n_tets, 0.0 if explicit else 1.0),
    ]
    for name in [*(name for name in FIELDS if name != "residual"), "cluster_<layer>"]:
        wanted = [f for f in output.fields if f == name or (name == "cluster_<layer>" and f.startswith("cluster_"))]
        entry = find_field(name)
        note = (entry.description if entry else ", ".join(wanted)) if wanted else "not among the output fields"
        stages.append(Stage(f"field {name}", "frame", bool(wanted), note))
    stages.append(Stage("write", "frame", True, f"{output.format}, every {output.every} frame(s)"))
    stages.append(Stage("checkpoint", "frame", True, f"every {output.checkpoint_every} frame(s)"))
    return stages
