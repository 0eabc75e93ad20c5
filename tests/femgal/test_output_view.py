# SPDX-License-Identifier: BSD-3-Clause
"""Pictures.

1. The picture shows the body: its pixels are not background, they carry the colours of the field, and a montage has
   one pane per frame. The moved body covers other pixels than the resting one.
2. Ids, vectors and single values can be drawn; the file is written where asked.
3. Units are brought to readable sizes and scalar bars end on round numbers.
4. Refused: wrong frames and fields, NaN motion, a folder that cannot be written, pyvista missing.
5. A drawing process that dies with a signal is reported with the packages to install, and no picture is left.
"""

from __future__ import annotations

import sys

import numpy as np
import pytest

from femgal.output import view
from femgal.output.read import read_run
from femgal.output.series import open_series
from femgal.output.view import frame_number, save_picture
from meshes.errors import InputError
from tests.femgal.series_samples import append, sample_mesh, static_data

pyvista = pytest.importorskip("pyvista")
MESH = sample_mesh((6, 6, 4))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    writer = open_series(folder, MESH, **static_data(MESH))
    for frame in range(4):
        append(writer, MESH, frame)
    writer.close()
    return read_run(folder)


def pixels(path):
    image = pyvista.read(path)
    width, height, _ = image.dimensions
    return np.asarray(image.active_scalars).reshape(height, width, -1)[::-1, :, :3].astype(int)


def body(image):
    """Pixels of the panes that are neither white nor text; the scalar bar's strip is left out."""
    return np.ptp(image[: image.shape[0] - 140], axis=2) > 25


def test_last_frame(run, tmp_path):
    image = pixels(save_picture(run, tmp_path / "a.png"))
    assert image.shape == (1200, 1600, 3)
    covered = body(image).mean()
    assert 0.15 < covered < 0.75
    # von Mises rises over the cells, so the ends of the colour map both appear.
    red, blue = image[..., 0] - image[..., 2], image[..., 2] - image[..., 0]
    assert (red > 60).sum() > 2000
    assert (blue > 60).sum() > 2000


def test_montage(run, tmp_path):
    image = pixels(save_picture(run, tmp_path / "a.png", frames=["first", 2, "last"], field="displacement"))
    assert image.shape == (890, 3 * 760, 3)
    panes = [body(image[:, 760 * pane : 760 * (pane + 1)]) for pane in range(3)]
    for pane in panes:
        assert pane.mean() > 0.08
    assert (panes[0] != panes[2]).mean() > 0.02


def test_ids(run, tmp_path):
    image = pixels(save_picture(run, tmp_path / "a.png", field="region"))
    assert body(image).mean() > 0.15


@pytest.mark.parametrize(
    ("unit", "largest", "expected"),
    [
        ("Pa", 2.3e5, (1e-3, "kPa")),
        ("Pa", 12.0, (1.0, "Pa")),
        ("m", 0.012, (1e3, "mm")),
        ("m", 5000.0, (1.0, "m")),
        ("-", 3.0, (1.0, "")),
        ("J/m^3", 4e7, (1e-6, "MJ/m^3")),
        ("Pa", 0.0, (1.0, "Pa")),
    ],
)
def test_readable_units(unit, largest, expected):
    factor, name = view._readable_unit(unit, largest)
    assert (pytest.approx(factor), name) == expected


@pytest.mark.parametrize(("value", "end"), [(1.0, 1.0), (265.0, 280.0), (0.0101, 0.012), (99.0, 100.0)])
def test_round_ends(value, end):
    assert view._rounded_up(value) == pytest.approx(end, rel=1e-12)


def test_frame_numbers():
    assert [frame_number(frame, 5, "run") for frame in ("first", "last", "3", 2, -1)] == [0, 4, 3, 2, 4]
    for wrong in ("5", "-6", "middle", "1.5", ""):
        with pytest.raises(InputError, match="no such frame"):
            frame_number(wrong, 5, "run")


def test_wrong_questions(run, tmp_path):
    with pytest.raises(InputError, match="0 to 3"):
        save_picture(run, tmp_path / "a.png", frames=[9])
    with pytest.raises(InputError, match="displacement, region"):
        save_picture(run, tmp_path / "a.png", field="temperature")
    with pytest.raises(InputError, match="cannot be written"):
        save_picture(run, tmp_path / "none" / "a.png")
    assert list(tmp_path.iterdir()) == []


def test_motion_that_is_not_finite(tmp_path):
    writer = open_series(tmp_path, MESH)
    writer.append(0.0, {"displacement": np.full(MESH.points.shape, np.nan)}, {}, {})
    writer.close()
    with pytest.raises(InputError, match="frame 0"):
        save_picture(read_run(tmp_path), tmp_path / "a.png")


def test_pyvista_missing(run, tmp_path, monkeypatch):
    monkeypatch.setattr(view.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install \"femgal\[view\]\""):
        save_picture(run, tmp_path / "a.png")


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "SIGSEGV"),
        ("raise SystemExit('no libEGL.so.1')", "no libEGL.so.1"),
        ("pass", "no picture"),
    ],
)
def test_broken_opengl(run, tmp_path, monkeypatch, code, message):
    monkeypatch.setattr(view, "_DRAW", (sys.executable, "-c", code))
    with pytest.raises(InputError, match=message) as caught:
        save_picture(run, tmp_path / "a.png")
    assert "libegl1" in str(caught.value)
    assert list(tmp_path.iterdir()) == []
