# SPDX-License-Identifier: BSD-3-Clause
"""The stable step of explicit integration, who dictates it, and what would lengthen it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.kernels.cpu.backend import CpuBackend
from femgal.kernels.cpu.threads import Workers
from femgal.solvers.spectrum import largest_frequency_squared, random_start
from femgal.timestep.bottleneck import FEW, find_bottleneck, worst_elements
from femgal.timestep.mass_scaling import share_for
from femgal.timestep.stable_step import element_stiffness, guaranteed_step, vertex_stiffness
from verify.diagnose.finding import Finding, Severity, percent
from verify.diagnose.target import Target

# Share of the stable step that velocity Verlet takes by default.
SAFETY = 0.9
# Substeps per frame that nobody minds.
CHEAP = 20
_SHOWN = 5


@dataclass(frozen=True)
class StableStep:
    """Stable steps [s] of explicit integration at rest.

    Parameters
    ----------
    step : 2 / omega_max, from power iteration; infinite where nothing can move.
    without : The same without the `few` worst elements.
    few : How many of them keep the step from being twice as long; 0 where that takes many.
    worst : The worst elements, worst first.
    share_twice, share_four : Share of its mass that a part has to gain for a step two and four times as long.
    """

    step: float
    without: float
    few: int
    worst: NDArray[np.int64]
    share_twice: float
    share_four: float


def stable_step(target: Target) -> StableStep:
    """Measure the stable step of the bodies at rest."""
    disc = target.disc
    stiffness = element_stiffness(disc, Workers(target.scene.solver.threads))
    k = vertex_stiffness(disc, stiffness)
    bound = guaranteed_step(k, disc.mass)
    if not math.isfinite(bound):
        return StableStep(math.inf, math.inf, 0, np.empty(0, np.int64), 0.0, 0.0)
    bottleneck = find_bottleneck(disc, stiffness, k)
    few = bottleneck.few if bottleneck else 0
    # Where many elements dictate the step, a few are left out all the same, to show that this helps little.
    removed = few or max(1, int(FEW * disc.n_tets))
    worst = worst_elements(disc, stiffness, k, removed)
    return StableStep(
        step=_two_over_omega(disc),
        without=_two_over_omega(_without(disc, worst)),
        few=few,
        worst=worst,
        share_twice=share_for(disc, k, 2.0 * bound),
        share_four=share_for(disc, k, 4.0 * bound),
    )


def explicit_step(target: Target, found: StableStep) -> Finding:
    """The stable step in seconds and substeps, and whether a few elements spoil it."""
    if not math.isfinite(found.step):
        return Finding("explicit step", Severity.OK, "Nothing can move: any step is stable.")
    frame = target.frame
    taken = substeps(frame, found.step)
    numbers = {
        "stable_step_s": found.step,
        "substeps_per_frame": taken,
        "stable_step_without_worst_s": found.without,
        "substeps_per_frame_without_worst": substeps(frame, found.without),
        "worst_left_out": len(found.worst),
        "few": found.few,
        "worst": target.numbers[found.worst[:_SHOWN]],
        "mass_share_for_twice_the_step": found.share_twice,
        "mass_share_for_four_times_the_step": found.share_four,
    }
    left_out = "worst element" if len(found.worst) == 1 else f"{len(found.worst):,} worst elements"
    what = (
        f"Stable explicit step at rest {found.step:.3g} s: {taken:,} substeps per frame of "
        f"1/{1.0 / frame:g} s (at {SAFETY:g} of it). Without the {left_out} "
        f"{found.without:.3g} s, {numbers['substeps_per_frame_without_worst']:,} substeps."
    )
    if not found.few:
        what += " So it is no matter of a few elements, but of the mesh as a whole and of the material."
        return Finding("explicit step", Severity.OK, what, numbers=numbers)
    what += " Worst first: " + ", ".join(map(str, target.numbers[found.worst[:_SHOWN]])) + "."
    advice = (
        f"Make these elements better; or add mass there: {percent(found.share_twice)} of a body's mass doubles the "
        f"step, {percent(found.share_four)} makes it four times as long "
        f"(solver.mass_scaling = {_rounded_up(found.share_twice):g})."
    )
    severity = Severity.WARNING if taken > CHEAP else Severity.NOTE
    return Finding("explicit step", severity, what, advice, numbers)


def substeps(frame: float, step: float) -> int:
    """Substeps per frame that velocity Verlet takes with a stable step."""
    return max(1, math.ceil(frame / (SAFETY * step)))


def _two_over_omega(disc: Discretisation) -> float:
    X = disc.mesh.points
    omega2, _ = largest_frequency_squared(CpuBackend(disc), X, random_start(len(X)))
    return 2.0 / math.sqrt(omega2) if omega2 > 0.0 else math.inf


def _without(disc: Discretisation, elements: NDArray[np.int64]) -> Discretisation:
    """The same bodies with elements that have mass and no stiffness."""
    Vmu, Vlam = disc.Vmu.copy(), disc.Vlam.copy()
    Vmu[elements] = Vlam[elements] = 0.0
    return replace(disc, Vmu=Vmu, Vlam=Vlam)


def _rounded_up(share: float) -> float:
    return float(f"{1.1 * share:.1g}") if share > 0.0 else 0.0
