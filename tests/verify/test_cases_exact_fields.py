# SPDX-License-Identifier: BSD-3-Clause
"""Cases of exact fields.

1. Every quick row passes, and forces, both waves, the bar between walls and the orders are among them.
2. A stress that is wrong by a hundredth of one term, and a missing factor in the load, are noticed.
3. Forces five per cent too large, which belong to no energy, turn the rows of the hanging bar red;
   so does lam wrong by a fiftieth. The norm of energy is the integral by hand.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.verify.wrong_forces import StrongUse
from verify.cases import exact_fields
from verify.problems.bodies import body
from verify.suite.run import Status, choose, run_row
from verify.suite.use import Use

NAMES = ("straight-motion-forces", "straight-motion-stiffness", "wave-forces", "bar-between-walls", "hanging-bar-order")
NAMES += ("hanging-bar-error", "frequency-order")
ROWS = choose(" ".join(f"exact/{name}" for name in NAMES), quick=True)
USE = Use(threads=1)


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_quick_rows(row):
    result = run_row(row, USE)
    assert result.status in (Status.PASS, Status.SKIP), result


def test_quick_rows_are_there():
    names = {str(row) for row in ROWS}
    assert {row.case.id for row in ROWS} == {f"exact/{name}" for name in NAMES}
    assert {"exact/wave-forces[shear,float32]", "exact/straight-motion-forces[float32,slivers]"} <= names


class WrongUse(Use):
    """Makes passes for a slightly other body."""

    def backend(self, disc, precision="float64"):
        return super().backend(replace(disc, Vlam=1.01 * disc.Vlam, lam=1.01 * disc.lam), precision)


def test_wrong_lam_is_noticed():
    wrong = WrongUse(threads=1)
    assert exact_fields.straight_motion_forces(wrong, precision="float32", mesh="box").error > 1e-5
    assert exact_fields.wave_forces(wrong, wave="longitudinal", precision="float64").error > 1e-3
    assert exact_fields.bar_between_walls(wrong, solver="fas").error > 1e-3


def test_straight_motion_turns_elements_over():
    disc = body("box")
    x = exact_fields.straight_line_state(disc)
    assert (USE.backend(disc).energies(x)[1] < 0.0).any()
    np.testing.assert_array_equal(x[~disc.free], disc.mesh.points[~disc.free])


@pytest.mark.parametrize("name", ["hanging-bar-order", "hanging-bar-error"])
def test_too_large_forces_are_noticed(name):
    (row,) = choose(f"exact/{name}")
    assert run_row(row, StrongUse(threads=1)).status is Status.FAIL


def test_wrong_lam_is_more_than_the_error_of_interpolation():
    assert exact_fields.hanging_bar_error(SoftUse(threads=1)).error > 0.01


class SoftUse(Use):
    """Makes passes for a body with lam too small by a fiftieth."""

    def backend(self, disc, precision="float64"):
        return super().backend(replace(disc, Vlam=0.98 * disc.Vlam, lam=0.98 * disc.lam), precision)


def test_norm_of_energy():
    bar = exact_fields._hanging(USE, 4)
    X, disc = bar.disc.mesh.points, bar.disc
    # A field of constant slopes a, b: (mu + lam) times the integral of (0.4 (1 - x) - a)^2, and mu b^2; area 1/4 m^2.
    a, b = 0.1, 0.3
    expected = (disc.mu[0] + disc.lam[0]) * 0.25 * (0.3**3 + 0.1**3) / (3.0 * 0.4) + disc.mu[0] * 0.25 * b**2
    assert exact_fields._energy_error(bar, a * X[:, 0] + b * X[:, 1]) == pytest.approx(np.sqrt(expected), rel=1e-12)
