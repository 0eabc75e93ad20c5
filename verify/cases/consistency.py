# SPDX-License-Identifier: BSD-3-Clause
"""Does the motion become right as the substeps become short? One pass per substep with three rules of step length.

For h -> 0 the Hessian of a step is M / h^2, so that one pass with a fixed step length w applies the share w of the
elastic force: the body moves as a softer one, however short the substeps. The residual eps18 does not tell, because it
carries a factor of h^2. Step lengths that tend to 1 (spectral, or by line search) have no such error.

The reference is velocity Verlet in double precision at a fifth of its stable step, whose own error is measured against
half that step. Errors are trajectory errors: mass-weighted RMS over vertices and frames of the distance, over that of
the reference's motion. Frames are taken with the substeps given and never again; `femgal run` would refuse to go on
with the published step lengths here, because the energy of the body grows where it moves as a softer one.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any, cast

import numpy as np

from femgal.solvers.smoother import Relaxation
from femgal.timestep.backward_euler import BackwardEuler
from verify.benchmark.trajectory import trajectory_error
from verify.problems.scenes import Run, hanging, simulation, steps_alone
from verify.suite.case import Curve, Kind, Measurement, Plot, case
from verify.suite.measure import observed_orders, order
from verify.suite.use import Use

FRAMES = 4
SUBSTEPS = (10, 20, 40, 80)
_H = [1.0 / (60.0 * S) for S in SUBSTEPS]
# Blocks are near M / h^2 only where the substep is short for the stiffest vertex.
_SHORTER = (20, 40, 80, 160)

RULES: dict[str, dict[str, Any]] = {
    "published": {"name": "fas", "ratio": 8, "steps": "lu2025"},
    "spectral": {"name": "fas", "ratio": 8, "steps": "spectral"},
    "exact": {"name": "fas", "ratio": 8, "steps": "exact"},
    "linear-spectral": {"name": "fas", "transfer": "linear", "steps": "spectral"},
    "jacobi-half": {"name": "jacobi", "steps": (0.5, 0.5)},
}
MESHES = ("beam", "rabbit", "bunny-2000")
_X, _Y = "substep [s]", "trajectory error"
_SOURCE = "velocity Verlet at a fifth of its stable step; its own error is the row consistency/reference"


@case(
    "consistency/reference",
    title="The reference is twenty times closer to the exact motion than anything compared with it",
    quantity="trajectory error of velocity Verlet at a fifth of its stable step, by halving that step",
    unit="1",
    kind=Kind.ODE,
    formula="e(h) = 4/3 |x_h - x_{h/2}| for a method of order 2",
    source="Richardson extrapolation; the order is the row stepping/order[verlet]",
    tolerance=1e-4,
    reason="the smallest error in the study is 2e-3",
    over={"mesh": MESHES},
    quick={"mesh": ("beam",)},
)
def reference_error(use: Use, *, mesh: str) -> Measurement:
    """Distance of two references."""
    first, second = reference(mesh, use), reference(mesh, use, safety=0.1)
    error = 4.0 / 3.0 * trajectory_error(first.simulation.disc.mass, first.displacements, second.displacements)
    return Measurement(error, 0.0, error, f"largest displacement {np.abs(first.displacements).max():.3g} m")


@case(
    "consistency/order",
    title="One pass with consistent step lengths per substep: the trajectory error falls with the substep",
    quantity="observed order of the trajectory error",
    unit="1",
    kind=Kind.ODE,
    formula="error = C h for spectral step lengths, 2 / (1 + lambda) -> 1, and for exact line searches",
    source=_SOURCE,
    tolerance=0.15,
    reason="terms of the next order, and at the longer substeps what one pass leaves undone",
    over={"mesh": MESHES, "rule": ("spectral", "exact", "linear-spectral")},
    quick={"mesh": ("beam",), "rule": ("spectral",)},
)
def consistent_order(use: Use, *, mesh: str, rule: str) -> Measurement:
    """Like backward Euler itself."""
    return _with_residuals(_order(mesh, rule, use, 1.0), mesh, rule, use)


@case(
    "consistency/published-steps",
    title="With the published step lengths the trajectory error stays where it is, however short the substeps",
    quantity="observed order of the trajectory error between the two shortest substeps",
    unit="1",
    kind=Kind.ODE,
    formula="error -> constant: the share 1 - (1 - 1/4)^coarse (1 - 1/2) of the elastic force is applied at most",
    source=_SOURCE + "; step lengths of Lu et al. 2025, section 7.1",
    tolerance=0.1,
    reason="the part of the error that falls is still some per cent of it",
    over={"mesh": MESHES},
    quick={"mesh": ("beam",)},
)
def published_steps(use: Use, *, mesh: str) -> Measurement:
    """The note says how far eps18 falls meanwhile."""
    return _with_residuals(_order(mesh, "published", use, 0.0), mesh, "published", use)


@case(
    "consistency/published-stiffness",
    title="With the published step lengths the body moves as one of half its stiffness or more, and less than its own",
    quantity="trajectory error at the shortest substep outside of those of bodies of these stiffnesses, as a share",
    unit="1",
    kind=Kind.ODE,
    formula="|x(E s) - x(E)| - e <= error <= |x(E/2) - x(E)| + e, s = 1 - (1 - 1/4)^coarse (1 - 1/2), e of substeps",
    source=_SOURCE + "; step lengths of Lu et al. 2025, section 7.1",
    tolerance=0.0,
    reason="bounds: of the elastic force 1/2 is applied at least, and s at most; e is the error of spectral steps",
    over={"mesh": MESHES},
    quick={"mesh": ("beam",)},
)
def published_stiffness(use: Use, *, mesh: str) -> Measurement:
    """How large the error is that stays: the order alone is that of any solver that is stuck."""
    published = run(mesh, "published", SUBSTEPS[-1], use)
    share = 1.0 - 0.5 * 0.75 ** coarse_layers(published)
    found, own = error(published, reference(mesh, use)), reference(mesh, use)
    least, most = (error(reference(mesh, use, E=one * 1e5), own) for one in (share, 0.5))
    e = error(run(mesh, "spectral", SUBSTEPS[-1], use), own)
    outside = float(np.maximum(np.maximum(least - e - found, found - most - e), 0.0)) / most
    note = f"{least:.3g} of the share {share:.3g}, {most:.3g} of 1/2, e = {e:.2g}"
    return Measurement(found, most, outside, note)


def coarse_layers(run: Run) -> int:
    """Layers of a run's hierarchy but the finest."""
    solver = cast(BackwardEuler, run.simulation.stepper).solver
    return len(cast(Relaxation, solver).layers) - 1


@case(
    "consistency/eps18",
    title="The residual eps18 falls at least with the square of the substep, whether the motion is right or wrong",
    quantity="observed order of eps18 at the last frame",
    unit="1",
    kind=Kind.IDENTITY,
    formula="eps18 = |h^2 M^-1 grad phi| / sqrt(N), and grad phi -> (1 - w) grad E where a share w of it is applied",
    source="Lu et al. 2025, Eq. 18, for h -> 0",
    tolerance=0.1,
    reason="terms of the next order; falling faster is no error",
    over={"mesh": MESHES, "rule": ("published", "spectral", "exact")},
    quick={"mesh": ("beam",), "rule": ("published", "spectral")},
)
def eps18_falls(use: Use, *, mesh: str, rule: str) -> Measurement:
    """That is why no row here is judged by it."""
    residuals = [run(mesh, rule, S, use).residuals[-1] for S in SUBSTEPS]
    found = order(_H, residuals, 2.0, x=_X, y="eps18 [m]", title=f"eps18, {rule} step lengths, {mesh}")
    # Unlike max, np.maximum of a number and NaN is NaN.
    return replace(found, error=float(np.maximum(0.0, 2.0 - found.computed)))


@case(
    "consistency/softer-body",
    title="Block Jacobi with w = 1/2 converges to the motion of a body of half the stiffness",
    quantity="observed order of the trajectory error against the body of half the stiffness",
    unit="1",
    kind=Kind.ODE,
    formula="x = xhat - w D^-1 grad E(xhat), D -> M / h^2 as h -> 0, which is a step of M x'' = M g - w grad E",
    source="velocity Verlet for E/2 at a fifth of its stable step",
    tolerance=0.15,
    reason="terms of the next order",
    over={"mesh": MESHES},
    quick={"mesh": ("beam",)},
)
def softer_body(use: Use, *, mesh: str) -> Measurement:
    """Says what a fixed step length does: neither damping nor noise, another material."""
    soft = reference(mesh, use, E=0.5e5)
    found = [error(run(mesh, "jacobi-half", S, use), soft) for S in _SHORTER]
    wrong = error(run(mesh, "jacobi-half", _SHORTER[-1], use), reference(mesh, use))
    h = [1.0 / (60.0 * S) for S in _SHORTER]
    measured = order(h, found, 1.0, x=_X, y=_Y, title=f"Block Jacobi, w = 1/2, against half the stiffness, {mesh}")
    return replace(measured, note=f"{measured.note}; against the body's own stiffness {wrong:.3g}")


@case(
    "consistency/published-against-spectral",
    title="How many times the trajectory error the published step lengths have at the shortest substep",
    quantity="trajectory error over that of the spectral step lengths",
    unit="1",
    kind=Kind.ODE,
    formula="error(published) / error(spectral) at 80 substeps per frame, for the same passes",
    source=_SOURCE,
    tolerance=None,
    reason="reported, not judged",
    over={"mesh": MESHES},
    quick=False,
)
def published_against_spectral(use: Use, *, mesh: str) -> Measurement:
    """With the plot of all rules."""
    errors = {rule: errors_of(mesh, rule, use) for rule in RULES}
    curves = tuple(Curve(rule, tuple(_H), tuple(values)) for rule, values in errors.items())
    factor = errors["published"][-1] / errors["spectral"][-1]
    plots = (Plot(f"Trajectory error against substep, {mesh}", _X, _Y, curves, (1.0,)),)
    return Measurement(factor, 1.0, factor, f"{errors['published'][-1]:.3g} and {errors['spectral'][-1]:.3g}", plots)


@cache
def run(mesh: str, rule: str, substeps: int, use: Use) -> Run:
    """The scene with one pass per substep."""
    return steps_alone(simulation(hanging(mesh, FRAMES, substeps=substeps, **RULES[rule]), use))


@cache
def reference(mesh: str, use: Use, *, safety: float = 0.2, E: float = 1e5) -> Run:
    """The scene by velocity Verlet."""
    return steps_alone(simulation(hanging(mesh, FRAMES, E=E, name="verlet", safety=safety), use))


def error(run: Run, against: Run) -> float:
    """Trajectory error."""
    return trajectory_error(run.simulation.disc.mass, run.displacements, against.displacements)


def errors_of(mesh: str, rule: str, use: Use) -> list[float]:
    """Trajectory errors for all numbers of substeps."""
    return [error(run(mesh, rule, S, use), reference(mesh, use)) for S in SUBSTEPS]


def _order(mesh: str, rule: str, use: Use, expected: float) -> Measurement:
    title = f"Trajectory error against substep, {rule} step lengths, {mesh}"
    return order(_H, errors_of(mesh, rule, use), expected, x=_X, y=_Y, title=title)


def _with_residuals(measured: Measurement, mesh: str, rule: str, use: Use) -> Measurement:
    """The same with eps18 beside it."""
    residuals = [float(run(mesh, rule, S, use).residuals[-1]) for S in SUBSTEPS]
    plot = Plot(
        f"eps18 against substep, {rule} step lengths, {mesh}",
        _X,
        "eps18 [m]",
        (Curve("eps18", tuple(_H), tuple(residuals)),),
        (2.0,),
    )
    fallen, orders = residuals[0] / residuals[-1], observed_orders(_H, residuals)
    note = f"{measured.note}; eps18 falls {fallen:.3g} times, order {orders[-1]:.2f}"
    return replace(measured, note=note, plots=(*measured.plots, plot))
