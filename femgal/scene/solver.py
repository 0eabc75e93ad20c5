# SPDX-License-Identifier: BSD-3-Clause
"""The solver table of a scene file."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from femgal.hierarchy import LINEAR_RATIO
from femgal.scene.accuracy import check_accuracy, with_accuracy_defaults
from femgal.scene.quantities import (
    Accuracy,
    Count,
    Index,
    Layers,
    Number,
    SpectralRadius,
    StepLengths,
    Unit,
)
from femgal.scene.shapes import Table
from femgal.solvers.cycle import CycleKind

# Values of the solver table that a solver has where they are left out, other than those of `SolverSettings`.
DEFAULTS: dict[str, dict[str, Any]] = {
    "newton-multigrid": {"stepping": "tr-bdf2", "iterations": 20},
    "jacobi-explicit": {"steps": "spectral"},
}

# Solvers that smooth layers and may search along every correction, or keep their blocks.
RELAXATIONS = ("fas", "jacobi", "scalar-jacobi")


class SolverSettings(Table):
    """How the scene is solved.

    Attributes
    ----------
    name : ``fas`` (Galerkin multigrid), ``newton-multigrid`` (Newton's method with conjugate gradients: accurate and
        robust), ``verlet`` (explicit), ``auto`` (``verlet`` or ``newton-multigrid``, whichever keeps `accuracy` at the
        lower cost), and for comparison ``vbd`` (vertex block descent: coloured Gauss-Seidel), ``jacobi`` (3x3 block
        Jacobi), ``scalar-jacobi``, and both on an assembled matrix, ``vbd-explicit`` and ``jacobi-explicit``.
    accuracy : Relative error of the motion asked for, 0.01 or "1%"; with ``auto`` (1% when left out), ``verlet``
        or ``newton-multigrid``; without a name it means ``auto``. Substeps then follow from estimates of the error,
        which are reported: root mean square over vertices (by mass) and frames of the distance from the exact motion of
        this mesh, over that of the motion. Not for chaotic motions: from a random start any two runs part.
    stepping : How time is stepped: ``backward-euler`` (first order; loses energy, never gains any), ``bdf2`` (second
        order) or ``tr-bdf2`` (second order with two solves per step: of a given cost a third to a half of the error of
        ``bdf2``; the default of ``newton-multigrid``). Not for ``verlet``.
    substeps : Time steps per frame; the solver's default when left out (``verlet``: from its stable step). With
        `accuracy` a run of ``newton-multigrid`` begins with so many, and the others choose theirs.
    iterations : Cycles or sweeps per substep; of ``newton-multigrid`` at most so many Newton iterations, 20 when left
        out.
    reduction : ``newton-multigrid`` solves each step until its residual has fallen to this share.
    linear_iterations : ``newton-multigrid`` makes at most so many iterations of conjugate gradients per Newton
        iteration.
    preconditioner : Of these conjugate gradients: ``v-cycle`` (Galerkin multigrid on lattices with assembled matrices:
        few iterations, however stiff or large the body), ``layers`` (the 3x3 blocks of all layers, added up),
        ``cycle`` (the layers one after the other, down and up), ``mas`` (multilevel additive Schwarz, Wu et al. 2022)
        or ``blocks`` (of the vertices alone: block Jacobi).
    tolerance : Stop iterating below this residual eps18 [m] (Lu et al. 2025, Eq. 18); off when left out.
    relaxation : ``vbd`` and ``vbd-explicit`` move a vertex by so many times its own correction.
    sweeps : ``vbd-explicit`` and ``jacobi-explicit`` sweep so often over a matrix before they assemble a new one.
    transfer : ``constant`` (coarse nodes are clusters of vertices) or ``linear`` (corners of coarse tetrahedra, whose
        motion is interpolated). A linear cycle costs about twice as much; for stiff bodies and long steps it leaves a
        tenth of the error, for soft ones and short steps it gains nothing.
    ratio : Vertices per coarse node from one layer to the next, 32 when left out; ``linear`` has 8, as each lattice is
        twice as wide.
    layers : Number of coarse layers, or ``full`` for as many as the mesh gives.
    cycle : Order in which an iteration smooths the layers: ``coarse-to-fine`` (once each), ``V``, ``F`` or ``W``.
    pre, post : Smoothings of a layer before and after the coarser ones are visited; 0 and 1 with ``coarse-to-fine``, 1
        and 1 with the others when left out. The coarsest layer, where down and up meet, has max(pre, post).
    steps : Step lengths: ``exact`` (to the minimum along each correction: the energy never grows, however stiff the
        body or long the step), ``backtracking`` (1, 1/2, 1/4, ... of each correction until the energy falls: never
        grows either, at the cost of ``exact``, but stiff bodies tremble), ``spectral`` (from power iteration at rest:
        half the cost of a substep, for soft bodies and short steps), ``lu2025`` (0.25 coarse, 0.5 fine), or
        [coarse, fine].
    chebyshev : Extrapolate from iteration to iteration (Wang 2015): with ``auto`` to the minimum of the energy on the
        way, or with the weights of this spectral radius of one iteration, 0 < rho < 1, which exact steps and
        backtracking take as bounds. For stiff bodies, long steps and many iterations; off when left out.
    safety : ``verlet`` steps by this fraction of its stable step.
    mass_scaling : Largest share of its mass that a body may gain for ``verlet`` to take longer steps; the mass goes to
        the vertices of the elements that dictate the step, is heavy as well as inert, and is reported. Off when left
        out; 0.01 often doubles the step.
    blocks : ``auto`` keeps the 3x3 diagonal blocks for several substeps while that changes less than a tenth of what
        the solver leaves undone (measured; soft bodies gain most), ``fresh`` makes them at every smoothing.
    device : ``cpu``, or ``cuda`` for a GPU of NVIDIA (``femgal doctor`` tells whether there is one to use).
    precision : Arithmetic of the element passes, ``float64`` or ``float32``; positions, velocities and all sums stay in
        double precision. Single precision takes some two thirds of the time, and its rounding stays far below the
        error of the default steps (reports/published).
    threads : CPU threads; all when left out.
    """

    name: Literal[
        "fas", "newton-multigrid", "verlet", "auto", "vbd", "vbd-explicit", "jacobi", "jacobi-explicit", "scalar-jacobi"
    ] = "fas"
    accuracy: Accuracy | None = None
    stepping: Literal["backward-euler", "bdf2", "tr-bdf2"] = "backward-euler"
    substeps: Annotated[Count, Field(le=10_000_000)] | None = None
    iterations: Count = 1
    reduction: Annotated[Number, Field(gt=0, lt=1)] = 0.05
    linear_iterations: Count = 500
    preconditioner: Literal["v-cycle", "layers", "cycle", "mas", "blocks"] = "v-cycle"
    relaxation: Annotated[Number, Field(gt=0, lt=2)] = 1.0
    sweeps: Count = 20
    tolerance: Annotated[Number, Field(gt=0), Unit("m")] | None = None
    transfer: Literal["constant", "linear"] = "constant"
    ratio: Annotated[Count, Field(ge=2)] = 32
    layers: Layers = "full"
    cycle: CycleKind = "coarse-to-fine"
    pre: Index = 0
    post: Index = 1
    steps: StepLengths = "exact"
    chebyshev: SpectralRadius | None = None
    safety: Annotated[Number, Field(gt=0, le=1)] = 0.9
    mass_scaling: Annotated[Number, Field(gt=0, le=1)] | None = None
    blocks: Literal["auto", "fresh"] = "auto"
    device: Literal["cpu", "cuda"] = "cpu"
    precision: Literal["float32", "float64"] = "float64"
    threads: Count | None = None

    @model_validator(mode="before")
    @classmethod
    def _defaults_by_name(cls, data: Any) -> Any:
        """Fill in what a solver does unless asked for something else."""
        data = with_accuracy_defaults(data)
        if isinstance(data, dict) and isinstance(data.get("name"), str):
            return DEFAULTS.get(data["name"], {}) | data
        return data

    @model_validator(mode="after")
    def _accuracy_can_be_controlled(self) -> Self:
        check_accuracy(self)
        return self

    @model_validator(mode="before")
    @classmethod
    def _ratio_of_linear(cls, data: Any) -> Any:
        """Fill in the one ratio that the linear transfer has: a scene with all defaults written out is valid too."""
        if isinstance(data, dict) and data.get("transfer") == "linear":
            return {"ratio": LINEAR_RATIO} | data
        return data

    @model_validator(mode="after")
    def _linear_has_one_ratio(self) -> Self:
        if self.transfer == "linear" and self.ratio != LINEAR_RATIO:
            context = {
                "key": "solver.ratio",
                "found": str(self.ratio),
                "allowed": f'{LINEAR_RATIO} with transfer = "linear"',
                "advice": f"leave ratio out, or set it to {LINEAR_RATIO}",
            }
            raise PydanticCustomError("ratio", "each lattice is twice as wide as the one before", context)
        return self

    @model_validator(mode="before")
    @classmethod
    def _cycles_that_go_down_smooth_there(cls, data: Any) -> Any:
        """Fill in pre = 1 for the cycles that go down first."""
        if isinstance(data, dict) and data.get("cycle", "coarse-to-fine") != "coarse-to-fine":
            return {"pre": 1} | data
        return data

    @model_validator(mode="after")
    def _matrices_are_not_searched(self) -> Self:
        if self.name == "jacobi-explicit" and self.steps in ("exact", "backtracking"):
            context = {
                "key": "solver.steps",
                "found": str(self.steps),
                "allowed": '"spectral", "lu2025" or two numbers with name = "jacobi-explicit"',
                "advice": "leave steps out",
            }
            raise PydanticCustomError("steps", "a linear system is not searched along its corrections", context)
        return self

    @model_validator(mode="after")
    def _stages_are_solved(self) -> Self:
        if self.stepping != "tr-bdf2" or self.name in ("newton-multigrid", "verlet"):
            return self
        context = {
            "key": "solver.stepping",
            "found": "tr-bdf2",
            "allowed": 'backward-euler, bdf2 with name = "' + self.name + '"',
            "advice": 'set name = "newton-multigrid", or stepping = "bdf2"',
        }
        raise PydanticCustomError("stepping", "sweeps and cycles do not solve a step well enough for it", context)

    @model_validator(mode="after")
    def _cycle_smooths(self) -> Self:
        if self.cycle == "coarse-to-fine" and self.pre > 0:
            context = {
                "key": "solver.pre",
                "found": str(self.pre),
                "allowed": '0 with cycle = "coarse-to-fine"',
                "advice": 'set cycle = "V", or leave pre out and raise post',
            }
            raise PydanticCustomError("pre", "this cycle does not go down", context)
        if self.pre + self.post == 0:
            context = {"key": "solver.post", "found": "0", "allowed": "at least 1 where pre = 0"}
            raise PydanticCustomError("post", "smooths nothing", context)
        return self

    @model_validator(mode="after")
    def _chebyshev_extrapolates_iterations(self) -> Self:
        extrapolates = self.name not in ("verlet", "newton-multigrid")
        if self.chebyshev is None or (extrapolates and self.iterations > 1):
            return self
        context = {
            "key": "solver.chebyshev",
            "found": str(self.chebyshev),
            "allowed": "with solvers that iterate, and iterations >= 2",
            "advice": "raise iterations (and lower substeps), or leave it out" if extrapolates else "leave it out",
        }
        does_not = "iterate" if self.name == "verlet" else "smooth"
        why = "one iteration has none before it" if extrapolates else f"{self.name} does not {does_not}"
        raise PydanticCustomError("chebyshev", "there is nothing to extrapolate: {why}", {**context, "why": why})

    @model_validator(mode="after")
    def _mass_is_scaled_for_a_step(self) -> Self:
        if self.mass_scaling is None or (self.name == "verlet" and self.substeps is None):
            return self
        context = {
            "key": "solver.mass_scaling",
            "found": f'name = "{self.name}"' if self.name != "verlet" else f"substeps = {self.substeps}",
            "allowed": 'name = "verlet", substeps left out',
            "advice": "leave mass_scaling out" if self.name != "verlet" else "leave substeps or mass_scaling out",
        }
        raise PydanticCustomError("mass_scaling", "the solver chooses no step that it could lengthen", context)
