# SPDX-License-Identifier: BSD-3-Clause
"""What is said about shape and connections of a mesh.

1. A good block has nothing wrong with it.
2. A sliver is found, counted, and named by its number in the user's file, whatever order the solver has.
3. Sizes that look like millimetres are noted, and so are edges of very different lengths.
4. Separate parts, seams and hinges are told apart; a welded mesh has none of them.
5. Elements without a vertex inside, and without a free vertex, are counted.
6. A broken file is the reader's own error.
"""

from __future__ import annotations

import numpy as np
import pytest

from meshes.errors import InputError, MeshError
from meshes.types import TetMesh
from tests.femgal.slivers import box_with_slivers
from tests.verify.diagnosed import HELD, beside, block, target, welded
from verify.diagnose import parts, shape
from verify.diagnose.finding import Severity
from verify.diagnose.target import find_target

LOOKS = (shape.size, shape.slivers, shape.edges, parts.parts, parts.seams, parts.hinges)


def test_a_good_block(tmp_path):
    good = target(tmp_path, block((6, 4, 4), (1.0, 0.7, 0.7)))
    assert {look(good).severity for look in (*LOOKS, parts.stuck)} == {Severity.OK}
    assert shape.size(good).numbers["mass_kg"] == pytest.approx(490.0)


def test_slivers_have_the_numbers_of_the_file(tmp_path):
    mesh = box_with_slivers(1e-3, count=2)
    bad = target(tmp_path, mesh)
    found = shape.slivers(bad)
    assert found.severity is Severity.WARNING
    angles = shape.shapes(mesh.points, mesh.cells)[0]
    worst = np.argsort(angles, kind="stable")[:5]
    assert [one["tet"] for one in found.numbers["worst"]] == worst.tolist()
    assert found.numbers["below_1_deg"] == (angles < 1.0).sum() >= 2
    assert str(worst[0]) in found.what
    order = bad.numbers
    # Not the solver's own order, or nothing was shown.
    assert not np.array_equal(order, np.arange(len(order)))
    assert np.allclose(bad.disc.V, mesh.volumes[order])


def test_size_and_edges(tmp_path):
    mesh = block()
    drawn_in_mm = target(tmp_path, mesh.moved(1000.0 * mesh.points))
    assert shape.size(drawn_in_mm).severity is Severity.NOTE
    assert "metres" in shape.size(drawn_in_mm).advice
    thin = target(tmp_path, mesh.moved(mesh.points * [1.0, 1.0, 1e-2]))
    found = shape.edges(thin)
    assert found.severity is Severity.WARNING
    assert found.numbers["longest_over_shortest"] == pytest.approx(np.sqrt(2 * 0.25**2 + 0.0025**2) / 0.0025, rel=1e-4)


def test_parts_seams_and_hinges(tmp_path):
    mesh = block()
    apart = target(tmp_path, beside(mesh, [2.0, 0.0, 0.0]))
    assert parts.parts(apart).severity is Severity.WARNING
    assert parts.parts(apart).numbers["parts"] == 2
    assert parts.seams(apart).severity is parts.hinges(apart).severity is Severity.OK
    cut = beside(mesh, [1.0, 0.0, 0.0])
    seam = parts.seams(target(tmp_path, cut))
    assert seam.severity is Severity.PROBLEM
    assert seam.numbers["pairs"] == 9
    assert seam.numbers["first_m"][0] == pytest.approx(1.0)
    whole = target(tmp_path, welded(cut))
    assert {look(whole).severity for look in (parts.parts, parts.seams, parts.hinges)} == {Severity.OK}
    hinged = target(tmp_path, welded(beside(mesh, [1.0, 0.5, 0.0])))
    found = parts.hinges(hinged)
    assert found.severity is Severity.WARNING
    assert (found.numbers["parts_by_vertices"], found.numbers["parts_by_faces"]) == (1, 2)
    assert found.numbers["crowded_edges"] == 2


def test_parts_that_nothing_holds(tmp_path):
    held = target(tmp_path, beside(block(), [2.0, 0.0, 0.0]), more=HELD.format(x=0.1))
    assert parts.parts(held).numbers["parts_not_held"] == 1
    assert "1 of them held by no constraint" in parts.parts(held).what


def test_elements_that_cannot_deform(tmp_path):
    slab = target(tmp_path, block((5, 3, 1)), more=HELD.format(x=0.25))
    found = parts.stuck(slab)
    assert found.severity is Severity.WARNING
    assert found.numbers["all_on_boundary"] == slab.disc.n_tets == 90
    assert found.numbers["all_fixed"] == 18


def test_broken_files(tmp_path):
    path = tmp_path / "broken.msh"
    path.write_text("$MeshFormat\n")
    with pytest.raises(MeshError) as read:
        find_target(str(path), None)
    assert str(path) in str(read.value)
    with pytest.raises(InputError):
        find_target(str(tmp_path / "none.msh"), None)
    with pytest.raises(MeshError):
        TetMesh(np.zeros((4, 3)), np.array([[0, 1, 2, 3]]))
