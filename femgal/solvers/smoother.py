# SPDX-License-Identifier: BSD-3-Clause
"""Matrix-free block-Jacobi smoothing of one layer, its step length, and what FAS and Jacobi have in common."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from femgal.hierarchy.layer import Layer
from femgal.kernels.backend import Backend
from femgal.kernels.deferred import Number, times
from femgal.solvers.blocks import KeptBlocks, forget
from femgal.solvers.line_search import LineSearch, backtrack, first_minimum
from femgal.solvers.solver import Budget, Outcome, SolverState
from femgal.solvers.spectrum import largest_block_jacobi_eigenvalue
from femgal.timestep.potential import IncrementalPotential
from femgal.timestep.state import MotionState

Floats = NDArray[np.float64]

# How far to go: by the spectrum at rest, by a search along each correction, or by (coarse layers, finest layer).
StepRule = Literal["spectral", "exact", "backtracking"] | tuple[float, float]

LINE_SEARCHES: dict[StepRule, LineSearch] = {"exact": first_minimum, "backtracking": backtrack}

# Lanczos' method ends a little below lambda (rows smoothers/largest-eigenvalue of the suite), and lambda grows as the
# body deforms: what is left below the bound of stability is for both.
STABLE_SHARE = 0.9

# A step length that stands for "as far as the line search says".
SEARCHED = math.nan

# The constants that Lu et al. 2025 use. A fixed w applies only the share w of the elastic force as h -> 0, so the
# motion does not converge; they are here to reproduce the paper.
LU2025_STEPS = (0.25, 0.5)


def smooth(
    potential: IncrementalPotential,
    layer: Layer,
    x: Floats,
    w: float,
    *,
    scalar: bool = False,
    blocks: Floats | None = None,
    search: LineSearch = first_minimum,
) -> Number:
    """x += P dx with dx_i = -w H_i^-1 g_i (Lu et al. 2025, Eq. 6), in place; returns max |dx| [m].

    With `scalar` only the diagonal of each block is used, with `blocks` those in place of the present ones. With
    w = SEARCHED the step goes as far along the correction as `search` says, so phi never grows.
    """
    backend, length = potential.backend, unit_or(w)
    if blocks is None:
        dx, slope = backend.correction(layer, x, potential.xhat, potential.inverse_h2, length, scalar=scalar)
    else:
        g = backend.nodal_gradient(layer, x, potential.xhat, potential.inverse_h2)
        dx = backend.solve(g, blocks, length, scalar=scalar)
        slope = backend.dot(g, dx) if math.isnan(w) else math.nan
    return apply_correction(potential, layer, x, w, dx, slope, search)


def unit_or(w: float) -> float:
    """The length of a correction before its line search: w, or 1 where that is SEARCHED."""
    return 1.0 if math.isnan(w) else w


def apply_correction(
    potential: IncrementalPotential, layer: Layer, x: Floats, w: float, dx: Floats, slope: Number, search: LineSearch
) -> Number:
    """x += P dx, or as far as `search` says where w is SEARCHED, in place. Returns max |dx| [m].

    slope : g . dx [J], where w is SEARCHED; else nobody looks at it.
    """
    backend = potential.backend
    if not math.isnan(w):
        backend.prolong(layer, dx, x)
        return backend.largest(dx)
    d = backend.zeros(len(x))
    backend.prolong(layer, dx, d)
    coefficients = potential.along(layer, x, d)
    # The same number as the one it replaces, but free of the rounding in a sum over elements.
    coefficients[0] = float(slope)
    t = search(coefficients)
    backend.add_scaled(x, t, d)
    return times(t, backend.largest(dx))


def step_lengths(
    rule: StepRule, potential: IncrementalPotential, layers: tuple[Layer, ...], *, scalar: bool = False
) -> Floats:
    """Step length w of each layer, finest first.

    Spectral: w_l = min(2 / (1 + lambda), 0.9 (1 - T) / lambda), lambda = lambda_max(D_l^-1 A_l) at the rest state.
    lambda -> 1 and so w -> 1 as h -> 0, which makes one pass per step consistent with the equation of motion. The
    first bound smooths best. The second keeps the motion stable: on the stiffest modes one sweep ends at
    x = (1 - w lambda) xhat, and T is the least such response that the time stepping bears (-1/3 for backward Euler).
    """
    if rule in LINE_SEARCHES:
        return np.full(len(layers), SEARCHED)
    if not isinstance(rule, str):
        coarse, fine = rule
        return np.array([fine] + [coarse] * (len(layers) - 1))
    X = potential.backend.disc.mesh.points
    lambdas = np.array([largest_block_jacobi_eigenvalue(potential, layer, X, scalar=scalar) for layer in layers])
    return np.minimum(2.0 / (1.0 + lambdas), STABLE_SHARE * (1.0 - potential.least_response) / lambdas)


@dataclass(eq=False)
class Relaxation(ABC):
    """Solvers that smooth layers with fixed step lengths; a subclass says which layers, in which order.

    Parameters
    ----------
    backend : Element passes.
    layers : Layers, finest first.
    steps : "spectral", "exact", "backtracking", or (coarse, finest) step lengths.
    budget : When to stop.
    free_parts : Layer of the parts that no constraint holds, corrected last with a step of 1; None when there is none.
        Block Jacobi weights the vertices by their blocks, not by their masses, so on its own it moves the centre of
        mass of a free body.
    keep_blocks : Use blocks for several substeps where that changes next to nothing (`femgal.solvers.blocks`).
    """

    backend: Backend
    layers: tuple[Layer, ...]
    steps: StepRule = "spectral"
    budget: Budget = field(default_factory=Budget)
    free_parts: Layer | None = None
    keep_blocks: bool = False
    _w: Floats = field(default_factory=lambda: np.empty(0), init=False, repr=False)
    _kept: KeptBlocks | None = field(default=None, init=False, repr=False)
    _memory: dict[str, NDArray] = field(default_factory=dict, init=False, repr=False)

    scalar: ClassVar[bool] = False

    def prepare(self, state: MotionState, potential: IncrementalPotential) -> MotionState:
        """Estimate the step lengths for steps of this length, unless the state remembers them."""
        memory = state.memory
        if "step_lengths" not in memory or memory["step_lengths_for"][0] != potential.h:
            w = step_lengths(self.steps, potential, self.layers, scalar=self.scalar)
            memory = forget(memory) | {"step_lengths": w, "step_lengths_for": np.array([potential.h])}
        return replace(state, memory=memory)

    def init(self, potential: IncrementalPotential, memory: dict[str, NDArray]) -> SolverState:
        """Start from the prediction, or with a line search as far on the way to it as that says.

        Starting no higher than phi(x_n) and never climbing bounds the energy of the next state by that of the last
        one, for any step length: phi(x_{n+1}) <= phi(x_n) is the energy inequality of backward Euler.
        """
        self._w, self._memory = memory["step_lengths"], memory
        self._kept = KeptBlocks.remembered(memory, self.search is None) if self.keep_blocks else None
        if self.search is None or potential.x_n is None:
            return SolverState(self.backend.copy(potential.xhat))
        x, d = self.backend.copy(potential.x_n), self.backend.difference(potential.xhat, potential.x_n)
        self.backend.add_scaled(x, self.search(potential.along(self.backend.vertices, x, d)), d)
        return SolverState(x)

    @property
    def search(self) -> LineSearch | None:
        """The search along each correction; None when step lengths are given beforehand."""
        return LINE_SEARCHES.get(self.steps)

    def smooth_layer(self, potential: IncrementalPotential, x: Floats, number: int) -> Number:
        """Smooth one layer once, in place; returns the largest correction [m]."""
        layer, w, kept, search = self.layers[number], float(self._w[number]), self._kept, self.search or first_minimum
        blocks = None if kept is None else kept.get(number)
        if kept is None or blocks is not None or not kept.holds:
            return smooth(potential, layer, x, w, scalar=self.scalar, blocks=blocks, search=search)
        backend = potential.backend
        g, H = backend.gradient_and_blocks(layer, x, potential.xhat, potential.inverse_h2)
        kept.put(backend, number, g, H, scalar=self.scalar)
        dx = backend.solve(g, H, unit_or(w), scalar=self.scalar)
        slope = backend.dot(g, dx) if math.isnan(w) else math.nan
        return apply_correction(potential, layer, x, w, dx, slope, search)

    def conclude(self, potential: IncrementalPotential, state: SolverState) -> SolverState:
        """Decide for how long blocks are kept."""
        kept, backend = self._kept, potential.backend
        if kept is None:
            return state
        if kept.compares:
            g = backend.nodal_gradient(self.layers[0], state.x, potential.xhat, potential.inverse_h2)
            kept.judge(-backend.dot(g, backend.solve(g, kept.fresh(0), 1.0, scalar=self.scalar)))
        kept.finish()
        return replace(state, memory=kept.into(self._memory))

    @abstractmethod
    def step(self, potential: IncrementalPotential, state: SolverState) -> SolverState:
        """One iteration."""

    def restore_momentum(self, potential: IncrementalPotential, x: Floats) -> None:
        """Put the centre of mass of every free part where its momentum takes it, in place."""
        if self.free_parts is not None:
            smooth(potential, self.free_parts, x, 1.0)

    def finished(self, potential: IncrementalPotential, state: SolverState) -> Outcome | None:
        """The reason to stop, or None to go on."""
        return self.budget.outcome(potential, state)
