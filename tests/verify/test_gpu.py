# SPDX-License-Identifier: BSD-3-Clause
"""The script for a machine with a GPU, at toy size in Numba's simulator.

1. All parts run, are written as JSON and drawn as a page; what the simulator cannot do says so.
2. A journal goes on where it was left, keeps failures as results, and begins nothing after its time; with another
   environment it begins anew.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from verify.gpu.journal import Journal

ROOT = Path(__file__).resolve().parents[2]


def test_journal(tmp_path):
    file, done = tmp_path / "found.json", []

    def task(name, fails=False):
        def work():
            done.append(name)
            return {"value": 1 / (0 if fails else 2)}

        return "part", name, work

    here = {"femgal": "1", "size": "toy"}
    assert not Journal(file, here).work_through([task("a"), task("b")], -1.0)
    assert done == []
    assert Journal(file, here).work_through([task("a"), task("b", fails=True)], 60.0)
    again = Journal(file, here)
    assert again.work_through([task("a"), task("b"), task("c")], 60.0)
    assert done == ["a", "b", "c"]
    assert again.failures == ["part: b"]
    assert again.found["part"]["c"]["value"] == 0.5
    assert Journal(file, {**here, "femgal": "2"}).found.get("part") is None


@pytest.mark.slow
def test_toy_run(tmp_path):
    if find_spec("numba_cuda") is None:
        pytest.skip("numba-cuda is not installed: pip install 'femgal[simulate]'")
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "reports.gpu.run", str(tmp_path), "--toy"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=ROOT)
    assert done.returncode == 0, done.stderr[-3000:]
    found = json.loads((tmp_path / "figures.json").read_text())
    assert found["passes"]["float64"]["repeats"]
    (scene,) = found["scenes"].values()
    assert scene["positions"] <= 1e-9
    for part in ("speed", "table 1"):
        (row,) = found[part].values()
        assert row["frames"]["repeated"] > 0
    assert all(row["reached"] for row in found["one percent"].values())
    assert "Not run: toy size." in (tmp_path / "README.md").read_text()
