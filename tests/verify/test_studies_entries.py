# SPDX-License-Identifier: BSD-3-Clause
"""What a level costs.

1. Of a motion the cost is interpolated on the front of eps18 against seconds; counts are those of the row that is good
   enough; second-order steppings and failed rows have no eps18 that counts, but the former have an error.
2. Of a substep it is that of the first iterate from which on the share is kept; where it is not, the best is told.
"""

from __future__ import annotations

import pytest

from verify.studies.entries import motion_entries, substep_entries


def row(substeps, seconds, eps18, error, **keys):
    counts = {"iterations": 10.0 * substeps, "linear_iterations": None, "passes": 2.0 * seconds}
    base = {"problem": "p", "curve": "c", "solver": "fas", "settings": {}, "status": "done"}
    return base | counts | {"substeps": [substeps] * 2, "seconds": seconds, "eps18": eps18, "error": error} | keys


def found(entries, measure, level):
    return next(entry for entry in entries if entry["measure"] == measure and entry["level"] == level)


def test_motion():
    rows = [row(10, 1.0, 1e-2, 0.5), row(100, 100.0, 1e-4, 0.4)]
    entries = motion_entries(rows, [1e-2, 1e-3, 1e-5], [0.45])
    assert found(entries, "eps18", 1e-2)["seconds"] == 1.0
    assert found(entries, "eps18", 1e-3)["seconds"] == pytest.approx(10.0)
    assert found(entries, "eps18", 1e-3)["passes"] == pytest.approx(20.0)
    assert found(entries, "eps18", 1e-3)["substeps"] == 100
    assert found(entries, "eps18", 1e-3)["iterations"] == 1000.0
    assert found(entries, "eps18", 1e-5)["seconds"] is None
    assert found(entries, "eps18", 1e-5)["best"] == 1e-4
    assert 1.0 < found(entries, "error", 0.45)["seconds"] < 100.0


@pytest.mark.parametrize(
    ("keys", "counts"),
    [
        ({"settings": {"stepping": "bdf2"}}, False),
        ({"solver": "newton-multigrid"}, False),
        ({"solver": "newton-multigrid", "settings": {"stepping": "backward-euler"}}, True),
        ({"solver": "newton-pcg", "linear_iterations": 7.0}, True),
    ],
)
def test_eps18_of_backward_euler_alone(keys, counts):
    entries = motion_entries([row(10, 1.0, 1e-2, 0.5, **keys)], [1e-2], [0.5])
    assert (found(entries, "eps18", 1e-2)["seconds"] == 1.0) is counts
    assert found(entries, "error", 0.5)["seconds"] == 1.0
    assert found(entries, "error", 0.5)["iterations"] == (7.0 if "linear_iterations" in keys else 100.0)


def test_failed_rows_count_for_nothing():
    entries = motion_entries([row(10, 1.0, 1e-2, None, status="failed")], [1e-2], [0.5])
    assert [entry["seconds"] for entry in entries] == [None, None]
    assert [entry["best"] for entry in entries] == [None, None]


def trace(shares, distances=None):
    iterates = [
        {"iteration": k, "seconds": 2.0 * k, "cpu_seconds": 1.0 * k, "passes": 3.0 * k, "eps18": s, "distance": d}
        for k, (s, d) in enumerate(zip(shares, distances or shares, strict=True))
    ]
    return {"problem": "p", "curve": "c", "prediction": {"eps18": 1.0, "distance": 1.0}, "iterates": iterates}


def test_substep():
    given = [trace([2.0, 0.05, 0.2, 0.08, 0.01], [1.0, 0.9, 0.8, 0.7, 0.6])]
    entries = substep_entries(given, [0.1, 0.001], [0.9], "cpu")
    assert [found(entries, "eps18", 0.1)[key] for key in ("iterations", "seconds", "passes")] == [3, 3.0, 9.0]
    assert found(entries, "eps18", 0.001)["seconds"] is None
    assert found(entries, "eps18", 0.001)["best"] == 0.01
    assert found(entries, "error", 0.9)["iterations"] == 1
    assert found(substep_entries(given, [0.1], [0.9], "wall"), "eps18", 0.1)["seconds"] == 6.0


def test_lost_iterates_and_none_at_all():
    lost = substep_entries([trace([1.0, 0.01, None])], [0.1], [0.1], "cpu")
    assert found(lost, "eps18", 0.1)["seconds"] is None
    nothing = substep_entries([{**trace([]), "prediction": None}], [0.1], [0.1], "cpu")
    assert found(nothing, "eps18", 0.1)["seconds"] is None
    assert found(nothing, "eps18", 0.1)["best"] is None
