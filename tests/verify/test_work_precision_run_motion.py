# SPDX-License-Identifier: BSD-3-Clause
"""One measured motion.

1. A pilot that nothing came of is counted with the first frame, by kind, and with no other.
2. The frames of a pilot that the run begins with are measured as any others: nothing is free, nothing counts twice.
"""

from __future__ import annotations

import pytest

from femgal import choice
from femgal.choice import with_solver
from femgal.scene.write import scene_to_toml
from femgal.simulation import Simulation
from tests.femgal.test_choice import SLOW, beams
from verify.work_precision.request import Request
from verify.work_precision.run_motion import run_motion

FRAMES = 14


def rows(scene):
    numbers, _ = run_motion(scene, Request("motion", "a test", scene_to_toml(scene)))
    assert numbers["failure"] is None
    return numbers["rows"], numbers["choice"] and numbers["choice"]["solver"]


def passes(row):
    return row["passes_by_kind"]


def test_a_pilot_given_up_is_counted(monkeypatch):
    monkeypatch.setattr(choice, "MOST_PILOT_SHARE", 1e-3)
    scene = beams(frames=FRAMES, **SLOW)
    wasted = Simulation.prepare(scene).choice.wasted_passes
    assert sum(wasted.values()) > 0.0
    (first, *others), chosen = rows(scene)
    (first_alone, *others_alone), _ = rows(with_solver(scene, "verlet"))
    assert chosen == "verlet"
    assert passes(first) == pytest.approx({kind: n + wasted[kind] for kind, n in passes(first_alone).items()})
    assert first["passes"] == pytest.approx(first_alone["passes"] + sum(wasted.values()))
    assert [passes(row) for row in others] == [passes(row) for row in others_alone]
    assert len(others) == FRAMES - 1


def test_the_frames_of_a_pilot_are_measured():
    scene = beams(frames=FRAMES, **SLOW)
    found, chosen = rows(scene)
    alone, _ = rows(with_solver(scene, "newton-multigrid"))
    assert chosen == "newton-multigrid"
    assert [passes(row) for row in found] == [passes(row) for row in alone]
    assert [row["iterations"] for row in found] == [row["iterations"] for row in alone]
    assert min(row["iterations"] for row in found) > 0
