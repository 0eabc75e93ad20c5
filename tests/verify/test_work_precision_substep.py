# SPDX-License-Identifier: BSD-3-Clause
"""One substep, iteration by iteration, of a small beam.

1. Every solver starts from the prediction: its first iterate has the prediction's eps18, an energy gap of 1 and a
   distance of 1. The minimiser has neither gap nor distance, and an eps18 that rounding leaves.
2. With exact steps the energy gap falls from iterate to iterate; Newton's method ends at the minimiser.
3. Times and passes grow; passes are those of the solver alone, one per sweep of block Jacobi.
4. The step may be one in the middle of the motion; what is asked for last is enough: iterations, a share of eps18.
5. Each option makes a request of its own; a solver without steps is refused, a lost motion is a result.
"""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from femgal.scene.load import load_scene, parse_scene
from meshes.errors import InputError
from tests.verify.bench_scenes import beam_file
from verify.work_precision.method import Method
from verify.work_precision.request import substep_request
from verify.work_precision.run_substep import run_substep

SWEEPS = (("substeps", 4), ("blocks", "fresh"))


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    return load_scene(str(beam_file(tmp_path_factory.mktemp("substep"))))


def solve(scene, name, settings=(("substeps", 4),), **options):
    request = substep_request(scene, Method(name, settings, name), 1, "a test", options)
    return run_substep(parse_scene(request.scene, "a test"), request)


@pytest.fixture(scope="module")
def jacobi(beam):
    return solve(beam, "jacobi", (*SWEEPS, ("steps", "exact")), iterations=12, until=0.0)


@pytest.mark.parametrize("name", ["jacobi", "vbd", "newton-pcg", "sgm", "newton-multigrid"])
def test_start_and_end(beam, name):
    settings = (("substeps", 4), ("stepping", "backward-euler"))
    found = solve(beam, name, settings, iterations=3)
    start = found["rows"][0]
    assert start["eps18"] == pytest.approx(found["prediction"]["eps18"], rel=1e-9)
    assert start["gap"] == start["distance"] == found["prediction"]["gap"] == 1.0
    assert found["minimiser"]["gap"] == found["minimiser"]["distance"] == 0.0
    assert found["minimiser"]["eps18"] < 1e-6 * start["eps18"]
    assert found["rows"][-1]["gap"] < 0.9
    assert found["h"] == pytest.approx(1 / 240)


def test_energy_falls(jacobi):
    # Below this share a difference of energies is rounding.
    falling = [row["gap"] for row in jacobi["rows"] if row["gap"] > 1e-8]
    assert len(falling) > 4
    assert all(after < before for before, after in pairwise(falling))
    assert all(math.isfinite(row["eps18"]) for row in jacobi["rows"])


def test_newton_ends_at_the_minimiser(beam):
    rows = solve(beam, "newton-direct", iterations=10, until=1e-10)["rows"]
    assert rows[-1]["distance"] < 1e-7
    assert len(rows) < 10


def test_counts(jacobi):
    rows = jacobi["rows"]
    assert [row["iteration"] for row in rows] == list(range(13))
    for key in ("seconds", "cpu_seconds", "passes"):
        assert all(after[key] > before[key] for before, after in pairwise(rows))
    # A pass with blocks, and one of energies along the correction, which counts a little less.
    assert 1.5 * 12 < rows[-1]["passes"] <= 2.0 * 12
    assert rows[-1]["linear_iterations"] is None


def test_linear_iterations_are_of_this_step(beam):
    rows = solve(beam, "newton-pcg", iterations=2)["rows"]
    assert rows[0]["linear_iterations"] == 0
    assert rows[-1]["linear_iterations"] > 0


def test_enough(beam):
    rows = solve(beam, "jacobi", (*SWEEPS, ("steps", "exact")), iterations=500, until=0.1)["rows"]
    assert rows[-1]["eps18"] <= 0.1 * rows[0]["eps18"] < rows[-2]["eps18"]


def test_later_step(beam, jacobi):
    later = solve(beam, "jacobi", (*SWEEPS, ("steps", "exact")), iterations=2, until=0.0, at_frame=2)
    assert later["rows"][0]["gap"] == 1.0
    assert later["prediction"]["eps18"] != pytest.approx(jacobi["prediction"]["eps18"], rel=0.05)


def test_requests(beam):
    method = Method("jacobi", SWEEPS, "jacobi")
    names = {substep_request(beam, method, 1, "x", {"iterations": count}).name for count in (1, 2, 2)}
    assert len(names) == 2
    with pytest.raises(InputError, match="solves no equation"):
        solve(beam, "verlet", ())
