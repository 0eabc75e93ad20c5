# SPDX-License-Identifier: BSD-3-Clause
"""The choice of a solver for an accuracy.

1. Where velocity Verlet needs few substeps it is chosen without a pilot; nothing but its stable step is computed.
2. A stiff body that is moved slowly is given to Newton's method; the reason names both costs.
3. The choice is the same every time, and the simulation of a chosen solver is that of the solver named.
4. A pilot whose first frame costs too much is given up for Verlet; one that ends later counts as far as it came.
5. What a pilot's frames let expect: as much again for errors that stay and are right, less for errors that have room,
   more for those that grow.
6. What a pilot has solved is not solved again: the run begins with its frames, and every bit is that of a run without.
7. A mesh or material that would need more substeps than any run can make is refused, with the number.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal import choice
from femgal.choice import choose, expected_cost, with_solver
from femgal.kernels.backend import Passes
from femgal.scene.load import load_scene
from femgal.simulation import Simulation
from femgal.timestep.control import AIM
from meshes.errors import InputError

SLOW = {"constraints.1.path": {"times": [0.0, 10.0], "offsets": [[0, 0, 0], [1.5, 0, 0]]}}
SLOW |= {f"bodies.{body}.E": 1e10 for body in range(4)}


def beams(accuracy="5%", frames=10, **changes):
    overrides = {"solver.name": "auto", "solver.accuracy": accuracy, "solver.threads": 1, **changes}
    return load_scene("beam-stretch", vertices=60, frames=frames, overrides=overrides)


def test_few_substeps_need_no_pilot(monkeypatch):
    monkeypatch.setattr(choice, "_fly", None)
    simulation = Simulation.prepare(beams())
    assert (simulation.scene.solver.name, simulation.choice.solver) == ("verlet", "verlet")
    assert simulation.scene.solver.accuracy == 0.05
    assert simulation.choice.newton_cost is None
    assert f"stable with {simulation.choice.substeps} substeps" in str(simulation.choice)


def test_stiff_and_slow():
    scene = beams(frames=40, **SLOW)
    first, second = Simulation.prepare(scene), Simulation.prepare(scene)
    assert first.choice == second.choice
    found = first.choice
    assert found.solver == first.scene.solver.name == "newton-multigrid"
    assert found.newton_cost < found.verlet_cost
    assert f"{found.newton_cost:.0f}" in found.reason
    assert f"{found.verlet_cost:.0f}" in found.reason
    named = Simulation.prepare(with_solver(scene, "newton-multigrid"))
    assert named.fingerprint == first.fingerprint == second.fingerprint


def test_the_frames_of_a_pilot_are_the_first_of_the_run():
    scene = beams(frames=14, **SLOW)
    chosen, named = Simulation.prepare(scene), Simulation.prepare(with_solver(scene, "newton-multigrid"))
    solved = list(chosen.solved)
    assert [frame.index for frame in solved] == list(range(len(solved)))
    assert choice.FEWEST_FRAMES < len(solved) < 14
    substeps = []
    frames = list(chosen.frames(on_substep=lambda substep, of: substeps.append(substep) or True))
    assert frames[: len(solved)] == solved
    assert len(substeps) == sum(frame.row["substeps"] for frame in frames[len(solved) :])
    alone = list(named.frames())
    assert len(frames) == len(alone) == 15
    for one, other in zip(frames, alone, strict=True):
        np.testing.assert_array_equal(one.state.x, other.state.x)
        np.testing.assert_array_equal(one.state.v, other.state.v)
        assert one.row["substeps"] == other.row["substeps"]
        assert one.guard == other.guard
    assert chosen.plan.substeps == chosen.choice.substeps == solved[1].row["substeps"]
    # Only once: who asks again has them solved, by the same simulation.
    for again, one in zip(chosen.frames(), solved, strict=False):
        assert again is not one
        np.testing.assert_array_equal(again.state.x, one.state.x)
        assert again.guard == one.guard


def test_a_pilot_may_be_given_up(monkeypatch):
    monkeypatch.setattr(choice, "MOST_PILOT_SHARE", 1e-3)
    found = Simulation.prepare(beams(frames=40, **SLOW)).choice
    assert (found.solver, found.newton_cost) == ("verlet", None)
    assert sum(found.wasted_passes.values()) > 0.0
    assert found.wasted_seconds > 0.0


def test_a_pilot_that_fails_has_cost_what_it_took(monkeypatch):
    monkeypatch.setattr("femgal.diagnostics.EnergyGuard.complaint", lambda self, energies: "too much")
    found = Simulation.prepare(beams(frames=40, **SLOW)).choice
    assert (found.solver, found.newton_cost) == ("verlet", None)
    assert sum(found.wasted_passes.values()) > 0.0


def test_what_a_pilot_expects():
    def expected(R, S=8):
        rows = [dict(substeps=S, estimated_error=r, passes=100.0, retakes=0) for r in R]
        return expected_cost(rows, 40, 0.01) / (choice.UNSEEN * choice.COST_OF_NEWTON_PASS)

    steady = [AIM * 0.01] * 5
    assert expected(steady) == pytest.approx(100.0)
    assert expected([r / 4.0 for r in steady]) == pytest.approx(100.0 * 0.25 ** (choice.COST_POWER / 1.5))
    assert expected([1e-3 * k for k in range(1, 6)]) > expected([5e-3] * 5)
    assert expected([1e-9] * 5, S=1) == pytest.approx(100.0)
    assert expected([0.0] * 5) == pytest.approx(100.0)


def test_a_pilot_that_ends_early_counts_as_far_as_it_came(monkeypatch):
    monkeypatch.setattr(choice, "FEWEST_FRAMES", 1000)
    monkeypatch.setattr(choice, "MOST_PILOT_SHARE", 0.05)
    seen = []
    monkeypatch.setattr(choice, "expected_cost", lambda rows, *rest: seen.append(len(rows)) or 1.0)
    found = Simulation.prepare(beams(frames=40, **SLOW)).choice
    assert 1 <= max(seen) < 40
    assert (found.solver, found.newton_cost) == ("newton-multigrid", 1.0)


def test_too_many_substeps(monkeypatch):
    monkeypatch.setattr(choice, "_fly", lambda simulation, most: choice._Pilot([], None, Passes()))
    scene = beams(frames=1, **{f"bodies.{body}.E": 1e18 for body in range(4)})
    with pytest.raises(InputError, match="cannot be kept") as error:
        choose(scene, lambda candidate: Simulation.prepare(candidate))
    assert "substeps a frame" in str(error.value)
