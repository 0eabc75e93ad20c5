# SPDX-License-Identifier: BSD-3-Clause
"""The command line as a person meets it, in processes of their own.

1. `femgal run` writes a series, a log and a checkpoint under --out, nothing elsewhere, and exits 0.
2. Every kind of bad input ends with exit code 2 and one message that says where, what was found and what is allowed,
   and leaves no output folder behind.
3. A run that fails ends with exit code 3, one message, and its good frames.
4. Ctrl-C ends with exit code 130 and a checkpoint; --resume goes on bit for bit.
5. kill -9 at any moment leaves a readable series and a valid log, and --resume ends bit for bit like a run that was
   not killed.
6. `femgal run` refuses a folder that holds a run, unless told to resume.
7. The scene that `femgal scenes --show` prints runs as it is.
8. `femgal plan` prints stages that run and stages that are skipped, as a table and as JSON.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from femgal import read_run
from femgal.scene import builtin
from tests.femgal.scenes import hanging_beam_text

FEMGAL = (sys.executable, "-m", "femgal.cli")


def femgal(*arguments, cwd, timeout=300):
    return subprocess.run([*FEMGAL, *map(str, arguments)], cwd=cwd, capture_output=True, text=True, timeout=timeout)


@pytest.fixture
def scene_file(tmp_path):
    path = tmp_path / "beam.toml"
    path.write_text(hanging_beam_text())
    return path


def test_run_writes_only_below_out(tmp_path, scene_file):
    result = femgal("run", scene_file, "--out", "out", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"beam.toml", "out"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "frames.vtkhdf",
        "run.json",
        "scene.toml",
        "checkpoint.h5",
    }
    assert "frame 6" in result.stderr
    assert "7 frames" in result.stdout


def test_options_change_the_scene(tmp_path, scene_file):
    options = ("--frames", 2, "--solver", "jacobi", "--substeps", 3, "--set", "bodies.0.rho=500", "--fields", "J")
    result = femgal("run", scene_file, "--out", "out", *options, "--format", "vtu", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    scene = json.loads((tmp_path / "out" / "run.json").read_text())["scene"]
    assert (scene["frames"], scene["solver"]["name"], scene["solver"]["substeps"]) == (2, "jacobi", 3)
    assert (scene["bodies"][0]["rho"], scene["output"]["fields"]) == (500.0, ["J"])
    assert (tmp_path / "out" / "frames.pvd").is_file()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--set", "bodies.0.youngs=1"], ["bodies[0].youngs", "unknown"]),
        (["--set", "bodies.0.E=-1"], ["bodies[0].E", "-1", "0 < E"]),
        (["--set", "bodies.0.E=0"], ["bodies[0].E", "0 < E"]),
        (["--set", "bodies.0.nu=0.5"], ["bodies[0].nu", "0.5", "-1 < nu < 0.5"]),
        (["--set", "bodies.0.nu=-1"], ["bodies[0].nu", "-1 < nu < 0.5"]),
        (["--set", "bodies.0.rho=0"], ["bodies[0].rho", "0 < rho"]),
        (["--set", "bodies.0.mesh=unicorn"], ["unicorn", "rabbit"]),
        (["--set", "bodies.0.mesh=missing.ply"], ["missing.ply"]),
        (["--set", "constraints.0.where.halfspace.point=[-9,0,0]"], ["constraints[0]", "selects no"]),
        (["--solver", "magic"], ["solver.name", "magic", "fas"]),
        (["--fields", "temperature"], ["output.fields", "temperature", "von_mises"]),
        (["--solver", "verlet", "--fields", "residual"], ["residual", "explicit"]),
        (["--format", "xdmf"], ["output.format", "xdmf", "vtkhdf"]),
        (["--frames", "0"], ["--frames", "0"]),
        (["--set", "nonsense"], ["nonsense", "KEY=VALUE"]),
    ],
)
def test_bad_input_is_exit_code_2(tmp_path, scene_file, arguments, expected):
    result = femgal("run", scene_file, "--out", "out", *arguments, cwd=tmp_path)
    assert result.returncode == 2, result.stderr
    assert "Traceback" not in result.stderr
    for text in expected:
        assert text in result.stderr, (text, result.stderr)
    assert not (tmp_path / "out").exists()


def test_unknown_scene_lists_the_known_ones(tmp_path):
    result = femgal("run", "rabit-drape", "--out", "out", cwd=tmp_path)
    assert result.returncode == 2
    assert "rabbit-drape" in result.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("folder", ["beam.toml", "beam.toml/out", "/proc/out"])
def test_unwritable_folder_is_exit_code_2(tmp_path, scene_file, folder):
    result = femgal("run", scene_file, "--out", folder, cwd=tmp_path)
    assert result.returncode == 2, result.stderr
    assert "Traceback" not in result.stderr
    assert "folder" in result.stderr
    assert scene_file.read_text() == hanging_beam_text()


def test_an_earlier_run_is_not_overwritten(tmp_path, scene_file):
    assert femgal("run", scene_file, "--out", "out", "--frames", 1, cwd=tmp_path).returncode == 0
    before = (tmp_path / "out" / "run.json").read_bytes()
    result = femgal("run", scene_file, "--out", "out", cwd=tmp_path)
    assert result.returncode == 2
    assert "--resume" in result.stderr
    assert (tmp_path / "out" / "run.json").read_bytes() == before


def test_failed_run_is_exit_code_3(tmp_path, scene_file):
    wild = ("--set", "solver.steps=[1.9,1.9]", "--solver", "jacobi", "--iterations", 8, "--substeps", 2)
    result = femgal("run", scene_file, "--out", "out", "--frames", 30, *wild, cwd=tmp_path)
    assert result.returncode == 3
    assert "Traceback" not in result.stderr
    for text in ("frame", "energy", "do:", "kept"):
        assert text in result.stderr
    log = json.loads((tmp_path / "out" / "run.json").read_text())
    assert log["status"] == "failed"
    assert len(read_run(tmp_path / "out").times) == len(log["frames"]) >= 1


@pytest.fixture
def long_scene(tmp_path):
    path = tmp_path / "long.toml"
    path.write_text(hanging_beam_text(frames=40, solver_lines="substeps = 20", checkpoint_every=3))
    return path


def started(arguments, cwd, frames, log):
    """Start a run and wait until its log holds some frames."""
    process = subprocess.Popen([*FEMGAL, *map(str, arguments)], cwd=cwd, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline and process.poll() is None:
        if log.is_file() and len(json.loads(log.read_text())["frames"]) >= frames:
            return process
        time.sleep(0.01)
    process.kill()
    raise AssertionError(f"run ended or hung early: {process.communicate()[1]}")


def assert_same_run(a, b):
    a, b = read_run(a), read_run(b)
    np.testing.assert_array_equal(a.times, b.times)
    for frame in range(len(a.times)):
        for name in ("displacement", "velocity"):
            np.testing.assert_array_equal(a.point_data(name, frame), b.point_data(name, frame))


def test_interrupt_and_resume(tmp_path, long_scene):
    arguments = ("run", long_scene, "--out", "parts")
    process = started(arguments, tmp_path, 2, tmp_path / "parts" / "run.json")
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=300)
    assert process.returncode == 130, stderr
    assert "femgal run --out" in stderr
    # The folder knows its scene.
    assert femgal("run", "--out", "parts", "--resume", cwd=tmp_path).returncode == 0
    again = femgal("run", "--out", "parts", "--resume", cwd=tmp_path)
    assert "all 40 frames are there" in again.stdout
    assert femgal("run", long_scene, "--out", "whole", cwd=tmp_path).returncode == 0
    assert_same_run(tmp_path / "whole", tmp_path / "parts")


def test_kill_and_resume(tmp_path, long_scene):
    whole = femgal("run", long_scene, "--out", "whole", cwd=tmp_path)
    assert whole.returncode == 0, whole.stderr
    arguments = ("run", long_scene, "--out", "parts")
    for number, frames in enumerate((1, 7, 16, 28)):
        resume = ("--resume",) if number else ()
        process = started((*arguments, *resume), tmp_path, frames, tmp_path / "parts" / "run.json")
        process.kill()
        process.communicate()
        found = read_run(tmp_path / "parts")
        assert len(found.times) >= 1
        for frame in range(len(found.times)):
            assert np.isfinite(found.displacement(frame)).all()
        assert json.loads((tmp_path / "parts" / "run.json").read_text())["status"] == "running"
    result = femgal(*arguments, "--resume", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert_same_run(tmp_path / "whole", tmp_path / "parts")


@pytest.mark.parametrize("name", builtin.names())
def test_shown_scenes_run_as_they_are(tmp_path, name, real_surface):
    if name.startswith("bunny"):
        real_surface("bunny")
    shown = femgal("scenes", "--show", name, cwd=tmp_path)
    (tmp_path / "scene.toml").write_text(shown.stdout)
    options = ("--vertices", 600, "--frames", 1, "--substeps", 5)
    result = femgal("run", "scene.toml", "--out", "out", *options, cwd=tmp_path)
    assert result.returncode == 0, result.stderr


def test_plan_prints_what_is_skipped(tmp_path, scene_file):
    table = femgal("plan", scene_file, cwd=tmp_path)
    assert table.returncode == 0, table.stderr
    for text in ("skipped", "damping", "interior of layer 1", "passes per substep"):
        assert text in table.stdout
    content = json.loads(femgal("plan", scene_file, "--json", cwd=tmp_path).stdout)
    assert {stage["name"]: stage["runs"] for stage in content["stages"]}["damping"] is False
    assert content["substeps"] == 10
