# SPDX-License-Identifier: BSD-3-Clause
"""What a scene is expected to take on a GPU, and what is said where there is not so much.

1. Never less than the arrays of its layers as they are laid out, and less than twice as much, in both precisions, for
   both transfers and for bodies of which a part is held. (Whole runs are in test_scenes.py.)
2. A scene that does not fit is refused before anything is put on the device: what it needs, what there is, what to do.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from femgal import device_memory
from femgal.hierarchy.hierarchy import build_constant_hierarchy, build_linear_hierarchy
from femgal.kernels.cuda import device
from femgal.kernels.cuda.device import PACKAGES, Device, Findings
from femgal.scene.load import load_scene
from femgal.scene.solver import SolverSettings
from femgal.simulation import Simulation
from meshes.errors import InputError
from tests.femgal.kernels_cuda.simulated import needs_numba_cuda
from verify.problems.bodies import distorted_box, left_end, varied

SMALL = Device("a small one", (9, 0), 132, 2**30, 700 * 2**20)
FOUND = Findings((13, 0), "", (SMALL,), dict.fromkeys(PACKAGES, "1.0"))


def laid_out(disc, layers, precision) -> int:
    """Bytes that the layers take."""
    from femgal.kernels.cuda.device_layer import device_layer

    sizes: list[int] = []

    def put(array: np.ndarray) -> np.ndarray:
        sizes.append(array.nbytes)
        return array

    for layer in layers:
        device_layer(disc, layer, precision, put, finest=layer is layers[0])
    return sum(sizes)


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("build", [lambda disc: build_constant_hierarchy(disc, 8), build_linear_hierarchy])
@pytest.mark.parametrize("held", [0.0, 0.4])
def test_layers(precision, build, held, monkeypatch):
    needs_numba_cuda()
    mesh = distorted_box((24, 8, 8))
    disc = varied(mesh, left_end(mesh, held * 2.4) if held else ())
    layers = build(disc).layers
    # Nothing but the layers: no state, and no slots.
    monkeypatch.setattr(device_memory, "VECTORS", {})
    monkeypatch.setattr(device_memory, "OTHER_VECTORS", 0)
    monkeypatch.setattr(device_memory, "KINDS", 0)
    settings = SolverSettings.model_validate({"name": "fas", "precision": precision})
    assert 1.0 <= device_memory.array_bytes(settings, disc, layers) / laid_out(disc, layers, precision) <= 2.0


def test_what_does_not_fit_is_refused(monkeypatch):
    # There is no GPU here: whatever is put there fails in another way.
    small = replace(SMALL, free=device_memory.BASE // 2)
    monkeypatch.setattr(device, "find_devices", lambda: replace(FOUND, devices=(small,)))
    scene = load_scene("rabbit-drape", vertices=300, overrides={"solver.device": "cuda"})
    with pytest.raises(InputError, match="too little memory") as caught:
        Simulation.prepare(scene)
    text = str(caught.value)
    assert "0.50 GiB free" in text
    assert "a small one" in text
    assert "0.2 GiB free" in text
    assert "precision = 'float32'" in text
