# SPDX-License-Identifier: BSD-3-Clause
"""The .vtu + .pvd series.

1. VTK's own reader shows the frames of the .pvd list: times, points, cells, all arrays, field data.
2. The list never names a file that is not there: kill -9 at random moments leaves whole frames only.
3. Numbers that are not finite stay out of the field data, where VTK could not read them.
4. A list that leads out of its folder, a damaged list and a damaged frame are refused by name.
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from femgal.output.read import read_run
from femgal.output.series import open_series
from meshes.errors import InputError
from tests.femgal.series_samples import (
    append,
    assert_frame,
    displacement,
    energies,
    sample_mesh,
    static_data,
    von_mises,
)

MESH = sample_mesh()


def write(folder, frames):
    writer = open_series(folder, MESH, format="vtu", **static_data(MESH))
    for frame in frames:
        append(writer, MESH, frame)
    writer.close()


def test_vtk_sees_every_frame(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    write(tmp_path, range(3))
    reader = pyvista.get_reader(str(tmp_path / "frames.pvd"))
    assert reader.time_values == [0.0, 1 / 64.0, 2 / 64.0]
    for frame, moment in enumerate(reader.time_values):
        reader.set_active_time_value(moment)
        grid = reader.read()[0]
        assert np.array_equal(grid.points, MESH.points)
        assert np.array_equal(grid.cells_dict[10], MESH.cells)
        assert np.array_equal(grid["displacement"], displacement(MESH, frame))
        assert np.array_equal(grid["von_mises"], von_mises(MESH, frame))
        assert grid["stress"].shape == (len(MESH.cells), 9)
        assert np.array_equal(grid["region"], np.arange(len(MESH.cells)) % 3)
        assert {name: grid.field_data[name][0] for name in energies(0)} == energies(frame)
        assert grid.field_data["TimeValue"][0] == moment


CHILD = """
import sys
from pathlib import Path
sys.path.insert(0, {root!r})
from tests.femgal.series_samples import append, sample_mesh, static_data
from femgal.output.series import open_series
mesh = sample_mesh()
writer = open_series(Path(sys.argv[1]), mesh, format="vtu", **static_data(mesh), resume_frames=int(sys.argv[2]))
while True:
    append(writer, mesh, writer.frames_written)
    print(writer.frames_written, flush=True)
"""


def test_survives_kill(tmp_path):
    code = CHILD.format(root=str(Path(__file__).parents[2]))
    frames = 0
    for moment in np.random.default_rng(1234577).uniform(0.0, 0.05, 4):
        command = [sys.executable, "-c", code, str(tmp_path), str(frames)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
            while child.stdout.readline() != f"{frames + 4}\n":
                pass
            time.sleep(moment)
            child.kill()
        run = read_run(tmp_path)
        assert run.n_frames >= frames + 4
        for frame in range(frames, run.n_frames):
            assert_frame(run, MESH, frame)
        frames = run.n_frames
    assert frames >= 16


def test_numbers_that_are_not_finite(tmp_path):
    writer = open_series(tmp_path, MESH, format="vtu")
    writer.append(0.5, {"displacement": displacement(MESH, 1)}, {}, {"eps18": float("nan"), "a<b": 2.0})
    assert read_run(tmp_path).field_data(0) == {"a<b": 2.0}


def test_refusals(tmp_path):
    home = tmp_path / "run"
    home.mkdir()
    write(home, range(2))
    whole = (home / "frames.pvd").read_text()
    (tmp_path / "other.vtu").write_bytes((home / "frames" / "frame_00000.vtu").read_bytes())
    (home / "frames.pvd").write_text(whole.replace("frames/frame_00000.vtu", "../other.vtu"))
    with pytest.raises(InputError, match="outside the run"):
        read_run(home).displacement(0)
    (home / "frames.pvd").write_text(whole[:-40])
    with pytest.raises(InputError, match=r"frames\.pvd"):
        read_run(home)
    (home / "frames.pvd").write_text(whole)
    frame = home / "frames" / "frame_00001.vtu"
    frame.write_bytes(frame.read_bytes()[:3000])
    with pytest.raises(InputError, match=r"frame_00001\.vtu"):
        read_run(home).displacement(1)
