# SPDX-License-Identifier: BSD-3-Clause
"""The script for a machine with a GPU, at toy size in Numba's simulator.

1. All parts run, are written as JSON and drawn as a page; what the simulator cannot do says so.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
def test_toy_run(tmp_path):
    if find_spec("numba_cuda") is None:
        pytest.skip("numba-cuda is not installed: pip install 'femgal[simulate]'")
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "reports.gpu.run", str(tmp_path), "--toy"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=ROOT)
    assert done.returncode == 0, done.stderr[-3000:]
    found = json.loads((tmp_path / "figures.json").read_text())
    assert found["correctness"]["passes"]["float64"]["repeats"]
    (scene,) = found["correctness"]["scenes"].values()
    assert scene["positions"] <= 1e-9
    (row,) = found["speed"]["bunny drape"]
    assert "failure" not in row
    assert row["frames"]["repeated"] > 0
    assert "Not run: toy size." in (tmp_path / "README.md").read_text()
