# SPDX-License-Identifier: BSD-3-Clause
"""Cases of the patch test.

1. Every quick row passes; all maps, meshes, precisions and solvers are among the rows.
2. A wrong shape function gradient of one single element is noticed, in either precision.
3. A mesh without inner vertices is skipped, with the reason.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshes.generators import box
from verify.cases import patch
from verify.problems import bodies
from verify.suite.run import Status, choose, run_row
from verify.suite.use import Use

ROWS = choose("patch/", quick=True)
USE = Use(threads=1)


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_quick_rows(row):
    result = run_row(row, USE)
    assert result.status in (Status.PASS, Status.SKIP), result
    assert "not converged" not in result.note
    assert "above the tolerance" not in result.note


def test_rows_are_there():
    names = {str(row) for row in choose("patch/")}
    for name in patch.MAPS:
        assert {f"patch/interior-forces[float32,{name},slivers]", f"patch/newton[{name},rabbit]"} <= names
    assert {"patch/solved[fas,inverted,box]", "patch/solved-single[fas,inverted,box]"} <= names


class CrookedUse(Use):
    """Makes passes for a body with one inverse edge matrix that is wrong by a thousandth."""

    def backend(self, disc, precision="float64"):
        inner = int(np.flatnonzero(disc.free[disc.mesh.cells].all(axis=1))[0])
        B = disc.B.copy()
        B[inner] *= 1.001
        return super().backend(replace(disc, B=B), precision)


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_one_crooked_element_is_noticed(precision):
    measured = patch.interior_forces(CrookedUse(threads=1), precision=precision, map="inverted", mesh="box")
    tolerance = next(row for row in ROWS if row.values.get("precision") == precision).tolerance
    assert measured.error > 3.0 * tolerance


def test_no_inner_vertex(monkeypatch):
    monkeypatch.setattr(bodies, "mesh", lambda name: box(cells=(1, 1, 1)))
    with pytest.raises(patch.Skip, match="surface"):
        patch.patch("box")
