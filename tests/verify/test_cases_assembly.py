# SPDX-License-Identifier: BSD-3-Clause
"""The cases about assembled Hessians.

1. No quick row fails.
2. They notice a matrix that is wrong in a single block, and one whose negative parts were left in.
"""

from __future__ import annotations

import pytest

from verify.cases import assembly
from verify.suite.case import Row
from verify.suite.run import Status, choose, run, run_row
from verify.suite.use import Use

USE = Use()
CASES = {row.case.id: row.case for row in choose("assembly/*")}


def test_quick_rows():
    results = list(run(choose("assembly/*", quick=True), USE))
    assert [f"{r.row}: {r.note}" for r in results if r.status is not Status.PASS] == []
    assert len(results) == 2


def one_block_wrong(made):
    made.values[7] *= 1.0 + 1e-6
    return made


@pytest.mark.parametrize(("name", "forced"), [("hessian", {}), ("definite", {}), ("definite", {"definite": False})])
def test_what_is_noticed(monkeypatch, name, forced):
    right = assembly.assemble

    def changed(*arguments, **settings):
        made = right(*arguments, **settings | forced)
        return made if forced else one_block_wrong(made)

    monkeypatch.setattr(assembly, "assemble", changed)
    result = run_row(Row(CASES[f"assembly/{name}"], {"mesh": "box", "precision": "float64"}), USE)
    assert result.status is Status.FAIL
    assert result.measurement is not None
