# SPDX-License-Identifier: BSD-3-Clause
"""The device of the verification suite.

1. Without a GPU, cases on it are skipped, and the reason says what is missing; the CPU is always there.
2. A scene that a device cannot solve is skipped with what it refused.
"""

from __future__ import annotations

import pytest

from femgal.scene.load import load_scene
from meshes.errors import InputError
from verify.problems.bodies import distorted_box, uniform
from verify.problems.scenes import simulation
from verify.suite.case import Skip
from verify.suite.use import Use, unavailable

DISC = uniform(distorted_box((2, 2, 2)))


def refuse(*_, **__):
    raise InputError("there is no GPU to use", where="solver.device = cuda", found="no driver", allowed="a GPU")


def test_without_a_gpu(monkeypatch):
    monkeypatch.setattr("femgal.kernels.cuda.device.require_device", refuse)
    assert unavailable("cpu") is None
    assert unavailable("cuda") == "there is no GPU to use (no driver)"
    with pytest.raises(Skip, match="no driver"):
        Use("cuda").backend(DISC)
    with pytest.raises(Skip, match="no driver"):
        simulation(load_scene("beam-bend", vertices=100), Use("cuda"))


def test_what_a_device_cannot_solve(monkeypatch):
    monkeypatch.setattr("femgal.kernels.cuda.device.require_device", lambda *_, **__: None)
    overrides = {"solver.name": "newton-multigrid", "solver.preconditioner": "mas"}
    scene = load_scene("beam-bend", vertices=100, overrides=overrides)
    with pytest.raises(Skip, match=r"solver.preconditioner = mas is not on a GPU"):
        simulation(scene, Use("cuda"))
