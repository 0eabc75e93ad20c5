# SPDX-License-Identifier: BSD-3-Clause
"""Implicit formulas with steps of varying lengths and with vertices that are driven."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from femgal.timestep.state import MotionState
from verify.cases.stepping import after_a_quarter, struck
from verify.integrators.of_femgal import stepper
from verify.integrators.under_test import ORDERS, State, discretised, solver_under_test
from verify.problems.moving_body import MovingBody
from verify.reference.semidiscrete import exact_motion
from verify.suite.case import Kind, Measurement, case
from verify.suite.measure import compare, order
from verify.suite.use import Use

Floats = NDArray[np.float64]

# Lengths of the steps that follow each other, over their mean.
PATTERNS = {"equal": (1.0,), "alternating": (0.6, 1.4)}


@dataclass(frozen=True, eq=False)
class Swinging:
    """Vertices that swing across the body, at rest in the beginning; `Motion` of `femgal.timestep.state`."""

    vertices: NDArray[np.int64]
    rest: Floats
    amplitude: Floats
    duration: float
    is_fixed: bool = False

    def positions(self, time: float) -> Floats:
        """Positions [m] at a time [s]."""
        return np.asarray(self.rest + self.amplitude * np.sin(np.pi * time / self.duration) ** 2, np.float64)


@case(
    "stepping/varying-steps",
    title="The order in time holds for steps of varying lengths and with vertices that are driven",
    quantity="observed order of the mass-weighted distance from the exact motion after a quarter of a period",
    unit="1",
    kind=Kind.ODE,
    formula="|x_N - x(T)|_M / |x(T) - x(0)|_M = C h^p with p = 1 for backward Euler, 2 for BDF2 and TR-BDF2",
    source="x(T) of M x'' = -grad E with prescribed positions, by DOP853 at a relative tolerance of 1e-11",
    tolerance=0.1,
    reason="terms of the next order at the steps here",
    over={
        "solver": ("fas", "fas-bdf2", "newton-multigrid", "newton-multigrid-bdf2"),
        "steps": tuple(PATTERNS),
        "ends": ("held", "driven"),
    },
    quick={"solver": ("fas-bdf2", "newton-multigrid"), "steps": ("alternating",), "ends": ("driven",)},
)
def varying_steps(use: Use, *, solver: str, steps: str, ends: str) -> Measurement:
    """Of a bar that is struck, and whose held end swings there and back."""
    sut, body, (exact, T) = solver_under_test(solver, use), struck(), _exact(ends)
    assert sut.method is not None
    counts, pattern = (32, 64, 128), PATTERNS[steps]
    scale, errors = np.sqrt(body.kinetic(exact.x - body.start.x)), []
    for n in counts:
        end = _run(solver, use, ends, [T / n * pattern[k % len(pattern)] for k in range(n)])
        errors.append(np.sqrt(body.kinetic(end.x - exact.x)) / scale)
    title = f"Order in time of {solver}, {steps} steps, {ends} ends"
    return order([T / n for n in counts], errors, ORDERS[sut.method], x="step [s]", y="relative error", title=title)


@case(
    "stepping/formula",
    title="Steps of varying lengths are those of the reference, which is written by another form of the method",
    quantity="largest distance of a vertex after six steps over the largest distance that elasticity moved one",
    unit="m",
    kind=Kind.CROSS_CODE,
    formula="BDF2 by the parabola through three states; TR-BDF2 by its Runge-Kutta tableau (Hosea & Shampine 1996)",
    source="verify/reference/stepping.py: steps solved by the reference Newton",
    tolerance=1e-8,
    reason="each solve is good to 1e-13 of the size, and six steps divide it by h twice",
    over={"solver": ("fas-bdf2", "newton-multigrid-bdf2", "newton-multigrid")},
    quick={"solver": ("fas-bdf2", "newton-multigrid")},
    requires="scikit-fem",
)
def formula(use: Use, *, solver: str) -> Measurement:
    """Of the struck bar, with steps whose lengths grow and shrink by up to a factor of two."""
    sut, body, T = solver_under_test(solver, use), struck(), after_a_quarter()[1]
    reference = solver_under_test({"bdf2": "newton-bdf2", "tr-bdf2": "newton-tr-bdf2"}[sut.promises(*ORDERS)], use)
    found = expected = body.start
    lengths = [T / 8 * share for share in (1.0, 1.6, 0.8, 0.8, 1.5, 0.9)]
    for h in lengths:
        found = sut.step(body.mesh, body.material, found, h)
        expected = reference.step(body.mesh, body.material, expected, h)
    moved = expected.x - (body.start.x + sum(lengths) * body.start.v)
    return compare(found.x, expected.x, float(np.abs(moved).max()))


@cache
def _swinging(ends: str) -> Swinging:
    """The held end of the struck bar, moved by a twentieth of its size where it is driven."""
    body, T = struck(), after_a_quarter()[1]
    held = body.start.constrained
    amplitude = (0.05 if ends == "driven" else 0.0) * body.size * np.array([0.0, 1.0, 2.0])
    return Swinging(held, body.start.x[held], amplitude, 2.0 * T)


@cache
def _exact(ends: str) -> tuple[State, float]:
    """The exact state after a quarter of a period, and that time [s]."""
    body, T = struck(), after_a_quarter()[1]
    return exact_motion(body.mesh, body.material, body.start, T, _swinging(ends).positions), T


def _run(solver: str, use: Use, ends: str, lengths: list[float]) -> MotionState:
    body: MovingBody = struck()
    start = body.start
    disc = discretised(body.mesh, body.material, start.constrained)
    method = stepper(solver, use, disc, start.gravity, (_swinging(ends),))
    state = method.init(start.x, start.v)
    for h in lengths:
        state, _ = method.begin_frame(state, h, 1)
        state = method.step(state, h)
    return state
