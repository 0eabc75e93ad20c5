# SPDX-License-Identifier: BSD-3-Clause
"""What is said about bending and locking.

1. Rays through a grid count its cells, whatever their size, and measure its thickness.
2. Neighbours over faces are those that share three vertices.
3. The cantilever: linear elements are never too soft, the excess falls with the square of the cell width, it grows
   with nu, and it does not depend on the number of cells for what is interpolated at whole numbers.
4. The tip deflection of quadratic elements is the beam formula's, so what is measured is the elements' fault.
5. One cell through the thickness is a problem, many cells are not; nu near 1/2 is a problem of its own.
"""

from __future__ import annotations

import numpy as np
import pytest

from meshes.generators import box
from tests.verify.diagnosed import block, target
from verify.diagnose import cantilever, locking
from verify.diagnose.finding import Severity
from verify.diagnose.thickness import face_neighbours, thickness
from verify.problems.bodies import uniform


@pytest.mark.parametrize("cells", [1, 3])
def test_rays_count_the_cells_of_a_grid(cells):
    # Cubes of 0.1 m; end faces see the length of the beam, the others its thickness.
    found = thickness(uniform(box((0.8, 0.1 * cells, 0.1 * cells), (8, cells, cells))), rays=400)
    ends = np.isclose(found.length, 0.8)
    assert 0 < ends.sum() < 200
    assert found.length[~ends] == pytest.approx(0.1 * cells)
    assert found.elements[~ends] == pytest.approx(cells)
    assert found.elements[ends] == pytest.approx(8.0)


def test_face_neighbours():
    cells = box(cells=(2, 1, 1)).cells
    neighbour = face_neighbours(cells)
    for e, row in enumerate(neighbour):
        for k, other in enumerate(row):
            shared = [f for f in range(len(cells)) if f != e and set(np.delete(cells[e], k)) <= set(cells[f])]
            assert shared == ([other] if other >= 0 else [])


def test_cantilever():
    for nu in (0.0, 0.3, 0.45):
        excess = np.array([cantilever.measured(nu, n) - 1.0 for n in (1, 2, 4)])
        assert (excess > 0.0).all()
        assert np.log2(excess[1] / excess[2]) == pytest.approx(2.0, abs=0.25)
    assert cantilever.measured(0.499, 3) > cantilever.measured(0.49, 3) > 2.0 * cantilever.measured(0.3, 3)
    assert cantilever.over_stiffness(0.3, 2.0) == pytest.approx(cantilever.measured(0.3, 2))
    assert cantilever.measured(0.3, 3) < cantilever.over_stiffness(0.3, 2.5) < cantilever.measured(0.3, 2)
    # What is extrapolated, against what would be measured.
    assert cantilever.over_stiffness(0.3, 6.0) == pytest.approx(cantilever.measured(0.3, 6), rel=0.02)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.45])
def test_quadratic_elements_bend_as_the_formula_says(nu):
    import skfem
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    grid = box((10.0, 1.0, 1.0), (20, 2, 2))
    mesh = skfem.MeshTet(grid.points.T.copy(), grid.cells.T.astype(np.int64))
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTetP2()))
    K = linear_elasticity(*lame_parameters(1.0, nu)).assemble(basis)
    end = skfem.FacetBasis(mesh, basis.elem, facets=mesh.facets_satisfying(lambda x: np.isclose(x[0], 10.0)))
    load = skfem.LinearForm(lambda v, w: v[1]).assemble(end)
    clamped = basis.get_dofs(lambda x: np.isclose(x[0], 0.0))
    u = skfem.solve(*skfem.condense(K, load, D=clamped))
    # The clamp holds the end's cross-section, which the formula lets contract: 3 % at nu = 0.45.
    assert float(u @ load) == pytest.approx(cantilever._timoshenko(nu), rel=0.04)


def test_findings(tmp_path):
    slab = target(tmp_path, box((2.0, 0.2, 0.2), (10, 1, 1)))
    found = locking.bending(slab, thickness(slab.disc))
    assert found.severity is Severity.PROBLEM
    assert found.numbers["over_stiffness_thin_tenth"] > 3.0
    assert "12 elements" in found.advice
    thick = target(tmp_path, box(cells=(16, 16, 16)), nu=0.3)
    assert locking.bending(thick, thickness(thick.disc)).severity is Severity.OK
    assert locking.volumetric(thick, thickness(thick.disc)).severity is Severity.OK


def test_near_incompressible(tmp_path):
    mesh = block((8, 4, 4))
    for nu, severity in ((0.4, Severity.NOTE), (0.49, Severity.WARNING), (0.499, Severity.PROBLEM)):
        body = target(tmp_path, mesh, nu=nu)
        found = locking.volumetric(body, thickness(body.disc))
        assert found.severity is severity
        assert found.numbers["lam_over_mu"] == pytest.approx(2.0 * nu / (1.0 - 2.0 * nu))
