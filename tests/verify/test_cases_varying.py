# SPDX-License-Identifier: BSD-3-Clause
"""The cases about steps of varying lengths; `test_cases_stepping` runs their quick rows with all others of the topic.

1. They are among the quick rows.
2. A formula that takes all steps for equal ones is noticed, by its order and against the reference.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.timestep import bdf2
from verify.suite.case import Row
from verify.suite.run import Status, choose, run_row
from verify.suite.use import Use

USE = Use()
CASES = {row.case.id: row.case for row in choose("stepping/*")}


def test_quick_rows():
    rows = {str(row) for row in choose("stepping/*", quick=True)}
    assert {f"stepping/varying-steps[{one},alternating,driven]" for one in ("fas-bdf2", "newton-multigrid")} <= rows
    assert {f"stepping/formula[{one}]" for one in ("fas-bdf2", "newton-multigrid")} <= rows


@pytest.mark.parametrize(
    ("name", "more"), [("formula", {}), ("varying-steps", {"steps": "alternating", "ends": "held"})]
)
def test_equal_steps_are_noticed(monkeypatch, name, more):
    right = bdf2.BDF2.past

    def equal(self, state, h):
        memory = state.memory
        if "h_before" in memory:
            state = type(state)(**vars(state) | {"memory": memory | {"h_before": np.array([h])}})
        return right(self, state, h)

    monkeypatch.setattr(bdf2.BDF2, "past", equal)
    result = run_row(Row(CASES[f"stepping/{name}"], {"solver": "newton-multigrid-bdf2"} | more), USE)
    assert result.status is Status.FAIL
    assert result.measurement is not None
