# SPDX-License-Identifier: BSD-3-Clause
"""Runs a module in a process of its own, in Numba's CUDA simulator, and brings back what it found."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]


def needs_numba_cuda() -> None:
    """Skip where Numba-CUDA is missing."""
    if find_spec("numba_cuda") is None:
        pytest.skip("numba-cuda is not installed: pip install 'femgal[simulate]'")


def in_simulator(module: str, *arguments: str) -> dict:
    """What a module prints as JSON in its last line."""
    needs_numba_cuda()
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", module, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=ROOT)
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout.splitlines()[-1])
