# SPDX-License-Identifier: BSD-3-Clause
"""The search for a spacing.

1. `spacing_for` inverts `vertices_at`.
2. On a body that follows the model with another layer density the third count is within tolerance / 5.
3. On counts that jump, the scan returns the nearest trial it met.
"""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from meshes.generators import icosphere
from meshes.stuffing.spacing import nearest_trial, spacing_for, surface_area, vertices_at


@dataclass(frozen=True)
class Trial:
    """A count without a mesh."""

    vertices: int


@pytest.mark.parametrize("vertices", [10, 1000, 10**7])
@pytest.mark.parametrize("layer", [0.0, 0.3, 20.0])
def test_inverse(vertices, layer):
    assert vertices_at(spacing_for(vertices, 0.7, layer), 0.7, layer) == pytest.approx(vertices, rel=1e-9)


def test_area_of_a_sphere():
    assert surface_area(icosphere(5, radius=1.0)) == pytest.approx(12.566, rel=2e-3)


@pytest.mark.parametrize("density", [0.0, 0.8, 2.0])
def test_few_counts_are_enough(density):
    tried = []

    def attempt(spacing: float, placement: int) -> Trial:
        assert placement == 0
        tried.append(spacing)
        return Trial(round(vertices_at(spacing, 1.0, density * 6.0)))

    trial = nearest_trial(attempt, 20_000, 1.0, 6.0, 0.05)
    assert trial.vertices == pytest.approx(20_000, rel=0.01)
    assert len(tried) <= 3


def test_jumps_are_scanned():
    trial = nearest_trial(lambda spacing, _: Trial(100 if spacing > 0.25 else 160), 150, 1.0, 6.0, 0.05)
    assert trial.vertices == 160
