# SPDX-License-Identifier: BSD-3-Clause
"""Where caches lie.

1. FEMGAL_CACHE_DIR comes before XDG_CACHE_HOME, and that before the home folder.
2. A new folder of kernels removes siblings unused for more than 30 days, and nothing else; an old folder removes none.
3. A use keeps a folder for another 30 days.
4. Processes that remove the same folders at once do not disturb one another; a cache that cannot be written is no
   error here.
"""

from __future__ import annotations

import os
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from meshes.cache import cache_root, kernel_folder

NEW, OLD, YOUNG, BEGUN = "a" * 16, "b" * 16, "c" * 16, "d" * 16 + ".removed-0123abcd"
DAY = 86400.0


@pytest.fixture
def kernels(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("FEMGAL_CACHE_DIR", str(tmp_path))
    return tmp_path / "kernels"


def aged(folder: Path, days: float) -> Path:
    (folder / "inner").mkdir(parents=True)
    (folder / "inner" / "kernel.nbi").write_bytes(b"code")
    then = time.time() - days * DAY
    os.utime(folder, (then, then))
    return folder


def test_root(monkeypatch, tmp_path):
    monkeypatch.delenv("FEMGAL_CACHE_DIR", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_root() == tmp_path / ".cache" / "femgal"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_root() == tmp_path / "xdg" / "femgal"
    monkeypatch.setenv("FEMGAL_CACHE_DIR", "~/chosen")
    assert cache_root() == tmp_path / "chosen"


def test_unused_siblings_go_when_a_folder_is_new(kernels):
    old, young, begun = aged(kernels / OLD, 31), aged(kernels / YOUNG, 29), aged(kernels / BEGUN, 31)
    foreign = aged(kernels / "notes", 400)
    assert kernel_folder(NEW) == kernels / NEW
    assert sorted(kernels.iterdir()) == sorted([kernels / NEW, young, foreign])
    assert not old.exists()
    assert not begun.exists()
    aged(old, 31)
    kernel_folder(NEW)
    assert (old / "inner" / "kernel.nbi").read_bytes() == b"code"


def test_a_use_counts(kernels):
    aged(kernels / OLD, 31)
    kernel_folder(OLD)
    kernel_folder(NEW)
    assert (kernels / OLD / "inner").is_dir()


def test_removal_at_the_same_time(kernels):
    for k in range(200):
        aged(kernels / f"{k:016x}", 31)
    with ThreadPoolExecutor(8) as pool:
        made = list(pool.map(kernel_folder, [f"{k:016x}" for k in range(10_000, 10_008)]))
    assert sorted(kernels.iterdir()) == sorted(made)


def test_a_cache_that_cannot_be_written(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("FEMGAL_CACHE_DIR", str(tmp_path / "file"))
    assert kernel_folder(NEW) == tmp_path / "file" / "kernels" / NEW
