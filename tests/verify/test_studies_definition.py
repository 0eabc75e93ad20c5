# SPDX-License-Identifier: BSD-3-Clause
"""Studies as data.

1. Every study loads; its claims name parts and curves that exist, its grids are grids, its plots are drawn from known
   quantities, its published tables are there and name its curves.
2. The quick version is smaller and otherwise the same; sizes and levels can be replaced.
3. What is no study, no level or no curve is refused.
4. The published tables are those of the paper: a few of their figures, and their shape.
"""

from __future__ import annotations

import pytest

from meshes.errors import InputError
from verify.studies.definition import NAMES, StudyDefinition, load_definition
from verify.studies.published import published_tables

QUANTITIES = {"seconds", "passes", "iterations", "substeps", "eps18", "error", "iteration", "gap", "distance"}


@pytest.mark.parametrize("name", NAMES)
def test_every_study(name):
    study = load_definition(name)
    assert study.claims
    for part in study.parts:
        curves = {method.curve for method in part.make_grid().methods()}
        assert {word for plot in part.plots for word in plot.split()} <= QUANTITIES
        assert not part.baseline or part.baseline in curves
        if part.table:
            assert set(published_tables()[part.table].rows) <= curves
            assert published_tables()[part.table].axis == part.axis
        assert sorted(part.levels, reverse=True) == list(part.levels)


@pytest.mark.parametrize("name", NAMES)
def test_quick_version_is_smaller(name):
    full, quick = load_definition(name), load_definition(name).shrunk()
    assert [part.id for part in quick.parts] == [part.id for part in full.parts]
    for large, small in zip(full.parts, quick.parts, strict=True):
        grids = large.make_grid(), small.make_grid()
        assert max(grids[1].vertices) < max(grids[0].vertices)
        assert len(grids[1].methods()) <= len(grids[0].methods())
        assert {m.curve for m in grids[1].methods()} == {m.curve for m in grids[0].methods()}
        assert len(grids[1].methods()) <= 4 * len(grids[1].solvers)


def test_changes():
    study = load_definition("sizes").with_grid(vertices=[500, 700]).with_levels([1e-3])
    assert study.parts[0].make_grid().vertices == (500, 700)
    assert study.parts[0].make_grid().frames == load_definition("sizes").parts[0].make_grid().frames
    assert study.parts[0].levels == (1e-3,)


def test_refused():
    with pytest.raises(InputError, match="no such study") as caught:
        load_definition("size")
    assert "sizes" in str(caught.value)
    with pytest.raises(InputError, match="not levels"):
        load_definition("sizes").with_levels([1e-3, -1.0])
    data = load_definition("substeps").model_dump()
    data["claims"][0]["of"] = ["fas to nowhere"]
    with pytest.raises(ValueError, match="no such part or curve"):
        StudyDefinition.model_validate(data)


def test_published_tables():
    sizes, stiffness = published_tables()["sizes"], published_tables()["stiffness"]
    assert sizes.at("fas-constant", 1e6) == 6.90
    assert sizes.at("fas-linear", 200_000) == 4.68
    assert stiffness.at("fas-constant", 1e3) == 6.19
    assert stiffness.at("jacobi", 1e8) == 2.17
    assert sizes.at("fas-constant", 3000) is None
    assert sizes.at("verlet", 2000) is None
    for table in (sizes, stiffness):
        assert all(len(figures) == len(table.values) for figures in table.rows.values())
        assert set(table.rows["newton-pcg"]) == {1.0}
