# SPDX-License-Identifier: BSD-3-Clause
"""Whole runs through the Python interface.

1. A run writes every frame; series, run log and state agree, and vtk's own reader finds the frames.
2. Without a folder, nothing is written and the displacements are in the result.
3. A run stopped at any frame and resumed ends bit for bit like one that was not stopped: every solver, both formats,
   with prescribed motion, and when the last frames after the checkpoint had been written already.
4. A run killed before its first checkpoint begins again when resumed.
5. A motion that runs away ends as a failed run: good frames kept, no NaN in any file, and the failure names frame,
   layer and last energies.
6. A run that loses its disk ends as a failed run with the frames before; any other error closes its files too.
7. Asked to stop, a run saves a checkpoint of the last frame and says so in the log.
8. A checkpoint of another scene, a series of other output settings, and a second run in the same folder are refused,
   and the folder stays as it was.
9. A finished run can be made longer.
10. Where the device works on while the host writes, a frame is written after the last substep of the next one has been
    asked for, and the files are the same; so they are when the run is stopped, or fails, in between.
"""

from __future__ import annotations

import json
import os
import signal

import numpy as np
import pytest

from femgal import read_run
from femgal.kernels.cpu.node_work import NodeWork
from femgal.output import vtkhdf
from femgal.runner import Progress, run
from femgal.scene.load import load_scene
from meshes.errors import InputError
from tests.femgal.scenes import hanging_beam

PULL = "path = {times = [0.0, 0.05, 0.2], offsets = [[0, 0, 0], [0.1, 0, 0], [0.1, 0, 0]]}"


def log_of(folder):
    return json.loads((folder / "run.json").read_text())


def test_a_run_writes_what_it_computed(tmp_path):
    result = run(hanging_beam(), tmp_path / "out")
    assert result.status == "finished"
    log, written = log_of(tmp_path / "out"), read_run(tmp_path / "out")
    assert [row["frame"] for row in log["frames"]] == list(range(7))
    assert log["status"] == "finished"
    np.testing.assert_allclose(written.times, np.arange(7) / 60.0, rtol=1e-12)
    X, x = result.simulation.world.mesh.points, result.state.x
    np.testing.assert_allclose(written.displacement(6), x - X, atol=1e-7)
    for row in log["frames"][1:]:
        assert row["passes"] == pytest.approx(sum(row["passes_by_kind"].values()))
        total = row["kinetic_energy"] + row["elastic_energy"] + row["potential_energy"]
        assert row["total_energy"] == pytest.approx(total)
        assert 0.0 < row["eps18"] < 1e-3
        assert row["min_J"] > 0.0
    assert log["mesh"]["bodies"][0]["name"] == "beam"
    assert log["mesh"]["sha256"] == result.simulation.world.mesh.content_hash


def test_the_material_field_numbers_what_differs(tmp_path):
    soft = {"where": {"halfspace": {"point": [0.5, 0, 0], "normal": [1, 0, 0]}, "relative": True}, "E": 1e4}
    scene = load_scene("beam-stretch", vertices=250, frames=1, overrides={"bodies.0.regions": [soft]})
    scene = scene.model_copy(
        update={"output": scene.output.model_copy(update={"fields": ("displacement", "material")})}
    )
    world = run(scene, tmp_path / "out").simulation.world
    material = read_run(tmp_path / "out").cell_data("material", 1)
    moduli = {(m, *row) for m, row in zip(material, np.stack([world.E, world.nu, world.rho], axis=1), strict=True)}
    # Four beams of different nu, one of them with a soft half.
    assert len(moduli) == len(set(material)) == 5


def test_vtk_reads_every_step(tmp_path):
    vtk = pytest.importorskip("vtkmodules.vtkIOHDF")
    from vtkmodules.util.numpy_support import vtk_to_numpy

    run(hanging_beam(frames=3), tmp_path / "out")
    written, reader = read_run(tmp_path / "out"), vtk.vtkHDFReader()
    reader.SetFileName(str(tmp_path / "out" / "frames.vtkhdf"))
    reader.UpdateInformation()
    assert reader.GetNumberOfSteps() == 4
    for step in range(4):
        reader.SetStep(step)
        reader.Update()
        grid = reader.GetOutputDataObject(0)
        moved = vtk_to_numpy(grid.GetPointData().GetArray("displacement"))
        np.testing.assert_allclose(moved, written.displacement(step), atol=0)
        assert grid.GetNumberOfCells() == len(written.cells)


def test_without_a_folder_nothing_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run(hanging_beam(frames=2))
    assert len(result.displacements) == 3
    assert list(tmp_path.iterdir()) == []
    np.testing.assert_array_equal(result.displacements[0], 0.0)
    assert np.abs(result.displacements[2]).max() > 1e-3


class StopAfter(Progress):
    """Sends this process the signal of Ctrl-C in the middle of the frame after a given one."""

    def __init__(self, frame):
        self.last = -1
        self.target = frame

    def frame(self, row):
        self.last = row["frame"]

    def substep(self, substep, substeps):
        if self.last == self.target and substep == max(1, substeps // 2):
            os.kill(os.getpid(), signal.SIGINT)


VARIANTS = [
    {"solver": "fas"},
    {"solver": "fas", "solver_lines": "substeps = 5\niterations = 2\nsteps = [0.5, 0.7]", "format": "vtu"},
    {"solver": "jacobi", "path": PULL},
    {"solver": "scalar-jacobi"},
    {"solver": "verlet", "solver_lines": ""},
    {"solver": "verlet", "solver_lines": "", "path": PULL},
    {"solver": "fas", "solver_lines": 'substeps = 5\nsteps = "exact"', "path": PULL},
    {"solver": "fas", "solver_lines": 'substeps = 3\ncycle = "V"\nsteps = "backtracking"'},
    {"solver": "fas", "solver_lines": 'substeps = 3\nsteps = "spectral"\niterations = 3\nchebyshev = "auto"'},
    {"solver": "jacobi", "solver_lines": 'substeps = 3\niterations = 3\nchebyshev = "auto"', "path": PULL},
]


@pytest.mark.parametrize("options", VARIANTS)
def test_interrupted_and_resumed_is_bitwise_the_same(tmp_path, options):
    scene = hanging_beam(**options)
    whole = run(scene, tmp_path / "whole")
    stopped = run(scene, tmp_path / "parts", progress=StopAfter(3), signals=True)
    assert stopped.status == "interrupted"
    assert log_of(tmp_path / "parts")["status"] == "interrupted"
    assert stopped.rows[-1]["frame"] == 3
    resumed = run(scene, tmp_path / "parts", resume=True)
    assert [row["frame"] for row in resumed.rows] == [4, 5, 6]
    np.testing.assert_array_equal(resumed.state.x, whole.state.x)
    np.testing.assert_array_equal(resumed.state.v, whole.state.v)
    guard = whole.simulation.guard.memory()
    assert resumed.simulation.guard.memory() == guard
    assert guard["last"]["kinetic"] == whole.rows[-1]["kinetic_energy"]
    assert (guard["injected"] > 0.0) == ("path" in options)
    a, b = read_run(tmp_path / "whole"), read_run(tmp_path / "parts")
    np.testing.assert_array_equal(a.times, b.times)
    for frame in range(7):
        for name in ("displacement", "velocity"):
            np.testing.assert_array_equal(a.point_data(name, frame), b.point_data(name, frame))
        np.testing.assert_array_equal(a.cell_data("von_mises", frame), b.cell_data("von_mises", frame))
    keys = ("frame", "time", "passes", "eps18", "total_energy", "min_J", "substeps")
    rows = [[{k: row[k] for k in keys} for row in log_of(tmp_path / f)["frames"]] for f in ("whole", "parts")]
    assert rows[0] == rows[1]


@pytest.fixture
def runs_ahead(monkeypatch):
    monkeypatch.setattr(NodeWork, "runs_ahead", property(lambda self: True))


class Told(Progress):
    """What was told, in its order; stops in the frame after a given one."""

    def __init__(self, target=None):
        self.events, self.target = [], target

    def frame(self, row):
        self.events.append(row["frame"])

    def substep(self, substep, substeps):
        self.events.append("last substep" if substep == substeps else "substep")
        if substep < substeps and self.events.count("last substep") == self.target:
            os.kill(os.getpid(), signal.SIGINT)


def test_frames_are_written_while_the_next_ones_run(tmp_path, runs_ahead):
    told = Told()
    run(hanging_beam(frames=3), tmp_path / "late", progress=told)
    assert [event for event in told.events if event != "substep"] == [
        *(0, "last substep", 1, "last substep", 2, "last substep", 3)
    ]
    late = read_run(tmp_path / "late")
    plain = run(hanging_beam(frames=3))
    for frame in range(4):
        np.testing.assert_allclose(late.displacement(frame), plain.displacements[frame], atol=1e-7)
    np.testing.assert_array_equal(run(hanging_beam(frames=3)).displacements, plain.displacements)


@pytest.mark.parametrize("out", [True, False])
def test_what_is_still_to_be_written_is_written_when_a_run_is_stopped(tmp_path, runs_ahead, out):
    folder = tmp_path / "out" if out else None
    result = run(hanging_beam(), folder, progress=Told(1), signals=True)
    assert result.status == "interrupted"
    assert [row["frame"] for row in result.rows] == [0, 1]
    if folder is None:
        assert len(result.displacements) == 2
    else:
        again = run(hanging_beam(), folder, resume=True)
        assert again.status == "finished"
        np.testing.assert_array_equal(again.state.x, run(hanging_beam()).state.x)


def test_what_is_still_to_be_written_is_written_when_a_run_fails(tmp_path, runs_ahead):
    lines = "substeps = 2\nsteps = [1.9, 1.9]\niterations = 8"
    result = run(hanging_beam(solver="jacobi", solver_lines=lines, frames=30), tmp_path / "out")
    assert result.status == "failed"
    assert [row["frame"] for row in log_of(tmp_path / "out")["frames"]] == list(range(len(result.rows)))
    assert len(read_run(tmp_path / "out").times) == len(result.rows)


def test_without_signals_an_interrupt_passes_through(tmp_path):
    # A test run in the background of a shell has the signal ignored from its start.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            run(hanging_beam(), tmp_path / "out", progress=StopAfter(3))
    finally:
        signal.signal(signal.SIGINT, before)
    assert log_of(tmp_path / "out")["status"] == "interrupted"
    assert [row["frame"] for row in run(hanging_beam(), tmp_path / "out", resume=True).rows] == [4, 5, 6]


def test_a_folder_has_one_run_at_a_time(tmp_path):
    class Second(Progress):
        refused = None

        def frame(self, row):
            with pytest.raises(InputError, match="another run is writing") as caught:
                run(hanging_beam(), tmp_path / "out", resume=True)
            self.refused = caught

    second = Second()
    assert run(hanging_beam(frames=1), tmp_path / "out", progress=second).status == "finished"
    assert second.refused


def test_a_closed_terminal_does_not_end_a_run(tmp_path):
    class Closed(Progress):
        def frame(self, row):
            raise BrokenPipeError

    result = run(hanging_beam(frames=2), tmp_path / "out", progress=Closed())
    assert result.status == "finished"
    assert len(log_of(tmp_path / "out")["frames"]) == 3


def test_frames_after_the_checkpoint_are_computed_again(tmp_path):
    scene = hanging_beam(checkpoint_every=4, frames=7)
    whole = run(scene, tmp_path / "whole")
    # As after a kill between two checkpoints: the files hold frames 0 to 7, the checkpoint is that of frame 4.
    run(scene.model_copy(update={"frames": 4}), tmp_path / "parts")
    checkpoint = (tmp_path / "parts" / "checkpoint.h5").read_bytes()
    run(scene, tmp_path / "parts", resume=True)
    (tmp_path / "parts" / "checkpoint.h5").write_bytes(checkpoint)
    resumed = run(scene, tmp_path / "parts", resume=True)
    assert [row["frame"] for row in resumed.rows] == [5, 6, 7]
    np.testing.assert_array_equal(resumed.state.x, whole.state.x)
    assert len(read_run(tmp_path / "parts").times) == 8
    assert [row["frame"] for row in log_of(tmp_path / "parts")["frames"]] == list(range(8))


@pytest.mark.parametrize("file_format", ["vtkhdf", "vtu"])
def test_a_run_killed_before_its_first_checkpoint_begins_again(tmp_path, monkeypatch, file_format):
    def killed(*args):
        raise KeyError("killed")

    scene = hanging_beam(frames=2, format=file_format)
    monkeypatch.setattr("femgal.runner.save_checkpoint", killed)
    with pytest.raises(KeyError):
        run(scene, tmp_path / "out")
    assert len(log_of(tmp_path / "out")["frames"]) == 1
    monkeypatch.undo()
    assert run(scene, tmp_path / "out", resume=True).status == "finished"
    assert len(read_run(tmp_path / "out").times) == len(log_of(tmp_path / "out")["frames"]) == 3


def test_runaway_is_a_result_with_numbers(tmp_path):
    # Step lengths near 2 amplify every stiff mode.
    scene = hanging_beam(solver="jacobi", solver_lines="substeps = 2\nsteps = [1.9, 1.9]\niterations = 8", frames=30)
    result = run(scene, tmp_path / "out")
    assert result.status == "failed"
    log = log_of(tmp_path / "out")
    assert log["status"] == "failed"
    assert "NaN" not in (tmp_path / "out" / "run.json").read_text()
    failure = log["failure"]
    assert failure["frame"] == len(log["frames"])
    assert failure["last_energies"]["total_energy"] == log["frames"][-1]["total_energy"]
    assert "--substeps 4" in failure["advice"]
    written = read_run(tmp_path / "out")
    assert len(written.times) == len(log["frames"])
    assert np.isfinite(written.displacement(-1)).all()


def test_runaway_names_the_layer(tmp_path):
    # Only the coarse layer has a step that amplifies.
    scene = hanging_beam(solver_lines="substeps = 2\nsteps = [1.99, 0.01]\niterations = 8", frames=30)
    result = run(scene, tmp_path / "out")
    assert result.status == "failed"
    assert "clusters of" in result.failure.layer


def test_verlet_above_its_stable_step_fails_cleanly(tmp_path):
    result = run(hanging_beam(solver="verlet", solver_lines="substeps = 1", frames=50), tmp_path / "out")
    assert result.status == "failed"
    assert "substeps out" in str(result.failure)


def test_lost_disk_keeps_the_frames_before(tmp_path, monkeypatch):
    append = vtkhdf.VtkHdfWriter.append

    def full_at_frame_3(self, *args):
        if self.frames_written == 3:
            raise OSError(28, "No space left on device")
        append(self, *args)

    monkeypatch.setattr(vtkhdf.VtkHdfWriter, "append", full_at_frame_3)
    result = run(hanging_beam(), tmp_path / "out")
    assert result.status == "failed"
    assert "No space left" in str(result.failure)
    assert len(read_run(tmp_path / "out").times) == 3
    assert len(log_of(tmp_path / "out")["frames"]) == 3
    monkeypatch.undo()
    resumed = run(hanging_beam(), tmp_path / "out", resume=True)
    assert resumed.status == "finished"
    assert len(log_of(tmp_path / "out")["frames"]) == 7


def test_a_checkpoint_of_another_scene_is_refused(tmp_path):
    run(hanging_beam(frames=2), tmp_path / "out")
    before = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir() if path.is_file()}
    with pytest.raises(InputError, match="fingerprint"):
        run(hanging_beam(frames=2, solver="jacobi"), tmp_path / "out", resume=True)
    assert before == {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir() if path.is_file()}


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("name", "value"), [("every", 2), ("format", "vtu"), ("fields", ("displacement",)), ("checkpoint_every", 1)]
)
def test_only_a_series_with_the_same_settings_goes_on(tmp_path, name, value):
    scene = hanging_beam(frames=3)
    run(scene, tmp_path / "out")
    before = contents(tmp_path / "out")
    changed = scene.model_copy(update={"frames": 4, "output": scene.output.model_copy(update={name: value})})
    if name == "checkpoint_every":
        assert run(changed, tmp_path / "out", resume=True).status == "finished"
        return
    with pytest.raises(InputError, match=name) as caught:
        run(changed, tmp_path / "out", resume=True)
    assert "resume with" in str(caught.value)
    assert contents(tmp_path / "out") == before


def test_every_other_frame_is_written_and_resumed(tmp_path):
    scene = hanging_beam(frames=7)
    scene = scene.model_copy(update={"output": scene.output.model_copy(update={"every": 2, "checkpoint_every": 3})})
    run(scene, tmp_path / "whole")
    run(scene.model_copy(update={"frames": 3}), tmp_path / "parts")
    run(scene, tmp_path / "parts", resume=True)
    whole, parts = read_run(tmp_path / "whole"), read_run(tmp_path / "parts")
    np.testing.assert_allclose(whole.times, np.array([0, 2, 4, 6]) / 60.0, rtol=1e-12)
    np.testing.assert_array_equal(parts.times, whole.times)
    for frame in range(4):
        np.testing.assert_array_equal(parts.displacement(frame), whole.displacement(frame))


@pytest.mark.parametrize("where", ["femgal.simulation.Simulation.compile", "femgal.simulation.Simulation._measure"])
def test_an_unforeseen_error_leaves_a_closed_log(tmp_path, monkeypatch, where):
    def broken(*args):
        raise RuntimeError("a defect")

    monkeypatch.setattr(where, broken)
    with pytest.raises(RuntimeError, match="a defect"):
        run(hanging_beam(frames=2), tmp_path / "out")
    log = log_of(tmp_path / "out")
    assert log["status"] == "failed"
    assert "RuntimeError: a defect" in log["failure"]["what"]


def test_resuming_a_complete_run_has_nothing_to_do(tmp_path):
    scene = hanging_beam(frames=2)
    whole = run(scene, tmp_path / "out")
    again = run(scene, tmp_path / "out", resume=True)
    assert (again.status, again.rows) == ("finished", [])
    np.testing.assert_array_equal(again.state.x, whole.state.x)


def test_a_finished_run_can_be_made_longer(tmp_path):
    run(hanging_beam(frames=3), tmp_path / "out")
    longer = run(hanging_beam(frames=6), tmp_path / "out", resume=True)
    assert [row["frame"] for row in longer.rows] == [4, 5, 6]
    np.testing.assert_array_equal(longer.state.x, run(hanging_beam(frames=6)).state.x)
