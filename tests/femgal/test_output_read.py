# SPDX-License-Identifier: BSD-3-Clause
"""Reading a run.

1. A folder, a .vtkhdf and a .pvd file open alike, with the log where there is one; -1 is the last frame.
2. An open result follows a run that goes on.
3. Wrong frames and names, folders without a run and foreign files are refused with what would be right.
4. A series whose cells point at vertices that are not there, or whose arrays are cut off, never reaches VTK.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.output.read import read_run
from femgal.output.runlog import RunLog
from femgal.output.series import open_series
from meshes.errors import InputError, MeshError
from tests.femgal.series_samples import append, assert_frame, displacement, sample_mesh, static_data

h5py = pytest.importorskip("h5py")
MESH = sample_mesh()


@pytest.fixture(params=["vtkhdf", "vtu"])
def folder(tmp_path, request):
    writer = open_series(tmp_path, MESH, format=request.param, **static_data(MESH))
    for frame in range(3):
        append(writer, MESH, frame)
    writer.close()
    return tmp_path


def test_folder_and_file(folder):
    file = next(path for path in folder.iterdir() if path.suffix in (".vtkhdf", ".pvd"))
    for source in (folder, str(folder), file):
        run = read_run(source)
        assert_frame(run, MESH, 2)
        assert np.array_equal(run.displacement(-1), displacement(MESH, 2))
        assert run.log == {}
    RunLog.create(folder, {"scene": "box"})
    assert read_run(folder).log["scene"] == "box"


def test_follows_a_running_run(tmp_path):
    writer = open_series(tmp_path, MESH, **static_data(MESH))
    append(writer, MESH, 0)
    run = read_run(tmp_path)
    assert run.n_frames == 1
    for frame in range(1, 4):
        append(writer, MESH, frame)
        assert run.n_frames == frame + 1
        assert_frame(run, MESH, frame)
    writer.close()


def test_wrong_questions(folder):
    run = read_run(folder)
    for frame in (3, -4):
        with pytest.raises(InputError, match="0 to 2"):
            run.displacement(frame)
    with pytest.raises(InputError, match="cluster_0, displacement"):
        run.point_data("velocity", 0)
    with pytest.raises(InputError, match="region, stress, von_mises"):
        run.cell_data("J", 0)


def test_no_run(tmp_path):
    with pytest.raises(InputError, match="folder without a series"):
        read_run(tmp_path)
    with pytest.raises(InputError, match="no such file"):
        read_run(tmp_path / "none")
    for name in ("a.vtk", "b.vtkhdf", "c.pvd"):
        (tmp_path / name).write_text("nonsense")
        with pytest.raises(InputError, match=name):
            read_run(tmp_path / name)


def test_no_frame_yet(tmp_path):
    open_series(tmp_path, MESH).close()
    with pytest.raises(InputError, match="no frame yet"):
        read_run(tmp_path).displacement(0)


@pytest.fixture
def series(tmp_path):
    writer = open_series(tmp_path, MESH)
    writer.append(0.0, {"displacement": displacement(MESH, 0)}, {}, {})
    writer.close()
    return tmp_path / "frames.vtkhdf"


def test_cells_that_point_nowhere(series):
    with h5py.File(series, "r+") as file:
        file["VTKHDF/Connectivity"][5] = len(MESH.points)
    with pytest.raises(MeshError, match="does not exist"):
        _ = read_run(series).cells


def test_cut_off_array(series):
    with h5py.File(series, "r+") as file:
        file["VTKHDF/PointData/displacement"].resize(len(MESH.points) - 1, axis=0)
    with pytest.raises(InputError, match="cut off"):
        read_run(series).displacement(0)


def test_link_out_of_the_file(series):
    with h5py.File(series, "r+") as file:
        del file["VTKHDF/PointData/displacement"]
        file["VTKHDF/PointData/displacement"] = h5py.ExternalLink("/etc/hostname", "/x")
    with pytest.raises(InputError, match="ExternalLink"):
        read_run(series).displacement(0)
