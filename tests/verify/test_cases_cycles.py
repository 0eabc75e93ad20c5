# SPDX-License-Identifier: BSD-3-Clause
"""Cases of solvers and multigrid cycles.

1. Every quick row passes; all solvers and cycles are among them.
2. Newton's method is needed: the prediction is far from the minimiser, and strained.
3. A wrong step length, a wrong sequence and a wrong restriction turn rows red.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.solvers.cycle import Cycle
from femgal.solvers.smoother import Relaxation
from verify.cases import cycles
from verify.problems.bodies import body, mean_edge
from verify.suite.run import Status, choose, run_row
from verify.suite.use import Use

ROWS = choose("cycles/", quick=True)
USE = Use(threads=1)


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_quick_rows(row):
    result = run_row(row, USE)
    assert result.status is Status.PASS, result


def test_quick_rows_are_there():
    names = {str(row) for row in ROWS}
    for solver in ("jacobi", "fas-clusters", "fas-lattice", "v-lattice", "w-clusters"):
        assert f"cycles/fixed-point[{solver},float32]" in names
        assert f"cycles/product-of-corrections[{solver}]" in names
    assert "cycles/observed-factor[v-pair]" in names


@pytest.mark.parametrize("name", ["box", "beam"])
def test_newton_is_needed(name):
    disc = body(name, "uniform")
    moved = np.linalg.norm(cycles.thrown(disc) - cycles.minimiser(disc), axis=1).max()
    assert moved > 0.1 * mean_edge(disc.mesh)


def test_wrong_step_length_is_noticed(monkeypatch):
    right = Relaxation.smooth_layer

    def longer(self, potential, x, number):
        self._w = self._w * np.where(np.arange(len(self._w)) == number, 1.0 + 1e-6, 1.0)
        return right(self, potential, x, number)

    monkeypatch.setattr(Relaxation, "smooth_layer", longer)
    assert cycles.product_of_corrections(USE, solver="fas-clusters").error > 1e-8


def test_wrong_sequence_is_noticed(monkeypatch):
    monkeypatch.setitem(cycles.CYCLES, "v", Cycle())
    assert cycles.product_of_corrections(USE, solver="v-lattice").error > 1e-3
    assert cycles.observed_factor(USE, solver="v-pair").error > 0.02


def test_wrong_force_moves_the_fixed_point(monkeypatch):
    right = cycles.thrown
    monkeypatch.setattr(cycles, "thrown", lambda disc: right(disc) + 1e-9 * disc.free[:, None])
    assert cycles.fixed_point(USE, solver="w-clusters", precision="float64").error > 1e-13
