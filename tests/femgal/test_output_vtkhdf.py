# SPDX-License-Identifier: BSD-3-Clause
"""The VTKHDF series.

1. VTK's own reader shows every step: times, rest points, cells, all arrays, static ones included, and field data.
2. Frames of several chunks whose rows do not divide evenly come back whole; one frame reads as a static file.
3. Cutting the disk's writes off at ANY point (every prefix of the sequence of writes) leaves a file that opens, whose
   every counted frame is right, and that can be resumed.
4. kill -9 at random moments, a dozen times, each followed by a resume: the file opens and every counted frame is
   right, seen through VTK's reader.
5. A reader may open the file at any time while it is being written.
6. A full disk surfaces as OSError, the frames before stay readable, and the run goes on when there is room again.
7. Units stand in the attributes, the closed file has no slack, and a frame costs what its compressed data cost.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from femgal.output import vtkhdf, vtkhdf_resume
from femgal.output.read import read_run
from femgal.output.series import open_series
from tests.femgal.series_samples import (
    append,
    assert_frame,
    displacement,
    energies,
    sample_mesh,
    static_data,
    von_mises,
)

h5py = pytest.importorskip("h5py")
MESH = sample_mesh()


def write(folder, frames, mesh=MESH):
    writer = open_series(folder, mesh, **static_data(mesh))
    for frame in frames:
        append(writer, mesh, frame)
    writer.close()
    return folder / "frames.vtkhdf"


class VtkView:
    """A .vtkhdf file as ParaView sees it."""

    def __init__(self, path):
        vtk = pytest.importorskip("vtk")
        self._reader = vtk.vtkHDFReader()
        assert self._reader.CanReadFile(str(path))
        self._reader.SetFileName(str(path))
        self._reader.UpdateInformation()
        info = self._reader.GetOutputInformation(0)
        key = vtk.vtkStreamingDemandDrivenPipeline.TIME_STEPS()
        self.times = [info.Get(key, step) for step in range(info.Length(key))]

    def at(self, step):
        self._reader.UpdateTimeStep(self.times[step] if self.times else 0.0)
        return self._reader.GetOutputDataObject(0)


def assert_grid(grid, mesh, frame):
    from vtk.util.numpy_support import vtk_to_numpy

    def array(data, name):
        return vtk_to_numpy(data.GetArray(name))

    points, cells = grid.GetPointData(), grid.GetCellData()
    assert np.array_equal(vtk_to_numpy(grid.GetPoints().GetData()), mesh.points)
    assert np.array_equal(vtk_to_numpy(grid.GetCells().GetConnectivityArray()).reshape(-1, 4), mesh.cells)
    assert {grid.GetCellType(0), grid.GetCellType(grid.GetNumberOfCells() - 1)} == {10}
    assert np.array_equal(array(points, "displacement"), displacement(mesh, frame))
    assert np.array_equal(array(points, "cluster_0"), np.arange(len(mesh.points)) // 4)
    assert np.array_equal(array(cells, "von_mises"), von_mises(mesh, frame).astype(np.float32))
    assert np.array_equal(array(cells, "region"), np.arange(len(mesh.cells)) % 3)
    assert array(cells, "stress").shape == (len(mesh.cells), 9)
    assert {name: grid.GetFieldData().GetArray(name).GetValue(0) for name in energies(0)} == energies(frame)


def test_vtk_sees_every_step(tmp_path):
    view = VtkView(write(tmp_path, range(5)))
    assert view.times == [frame / 64.0 for frame in range(5)]
    for step in (4, 0, 1, 2, 3):
        assert_grid(view.at(step), MESH, step)


def test_a_single_frame_reads_as_static(tmp_path):
    view = VtkView(write(tmp_path, [3]))
    assert_grid(view.at(0), MESH, 3)


def test_uneven_chunks(tmp_path, monkeypatch):
    monkeypatch.setattr(vtkhdf, "_CHUNK_BYTES", 100)
    mesh = sample_mesh((4, 3, 2))
    path = write(tmp_path, range(3), mesh)
    with h5py.File(path) as file:
        chunk = file["VTKHDF/PointData/displacement"].chunks[0]
    assert 1 < chunk < len(mesh.points)
    assert len(mesh.points) % chunk != 0
    view = VtkView(path)
    for step in range(3):
        assert_grid(view.at(step), mesh, step)
        assert_frame(read_run(tmp_path), mesh, step)


class RecordedFile:
    """A file object for h5py that remembers each write."""

    def __init__(self, path):
        self._file = open(path, "r+b", buffering=0)
        self.writes = []

    def write(self, data):
        self.writes.append((self._file.tell(), bytes(data)))
        return self._file.write(data)

    def truncate(self, size):
        self.writes.append((size, None))
        return self._file.truncate(size)

    def __getattr__(self, name):
        return getattr(self._file, name)


def replay(content, writes):
    for position, data in writes:
        if data is None:
            content = content[:position].ljust(position, b"\0")
        else:
            content = content.ljust(position, b"\0")
            content = content[:position] + data + content[position + len(data) :]
    return content


@pytest.mark.parametrize(("before", "chunk"), [(1, 1 << 20), (64, 1 << 20), (2, 500)])
def test_any_prefix_of_the_writes_is_readable(tmp_path, monkeypatch, before, chunk):
    # From the 64th frame to the 65th the chunks of the per-frame arrays and the blocks of the indices run over; small
    # chunks leave the last one of a frame unfilled.
    monkeypatch.setattr(vtkhdf, "_CHUNK_BYTES", chunk)
    path = write(tmp_path, range(before))
    recorded = []

    def open_recorded(name):
        recorded.append(RecordedFile(name))
        return h5py.File(recorded[0], "r+", libver=("v110", "v110"))

    monkeypatch.delattr(os, "posix_fallocate")
    with monkeypatch.context() as patch:
        patch.setattr(vtkhdf_resume, "open_for_writing", open_recorded)
        writer = open_series(tmp_path, MESH, resume_frames=before)
    start = path.read_bytes()
    recorded[0].writes.clear()
    append(writer, MESH, before)
    writes = list(recorded[0].writes)
    assert len(writes) > 20
    seen = []
    (tmp_path / "cut").mkdir()
    cut = tmp_path / "cut" / "frames.vtkhdf"
    for length in range(len(writes) + 1):
        cut.write_bytes(replay(start, writes[:length]))
        run = read_run(cut)
        seen.append(run.n_frames)
        for frame in {0, before // 2, run.n_frames - 1}:
            assert_frame(run, MESH, frame)
        if length % 7 == 0 or length == len(writes):
            assert_resumable(cut.parent, before)
    assert sorted(seen) == seen
    assert (seen[0], seen[-1]) == (before, before + 1)
    writer.close()


def assert_resumable(folder, frames):
    writer = open_series(folder, MESH, resume_frames=frames)
    append(writer, MESH, 500)
    append(writer, MESH, 501)
    writer.close()
    run = read_run(folder)
    assert run.n_frames == frames + 2
    for frame, shown in ((0, 0), (frames - 1, frames - 1), (frames, 500), (frames + 1, 501)):
        assert_frame(run, MESH, frame, shown)


CHILD = """
import sys
from pathlib import Path
sys.path.insert(0, {root!r})
from tests.femgal.series_samples import append, sample_mesh, static_data
from femgal.output.series import open_series
mesh = sample_mesh({cells})
folder, frames = Path(sys.argv[1]), int(sys.argv[2])
writer = open_series(folder, mesh, **static_data(mesh), resume_frames=frames)
print("started", flush=True)
while True:
    append(writer, mesh, frames)
    frames += 1
    print(frames, flush=True)
"""


def start_child(folder, frames, code=CHILD, cells=(3, 3, 2)):
    code = code.format(cells=cells, root=str(Path(__file__).parents[2]))
    return subprocess.Popen([sys.executable, "-c", code, str(folder), str(frames)], stdout=subprocess.PIPE, text=True)


def test_survives_kill(tmp_path):
    rng = np.random.default_rng(7654321)
    frames = 0
    for _ in range(12):
        reported = frames + int(rng.integers(1, 9))
        with start_child(tmp_path, frames) as child:
            while child.stdout.readline() != f"{reported}\n":
                pass
            time.sleep(rng.uniform(0.0, 0.03))
            child.kill()
        run = read_run(tmp_path)
        assert run.n_frames >= reported
        for frame in range(frames, run.n_frames):
            assert_frame(run, MESH, frame)
        # Some frames are thrown away, as when the checkpoint is older than the last frame.
        frames = max(run.n_frames - 2, 0)
    assert frames > 12
    view = VtkView(tmp_path / "frames.vtkhdf")
    assert len(view.times) == run.n_frames
    for step in range(len(view.times)):
        assert_grid(view.at(step), MESH, step)


def test_readable_while_it_is_written(tmp_path):
    child = start_child(tmp_path, 0)
    try:
        assert child.stdout.readline() == "started\n"
        seen = []
        until = time.monotonic() + 20.0
        while not (tmp_path / "frames.vtkhdf").exists():
            assert time.monotonic() < until
            time.sleep(0.001)
        while (not seen or seen[-1] < 30) and time.monotonic() < until:
            run = read_run(tmp_path)
            seen.append(run.n_frames)
            if seen[-1]:
                assert_frame(run, MESH, seen[-1] - 1)
    finally:
        child.kill()
        child.wait()
        child.stdout.close()
    assert sorted(seen) == seen
    assert seen[-1] >= 30


LARGE = (10, 10, 10)
LIMITED = """
import resource
resource.setrlimit(resource.RLIMIT_FSIZE, (3_000_000, 3_000_000))
try:
{child}
except OSError as error:
    print(frames, error.errno, flush=True)
    writer.close()
"""


def test_file_size_limit(tmp_path):
    code = LIMITED.format(child="".join(f"    {line}\n" for line in CHILD.strip().splitlines()))
    with start_child(tmp_path, 0, code, LARGE) as child:
        output = child.stdout.read().split()
    assert child.returncode == 0
    frames, number = int(output[-2]), int(output[-1])
    assert number == 27  # EFBIG
    assert frames >= 5
    mesh = sample_mesh(LARGE)
    assert_all_frames(tmp_path, mesh, frames)
    writer = open_series(tmp_path, mesh, resume_frames=frames)
    append(writer, mesh, frames)
    writer.close()
    assert_all_frames(tmp_path, mesh, frames + 1)


def test_full_disk(tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", str(disk)]
    if sys.platform != "linux" or subprocess.run(mount, capture_output=True, check=False).returncode != 0:
        pytest.skip("mounting a small disk needs root")
    try:
        ballast = disk / "ballast"
        ballast.write_bytes(bytes(400_000))
        mesh = sample_mesh(LARGE)
        writer = open_series(disk, mesh, **static_data(mesh))
        with pytest.raises(OSError, match="no room for frame") as caught:
            append_many(writer, mesh, 1000)
        assert caught.value.errno == 28
        frames = writer.frames_written
        assert frames >= 5
        assert_all_frames(disk, mesh, frames)
        ballast.unlink()
        append(writer, mesh, frames)
        writer.close()
        assert_all_frames(disk, mesh, frames + 1)
    finally:
        subprocess.run(["umount", "-l", str(disk)], check=True)


def append_many(writer, mesh, frames):
    for frame in range(frames):
        append(writer, mesh, frame)


def assert_all_frames(folder, mesh, frames):
    run = read_run(folder)
    assert run.n_frames == frames
    for frame in range(frames):
        assert_frame(run, mesh, frame)


def test_attributes(tmp_path):
    with h5py.File(write(tmp_path, range(2))) as file:
        root = file["VTKHDF"]
        assert root.attrs["Version"].tolist() == [2, 2]
        assert root.attrs["Type"] == b"UnstructuredGrid"
        units = {name: root[name].attrs["unit"] for name in ("Points", "PointData/displacement", "CellData/von_mises")}
        assert list(units.values()) == ["m", "m", "Pa"]
        assert root["FieldData/total_energy"].attrs["unit"] == "J"
        assert root["PointData/displacement"].dtype == np.float32


def test_size(tmp_path):
    mesh = sample_mesh((12, 12, 12))
    small, large = (write(tmp_path, range(frames), mesh).stat().st_size for frames in (2, 12))
    with h5py.File(tmp_path / "frames.vtkhdf") as file:
        data = [file[f"VTKHDF/{name}"] for name in ("PointData/displacement", "CellData/von_mises", "CellData/stress")]
        stored = sum(array.id.get_storage_size() for array in data)
    assert large - small < 1.05 * stored * 10 / 12 + 20_000
