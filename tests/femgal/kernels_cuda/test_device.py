# SPDX-License-Identifier: BSD-3-Clause
"""What is said where there is no GPU to use: one message with what was found, what is needed, and what to do.

1. Missing packages, no driver, a driver without a device, an old driver, an old device, too little memory.
2. A machine with all of it gives its device, and the simulator none.
3. Solvers and settings that exist on the CPU only are refused before anything else is asked for.
4. `femgal doctor` prints the findings and ends well whatever they are; `femgal run --device cuda` ends with exit code 2
   before anything is built.
"""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace

import pytest

from femgal.device_choice import check_supported
from femgal.kernels.cuda.device import PACKAGES, Device, Findings, find_devices, require_device
from femgal.scene.solver import SolverSettings
from meshes.errors import InputError

H200 = Device("NVIDIA H200", (9, 0), 132, 140 * 2**30, 139 * 2**30)
ALL_WELL = Findings((13, 0), "", (H200,), dict.fromkeys(PACKAGES, "1.0"))


def test_device_of_a_good_machine():
    assert require_device(ALL_WELL) is H200
    assert require_device(ALL_WELL, nbytes=100 * 2**30) is H200


def test_simulator():
    assert require_device(replace(ALL_WELL, driver=None, devices=(), simulated=True)) is None
    without = {**ALL_WELL.packages, "numba-cuda": None}
    with pytest.raises(InputError, match="packages"):
        require_device(Findings(packages=without, simulated=True))


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (replace(ALL_WELL, packages={**ALL_WELL.packages, "cuda-core": None}), ("cuda-core", "pip install")),
        (replace(ALL_WELL, driver=None, devices=()), ("no NVIDIA driver", "R580")),
        (replace(ALL_WELL, devices=()), ("driver for CUDA 13.0, no device", "R580")),
        (
            replace(ALL_WELL, devices=(), trouble="cuInit: no CUDA-capable device is detected (100)"),
            ("detected (100)",),
        ),
        (replace(ALL_WELL, driver=(12, 8)), ("CUDA 12.8", "CUDA 13.0", "newer driver")),
        (replace(ALL_WELL, devices=(replace(H200, capability=(6, 1)),)), ("6.1", "7.5")),
    ],
)
def test_refusals(found, words):
    with pytest.raises(InputError) as caught:
        require_device(found)
    assert caught.value.where == "solver.device = cuda"
    for word in words:
        assert word in str(caught.value)


def test_too_little_memory():
    with pytest.raises(InputError, match=r"150\.00 GiB free") as caught:
        require_device(ALL_WELL, nbytes=150 * 2**30)
    assert "139.0 GiB free" in str(caught.value)


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"name": "jacobi-explicit"}, "verlet"),
        ({"name": "newton-multigrid", "preconditioner": "mas"}, "layers"),
    ],
)
def test_what_a_gpu_cannot_do(settings, word):
    with pytest.raises(InputError, match="not on a GPU yet") as caught:
        check_supported(SolverSettings.model_validate({**settings, "device": "cuda"}))
    assert word in str(caught.value.allowed)


@pytest.mark.parametrize("settings", [{"name": "fas"}, {"name": "verlet", "accuracy": 0.01}, {"name": "auto"}])
def test_what_a_gpu_can_do(settings):
    check_supported(SolverSettings.model_validate({**settings, "device": "cuda"}))


def femgal(*arguments: str, **environment: str) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "femgal.cli", *arguments]
    return subprocess.run(command, capture_output=True, text=True, env={**os.environ, **environment})


def test_doctor():
    done = femgal("doctor")
    assert done.returncode == 0
    for word in ("python:", "threads:", "cuda packages:", "cuda driver:", "--device cuda:", "--device cpu:"):
        assert word in done.stdout


def test_run_without_a_gpu(tmp_path):
    if find_devices().devices:
        pytest.skip("there is a GPU")
    done = femgal("run", "rabbit-drape", "--vertices", "200", "--device", "cuda", "--out", str(tmp_path / "out"))
    assert done.returncode == 2
    assert done.stderr.count("error:") == 1
    assert "solver.device = cuda" in done.stderr
    assert not (tmp_path / "out").exists()
