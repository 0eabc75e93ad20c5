# SPDX-License-Identifier: BSD-3-Clause
"""Runs with an accuracy.

1. A run that was stopped and resumed ends bit for bit like one that was not, with each of the controlled solvers,
   given by name or chosen; the sums of its control are in the checkpoint. Nor does it matter where a pilot ended.
2. The log says what was asked for, what was chosen, and each frame's estimated error; the command says them at the end.
3. An accuracy that is not kept is said not to be.
"""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from click.testing import CliRunner

from femgal.cli import main
from femgal.runner import Progress, run
from tests.femgal.scenes import hanging_beam, hanging_beam_text
from tests.femgal.test_choice import SLOW, beams


class StopAt(Progress):
    """Interrupts a run after a frame."""

    def __init__(self, frame):
        self.target = frame

    def frame(self, row):
        if row["frame"] == self.target:
            raise KeyboardInterrupt


@pytest.mark.parametrize("solver", ["newton-multigrid", "verlet", "auto"])
def test_resumed_bit_for_bit(tmp_path, solver):
    scene = hanging_beam(frames=4, solver=solver, solver_lines='accuracy = "2%"')
    whole = run(scene, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        run(scene, tmp_path / "parts", progress=StopAt(2))
    # The scene in the folder names the solver that was chosen; the scene itself chooses the same again.
    resumed = run(scene if solver != "auto" else tmp_path / "parts" / "scene.toml", tmp_path / "parts", resume=True)
    assert [row["frame"] for row in resumed.rows] == [3, 4]
    np.testing.assert_array_equal(whole.state.x, resumed.state.x)
    assert whole.state.memory.keys() == resumed.state.memory.keys()
    for name, array in whole.state.memory.items():
        np.testing.assert_array_equal(array, resumed.state.memory[name])
    assert 0.0 < whole.estimated_error == resumed.estimated_error <= 0.02


@pytest.mark.parametrize("stop", [2, 7])
def test_resumed_among_the_frames_of_a_pilot_and_after_them(tmp_path, stop):
    scene = beams(frames=10, **SLOW)
    whole = run(scene, tmp_path / "whole")
    assert whole.simulation.scene.solver.name == "newton-multigrid"
    with pytest.raises(KeyboardInterrupt):
        run(scene, tmp_path / "parts", progress=StopAt(stop))
    resumed = run(tmp_path / "parts" / "scene.toml", tmp_path / "parts", resume=True)
    np.testing.assert_array_equal(whole.state.x, resumed.state.x)
    np.testing.assert_array_equal(whole.state.v, resumed.state.v)
    for name, array in whole.state.memory.items():
        np.testing.assert_array_equal(array, resumed.state.memory[name])


def test_what_a_run_says(tmp_path):
    (tmp_path / "my.toml").write_text(hanging_beam_text(frames=2))
    arguments = ["run", str(tmp_path / "my.toml"), "--accuracy", "1%", "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    assert re.search(r"estimated trajectory error [\d.e-]+% \(asked: 1%\)$", result.stdout.strip())
    assert re.search(r"chosen: verlet: .*substeps a frame", result.stderr)
    log = json.loads((tmp_path / "out" / "run.json").read_text())
    assert (log["accuracy"], log["choice"]["solver"]) == (0.01, "verlet")
    assert [row["estimated_error"] == 0.0 for row in log["frames"]] == [True, False, False]
    assert log["frames"][-1]["estimated_error"] <= 0.01


def test_a_promise_that_is_not_kept(tmp_path, monkeypatch):
    monkeypatch.setattr("femgal.timestep.control.MOST_SUBSTEPS", 2)
    (tmp_path / "my.toml").write_text(hanging_beam_text(frames=1))
    arguments = ["run", str(tmp_path / "my.toml"), "--accuracy", "0.1%", "--solver", "newton-multigrid"]
    result = CliRunner().invoke(main, [*arguments, "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    assert "(asked: 0.1%) - not kept" in result.stdout
