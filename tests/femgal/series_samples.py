# SPDX-License-Identifier: BSD-3-Clause
"""A small box and a motion whose every number follows from the frame, for the tests of the output."""

from __future__ import annotations

import numpy as np

from meshes.generators import box

TENSOR = np.arange(9.0).reshape(3, 3)


def sample_mesh(cells=(3, 3, 2)):
    return box((0.3, 0.3, 0.2), cells, jitter=0.1, seed=90271)


def displacement(mesh, frame):
    """Smooth in space and different at every frame; exact in float32."""
    bend = np.round(mesh.points**2 * 2**12) / 2**12
    return np.column_stack([bend[:, 2], bend[:, 0], -bend[:, 1]]) * frame


def von_mises(mesh, frame):
    return 1000.0 * frame + np.arange(len(mesh.cells))


def energies(frame):
    return {"kinetic_energy": 0.5 * frame, "total_energy": 10.0 - frame}


def append(writer, mesh, frame):
    writer.append(
        frame / 64.0,
        {"displacement": displacement(mesh, frame)},
        {"von_mises": von_mises(mesh, frame), "stress": von_mises(mesh, frame)[:, None, None] * TENSOR},
        energies(frame),
    )


def static_data(mesh):
    return {
        "static_cell_data": {"region": np.arange(len(mesh.cells)) % 3},
        "static_point_data": {"cluster_0": np.arange(len(mesh.points)) // 4},
    }


def assert_frame(run, mesh, frame, shown=None):
    """Check every number of one frame of a `SavedRun`; `shown` is the frame whose motion it should show."""
    shown = frame if shown is None else shown
    assert run.times[frame] == shown / 64.0
    assert np.array_equal(run.displacement(frame), displacement(mesh, shown))
    assert np.array_equal(run.cell_data("von_mises", frame), von_mises(mesh, shown))
    stress = run.cell_data("stress", frame)
    assert stress.shape == (len(mesh.cells), 9)
    assert np.array_equal(stress, von_mises(mesh, shown)[:, None] * TENSOR.ravel())
    assert np.array_equal(run.cell_data("region", frame), np.arange(len(mesh.cells)) % 3)
    assert np.array_equal(run.point_data("cluster_0", frame), np.arange(len(mesh.points)) // 4)
    assert run.field_data(frame) == energies(shown)
