# SPDX-License-Identifier: BSD-3-Clause
"""Series of frames, the same for both formats.

1. What was appended is read back exactly (the motion is chosen exact in float32), static arrays at every frame.
2. Resuming keeps the first n frames to the last bit, drops the rest, and goes on; n = 0 starts anew.
3. A series that is missing, too short or of another mesh cannot be resumed, and says so.
4. Other array names than before and wrong shapes are refused and leave the series as it was.
5. An unknown format is refused with the allowed ones.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.output.read import read_run
from femgal.output.series import open_series
from meshes.errors import InputError
from tests.femgal.series_samples import append, assert_frame, displacement, energies, sample_mesh, static_data

both = pytest.mark.parametrize("format", ["vtkhdf", "vtu"])
MESH = sample_mesh()


def write(folder, format, frames, **keywords):
    writer = open_series(folder, MESH, format=format, **static_data(MESH), **keywords)
    for frame in frames:
        append(writer, MESH, frame)
    writer.close()
    writer.close()
    return writer.frames_written


@both
def test_round_trip(tmp_path, format):
    assert write(tmp_path, format, range(4)) == 4
    run = read_run(tmp_path)
    assert run.n_frames == 4
    assert np.array_equal(run.points, MESH.points)
    assert np.array_equal(run.cells, MESH.cells)
    assert run.point_names == ("cluster_0", "displacement")
    assert run.cell_names == ("region", "stress", "von_mises")
    for frame in range(4):
        assert_frame(run, MESH, frame)


@both
def test_resume(tmp_path, format):
    write(tmp_path, format, range(6))
    assert write(tmp_path, format, [30, 31], resume_frames=3) == 5
    run = read_run(tmp_path)
    assert run.n_frames == 5
    for frame, shown in enumerate([0, 1, 2, 30, 31]):
        assert_frame(run, MESH, frame, shown)


@both
def test_resume_without_new_frames(tmp_path, format):
    write(tmp_path, format, range(4))
    assert write(tmp_path, format, [], resume_frames=2) == 2
    assert read_run(tmp_path).n_frames == 2


@both
def test_resume_from_nothing_starts_anew(tmp_path, format):
    write(tmp_path, format, range(3))
    assert write(tmp_path, format, [7], resume_frames=0) == 1
    assert_frame(read_run(tmp_path), MESH, 0, 7)


@both
def test_unresumable(tmp_path, format):
    def resume(mesh, frames):
        open_series(tmp_path, mesh, format=format, resume_frames=frames)

    with pytest.raises(InputError, match=r"frames\.(vtkhdf|pvd)"):
        resume(MESH, 1)
    write(tmp_path, format, range(3))
    with pytest.raises(InputError, match="3 frames"):
        resume(MESH, 4)
    with pytest.raises(InputError, match="cannot be resumed"):
        resume(sample_mesh((3, 3, 3)), 2)
    with pytest.raises(InputError, match="another mesh"):
        resume(MESH.moved(MESH.points * 1.0000001), 2)
    assert read_run(tmp_path).n_frames == 3


@both
def test_other_names_or_shapes_are_refused(tmp_path, format):
    writer = open_series(tmp_path, MESH, format=format, **static_data(MESH))
    append(writer, MESH, 0)
    moved = displacement(MESH, 1)
    with pytest.raises(ValueError, match=r"had \['displacement'\], got \['velocity'\]"):
        writer.append(0.1, {"velocity": moved}, {}, energies(1))
    with pytest.raises(ValueError, match="needed"):
        writer.append(0.1, {"displacement": moved[1:]}, {}, energies(1))
    append(writer, MESH, 1)
    writer.close()
    run = read_run(tmp_path)
    assert run.n_frames == 2
    for frame in range(2):
        assert_frame(run, MESH, frame)


def test_unknown_format(tmp_path):
    with pytest.raises(InputError, match="vtkhdf, vtu"):
        open_series(tmp_path, MESH, format="xdmf")
    assert list(tmp_path.iterdir()) == []
