# SPDX-License-Identifier: BSD-3-Clause
"""The output folder.

1. A new folder is made with its parents; an existing one with unrelated files is used; nothing is left behind in it.
2. Refused: a file, a path through a file, a folder that cannot be written (asked as root too), an earlier run.
3. Resuming needs a checkpoint, or a run that was killed before its first one; it makes no folder.
"""

from __future__ import annotations

import subprocess

import pytest

from femgal.output.folder import has_checkpoint, prepare_output
from femgal.output.runlog import RunLog, read_log
from meshes.errors import InputError


def test_new_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = prepare_output("a/b", resume=False)
    assert path == tmp_path / "a" / "b"
    assert path.is_dir()
    assert list(path.iterdir()) == []


def test_unrelated_files_do_not_matter(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    assert prepare_output(tmp_path, resume=False) == tmp_path
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_file(tmp_path):
    file = tmp_path / "out"
    file.write_text("")
    for path in (file, file / "below"):
        with pytest.raises(InputError, match="out"):
            prepare_output(path, resume=False)


@pytest.mark.parametrize("path", ["/proc/femgal-out", "/dev/null/out", "a\0b"])
def test_impossible(path):
    with pytest.raises(InputError, match="cannot be written") as caught:
        prepare_output(path, resume=False)
    assert "--out" in str(caught.value)


def test_read_only_file_system(tmp_path):
    mount = ["mount", "-t", "tmpfs", "-o", "ro,size=1m", "tmpfs", str(tmp_path)]
    try:
        mounted = subprocess.run(mount, capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        mounted = False
    if not mounted:
        pytest.skip("mounting a read-only file system needs root")
    try:
        with pytest.raises(InputError, match="Read-only file system"):
            prepare_output(tmp_path, resume=False)
    finally:
        subprocess.run(["umount", str(tmp_path)], check=True)


@pytest.mark.parametrize("trace", ["run.json", "checkpoint.h5", "frames.vtkhdf", "frames.pvd"])
def test_earlier_run(tmp_path, trace):
    (tmp_path / trace).write_text("precious")
    with pytest.raises(InputError, match="earlier run") as caught:
        prepare_output(tmp_path, resume=False)
    assert trace in str(caught.value)
    assert "--resume" in str(caught.value)
    assert (tmp_path / trace).read_text() == "precious"


def test_resume(tmp_path):
    with pytest.raises(InputError, match="nothing to resume"):
        prepare_output(tmp_path / "none", resume=True)
    assert not (tmp_path / "none").exists()
    with pytest.raises(InputError, match="nothing to resume"):
        prepare_output(tmp_path, resume=True)
    (tmp_path / "checkpoint.h5").write_text("")
    assert prepare_output(tmp_path, resume=True) == tmp_path
    assert has_checkpoint(tmp_path)


@pytest.mark.parametrize("frames", [0, 1, 2])
def test_resume_of_a_run_killed_before_its_first_checkpoint(tmp_path, frames):
    log = RunLog.create(tmp_path, {})
    for frame in range(frames):
        log.append_frame({"frame": frame})
    if frames <= 1:
        assert prepare_output(tmp_path, resume=True) == tmp_path
        assert not has_checkpoint(tmp_path)
        return
    with pytest.raises(InputError, match="2 frames without a checkpoint"):
        prepare_output(tmp_path, resume=True)
    assert len(read_log(tmp_path)["frames"]) == 2
