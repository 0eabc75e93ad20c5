# SPDX-License-Identifier: BSD-3-Clause
"""Cases of waves in time.

1. Every quick row passes, and both methods, both waves and both precisions are among them.
2. A time step that is off by a thousandth, and a mass that is, are noticed.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from verify.cases import exact_waves
from verify.suite.run import Status, choose, run_row
from verify.suite.use import Use

NAMES = ("wave-verlet", "wave-backward-euler", "wave-damping", "wave-phase", "any-body-verlet", "time-order")
NAMES += ("any-body-backward-euler",)
ROWS = choose(" ".join(f"exact/{name}" for name in NAMES), quick=True)
USE = Use(threads=1)


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_quick_rows(row):
    result = run_row(row, USE)
    assert result.status is Status.PASS, result


def test_quick_rows_are_there():
    names = {str(row) for row in ROWS}
    for wave in ("longitudinal", "shear"):
        assert f"exact/wave-verlet[{wave},float32]" in names
        assert f"exact/wave-backward-euler[{wave},fas,float64]" in names
    assert {"exact/time-order[verlet]", "exact/time-order[backward-euler]", "exact/any-body-verlet[box]"} <= names


class HeavyUse(Use):
    """Makes passes for a body that is too heavy by a thousandth."""

    def backend(self, disc, precision="float64"):
        return super().backend(replace(disc, mass=1.001 * disc.mass), precision)


def test_wrong_mass_is_noticed():
    wrong = HeavyUse(threads=1)
    assert exact_waves.wave_verlet(wrong, wave="shear", precision="float32").error > 1e-3
    assert exact_waves.wave_phase(wrong, wave="longitudinal").error > 1e-4
    assert exact_waves.any_body_verlet(wrong, mesh="box").error > 1e-6


def test_wrong_step_is_noticed(monkeypatch):
    right = exact_waves.motion

    def hurried(stepper, start, h, steps):
        return right(stepper, start, 1.001 * h, steps)

    monkeypatch.setattr(exact_waves, "motion", hurried)
    exact_waves._backward_euler.cache_clear()
    damping = exact_waves.wave_damping(USE, wave="longitudinal")
    exact_waves._backward_euler.cache_clear()
    assert damping.error > 1e-5
