# SPDX-License-Identifier: BSD-3-Clause
"""``femgal view``.

1. It writes RUN/picture.png, or the file named by --png, and prints the path.
2. --frame, --frames and --field reach the drawing.
3. A folder without a run is refused.
"""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from femgal.commands.view import command
from femgal.output import view
from femgal.output.series import open_series
from meshes.errors import InputError
from tests.femgal.series_samples import append, sample_mesh


@pytest.fixture
def folder(tmp_path):
    mesh = sample_mesh()
    writer = open_series(tmp_path, mesh)
    for frame in range(3):
        append(writer, mesh, frame)
    writer.close()
    return tmp_path


@pytest.fixture
def asked(monkeypatch):
    calls = []

    def save(run, png, *, frames, field):
        calls.append((run.path.name, png, frames, field))
        return png

    monkeypatch.setattr(view, "save_picture", save)
    return calls


def view_run(*arguments):
    return CliRunner().invoke(command, [str(argument) for argument in arguments])


def test_draws(folder):
    pytest.importorskip("pyvista")
    result = view_run(folder)
    assert result.output.strip() == str(folder / "picture.png")
    assert (folder / "picture.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("options", "frames", "field"),
    [
        ([], ["last"], None),
        (["--png"], ["last"], None),
        (["--frame", "2", "--field", "J"], ["2"], "J"),
        (["--frames", "first, 1,last"], ["first", "1", "last"], None),
    ],
)
def test_options(folder, asked, options, frames, field):
    assert view_run(folder, *options).exit_code == 0
    assert asked == [("frames.vtkhdf", folder / "picture.png", frames, field)]


def test_png(folder, asked, tmp_path):
    view_run(folder / "frames.vtkhdf", "--png", tmp_path / "a.png")
    assert asked[0][1] == tmp_path / "a.png"


def test_no_run(tmp_path):
    result = view_run(tmp_path / "none")
    assert isinstance(result.exception, InputError)
    assert "frames.vtkhdf" in str(result.exception)
