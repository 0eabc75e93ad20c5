# SPDX-License-Identifier: BSD-3-Clause
"""The cases about preconditioners.

1. No quick row fails, and every preconditioner is asked.
2. They notice one that is not symmetric, one that is not definite, and one that is worth no more than blocks.
"""

from __future__ import annotations

import pytest

from femgal.solvers.preconditioner import LayerBlocks
from verify.cases import preconditioners
from verify.cases.preconditioners import PRECONDITIONERS
from verify.suite.case import Row
from verify.suite.run import Status, choose, run, run_row
from verify.suite.use import Use

USE = Use()
CASES = {row.case.id.split("/")[1]: row.case for row in choose("preconditioners/*")}


def test_quick_rows():
    results = list(run(choose("preconditioners/*", quick=True), USE))
    assert [f"{r.row}: {r.note}" for r in results if r.status is not Status.PASS] == []
    rows = {str(result.row) for result in results}
    for name in ("definite", "iterations"):
        assert {f"preconditioners/{name}[{one}]" for one in PRECONDITIONERS} <= rows
    assert {"preconditioners/galerkin", "preconditioners/domains", "preconditioners/symmetric[mas]"} <= rows


class Spoilt(LayerBlocks):
    """Block Jacobi whose result is changed."""

    def __init__(self, backend, change) -> None:
        super().__init__((backend.vertices,))
        self._change = change

    def apply(self, r):
        return self._change(super().apply(r))


def shifted(z):
    out = z.copy()
    out[1:] += 0.01 * z[:-1]
    return out


def turned(z):
    out = z.copy()
    out[0] *= -1.0
    return out


@pytest.mark.parametrize(
    ("name", "change"),
    [("symmetric", shifted), ("definite", turned), ("formula", shifted), ("iterations", lambda z: z)],
)
def test_what_is_noticed(monkeypatch, name, change):
    monkeypatch.setitem(preconditioners._MAKERS, "layers", lambda backend: Spoilt(backend, change))
    preconditioners._dense.cache_clear()
    result = run_row(Row(CASES[name], {"preconditioner": "layers"}), USE)
    preconditioners._dense.cache_clear()
    assert result.status is Status.FAIL
    assert result.measurement is not None
