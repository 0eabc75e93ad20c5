# SPDX-License-Identifier: BSD-3-Clause
"""The cases about sweeps over vertices.

1. No quick row fails.
2. They notice colours that hold neighbours, and a sweep with another relaxation.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.gauss_seidel.colours import Colouring, colour_vertices
from femgal.solvers.explicit_vbd import ExplicitVBD
from verify.cases import descent
from verify.suite.case import Row
from verify.suite.run import Status, choose, run, run_row
from verify.suite.use import Use

USE = Use()
CASES = {row.case.id.split("/")[1]: row.case for row in choose("descent/*")}


@pytest.fixture(autouse=True)
def fresh():
    descent._sweep.cache_clear()
    yield
    descent._sweep.cache_clear()


def test_quick_rows():
    results = list(run(choose("descent/*", quick=True), USE))
    assert [f"{r.row}: {r.note}" for r in results if r.status is not Status.PASS] == []
    assert {r.row.case.id for r in results} == {f"descent/{name}" for name in CASES}


def merged(disc) -> Colouring:
    """The first two colours made one."""
    right = colour_vertices(disc)
    return Colouring(right.vertex, np.delete(right.ptr, 1))


@pytest.mark.parametrize("name", ["vertex-minimum", "fall"])
def test_neighbours_of_one_colour_are_noticed(monkeypatch, name):
    monkeypatch.setattr(descent, "colour_vertices", merged)
    values = {"mesh": "box", "w": 1.0} | ({"state": "random"} if name == "vertex-minimum" else {})
    result = run_row(Row(CASES[name], values), USE)
    assert result.status is Status.FAIL
    assert result.measurement is not None


class Loose(ExplicitVBD):
    """Relaxed by a hundredth too much."""

    def __init__(self, backend) -> None:
        super().__init__(backend, w=1.01)


def test_another_relaxation_is_noticed(monkeypatch):
    monkeypatch.setattr(descent, "ExplicitVBD", Loose)
    result = run_row(Row(CASES["matrix-sweep"], {"solver": "vbd-explicit", "mesh": "box"}), USE)
    assert result.status is Status.FAIL
    assert result.measurement is not None
