# SPDX-License-Identifier: BSD-3-Clause
"""Cases about uniform deformations.

1. Every quick row passes, the moduli first.
2. Closed forms belong together: P is the derivative of the energy, free sides carry no stress, and the von Mises norm
   is that of P F^T / J.
3. Swapping lam for lam_Lame, or a sign in the stress, is seen by the rows named for it.
4. An assembled reference whose energy or forces are not numbers is red.
5. Area normals of a closed surface add up to zero, and those of one end of a bar to its area.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from verify.cases import material
from verify.problems.bodies import body
from verify.reference.uniform_states import UNIFORM_STATES, confined, dilation, equibiaxial, simple_shear, uniaxial
from verify.reference.uniform_states import uniform_state as state_of
from verify.suite.run import Status, choose, run, run_row
from verify.suite.use import Use

MU, LAM = 1.3e4, 4.1e4


def test_quick_rows_pass():
    rows = choose("material/*", quick=True)
    assert str(rows[0]) == "material/youngs-modulus[float64,-0.2]"
    assert len(rows) >= 50
    assert [str(one.row) for one in run(rows, Use()) if one.status is not Status.PASS] == []


@pytest.mark.parametrize("name", UNIFORM_STATES)
def test_closed_forms(name):
    state = state_of(name, MU, LAM)
    assert np.linalg.det(state.F) == pytest.approx(state.J, rel=1e-14)
    C = np.linalg.det(state.F) * np.linalg.inv(state.F).T
    np.testing.assert_allclose(state.P, MU * state.F + (LAM * (state.J - 1.0) - MU) * C, atol=1e-12 * LAM)
    sigma = state.P @ state.F.T / state.J
    deviator = sigma - np.trace(sigma) / 3.0 * np.eye(3)
    assert state.von_mises == pytest.approx(np.sqrt(1.5 * (deviator**2).sum()), abs=1e-12 * LAM)


@pytest.mark.parametrize(
    ("made", "direction"),
    [
        (lambda t: uniaxial(1.5 + t, MU, LAM), np.diag([1.0, 0.0, 0.0])),
        (lambda t: equibiaxial(0.8 + t, MU, LAM), np.diag([1.0, 1.0, 0.0])),
        (lambda t: confined(0.6 + t, MU, LAM), np.diag([1.0, 0.0, 0.0])),
        (lambda t: simple_shear(0.4 + t, MU), np.eye(3)[[1, 2, 0]] * [[1.0], [0.0], [0.0]]),
        (lambda t: dilation(1.2 + t, MU, LAM), np.eye(3)),
    ],
)
def test_stress_is_the_derivative_of_the_energy(made, direction):
    # Free sides do no work.
    slope = (made(1e-5).energy - made(-1e-5).energy) / 2e-5
    assert slope == pytest.approx(float((made(0.0).P * direction).sum()), rel=1e-7)


def rows_that_fail(monkeypatch, pattern):
    material.bar.cache_clear()
    material.pulled_bar.cache_clear()
    failed = {str(one).split("[")[0] for one in choose(pattern) if run_row(one, Use()).status is Status.FAIL}
    monkeypatch.undo()
    material.bar.cache_clear()
    material.pulled_bar.cache_clear()
    return failed


def test_lame_parameter_without_mu_is_noticed(monkeypatch):
    discretise = material.discretise

    def wrong(*arguments):
        disc = discretise(*arguments)
        return replace(disc, lam=disc.lam - disc.mu, Vlam=disc.Vlam - disc.Vmu)

    monkeypatch.setattr(material, "discretise", wrong)
    found = rows_that_fail(monkeypatch, "material/youngs-modulus[float64,0.3] material/poissons-ratio[float32,0.3]")
    assert found == {"material/youngs-modulus", "material/poissons-ratio"}


def test_wrong_stiffness_is_noticed(monkeypatch):
    monkeypatch.setattr(material, "body", lambda *a, **k: replace(body(*a, **k), Vlam=1.001 * body(*a, **k).Vlam))
    found = rows_that_fail(
        monkeypatch, "uniform-forces[float32,confined] uniform-energy[float32,confined] dilation[float32]"
    )
    assert found == {"material/uniform-forces", "material/uniform-energy", "material/energy-along-dilation"}


@pytest.mark.parametrize("name", ["energy", "gradient"])
def test_a_reference_that_is_no_number_is_red(monkeypatch, name):
    right = getattr(material.AssembledElasticity, name)
    monkeypatch.setattr(material.AssembledElasticity, name, lambda self, x: np.nan * right(self, x))
    (row,) = choose("material/assembled-reference[uniaxial]")
    assert run_row(row, Use()).status is Status.FAIL


def test_surface_areas():
    areas = material.surface_areas(body("rabbit", "uniform", held=False))
    assert np.abs(areas.sum(axis=0)).max() <= 1e-15 * np.abs(areas).sum()
    disc = material.bar(0.3)
    areas = material.surface_areas(disc)
    assert areas[areas[:, 0] > 0.0, 0].sum() == pytest.approx(0.25 * 0.2, rel=1e-12)
    # The divergence theorem: the sum of X . a is three times the volume.
    assert float((disc.mesh.points * areas).sum()) == pytest.approx(3.0 * 0.4 * 0.25 * 0.2, rel=1e-12)
