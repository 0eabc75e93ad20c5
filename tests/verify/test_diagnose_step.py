# SPDX-License-Identifier: BSD-3-Clause
"""What is said about steps, solvers, single precision, material and memory.

1. The stable step is 2 / omega_max of the dense eigenvalue problem; with a sliver it is that without the sliver that
   is told beside it, and the sliver is the worst element by its number in the file.
2. The mass share that is said to double the step does.
3. Soft bodies are for explicit steps, stiff and light ones are not.
4. The noise of float32 forces is what an independent difference shows; slivers raise it; it grows with nothing but
   turning where the body is not strained; small strains make it matter.
5. nu <= 0 and bodies that are too soft for their weight are told.
6. The arrays that are counted are those of the run.
7. Nothing breaks where every vertex is held.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from femgal.kernels.cpu.backend import CpuBackend
from tests.femgal.slivers import box_with_slivers, largest_frequency
from tests.verify.diagnosed import HELD, block, target
from verify.diagnose import material, memory, regime, rounding, step
from verify.diagnose.diagnosis import diagnose
from verify.diagnose.finding import Severity, plain, shown


def test_stable_step_and_its_worst_element(tmp_path):
    mesh = box_with_slivers(1e-3, cells=(9, 6, 6))
    bad = target(tmp_path, mesh)
    found = step.stable_step(bad)
    assert found.step == pytest.approx(2.0 / largest_frequency(bad.disc), rel=0.03)
    assert found.few >= 1
    sliver = int(np.argmin(mesh.volumes))
    told = step.explicit_step(bad, found)
    assert told.severity is Severity.WARNING
    assert told.numbers["worst"][0] == sliver
    without = replace(bad.disc, Vmu=bad.disc.Vmu.copy(), Vlam=bad.disc.Vlam.copy())
    without.Vmu[found.worst], without.Vlam[found.worst] = 0.0, 0.0
    assert found.without > 1.5 * found.step
    assert told.numbers["substeps_per_frame"] == math.ceil(1.0 / 60.0 / (0.9 * found.step))


def test_mass_that_doubles_the_step(tmp_path):
    bad = target(tmp_path, box_with_slivers(1e-3, cells=(9, 6, 6)))
    share = step.stable_step(bad).share_twice
    scaled = bad.scene.model_copy(
        update={"solver": bad.scene.solver.model_copy(update={"name": "verlet", "mass_scaling": 1.001 * share})}
    )
    from femgal.simulation import Simulation

    scaling = Simulation.prepare(scaled).mass_scaling
    assert scaling.step == pytest.approx(2.0 * scaling.step_before, rel=1e-2)


def test_good_mesh(tmp_path):
    good = target(tmp_path, block())
    found = step.stable_step(good)
    assert found.few == 0
    assert step.explicit_step(good, found).severity is Severity.OK


def test_regimes(tmp_path):
    soft = target(tmp_path, block(), E=1e5)
    found = regime.regime(soft, step.stable_step(soft))
    assert found.severity is Severity.NOTE
    assert "verlet" in found.advice
    light = target(tmp_path, block(), E=1e9, rho=1.0)
    found = regime.regime(light, step.stable_step(light))
    assert "Stiff and light" in found.what
    assert found.numbers["wave_speed_m_s"] == pytest.approx(1e9**0.5)
    assert found.numbers["wave_crossings_per_frame"] == pytest.approx(1e9**0.5 / 60.0)


def test_noise_of_single_precision(tmp_path):
    good, bad = target(tmp_path, block()), target(tmp_path, box_with_slivers(1e-4))
    noise = rounding.force_noise(good, 1e-2)
    assert noise["rest"].largest == 0.0
    assert 1e-10 < noise["strained"].rms < 1e-6
    assert rounding.force_noise(bad, 1e-2)["strained"].largest > 5.0 * noise["strained"].largest
    # One vertex by hand.
    X = good.disc.mesh.points
    x = rounding._strained(X, 1e-2)
    difference = CpuBackend(good.disc, 1, precision="float32").gradient(x) - CpuBackend(good.disc, 1).gradient(x)
    v = 7
    cells, D = good.disc.mesh.cells, good.disc.B.reshape(-1, 3, 3)
    force = 0.0
    for e in np.flatnonzero((cells == v).any(axis=1)):
        k = int(np.flatnonzero(cells[e] == v)[0])
        gradient = -D[e].sum(axis=0) if k == 0 else D[e, k - 1]
        force += 1e6 * good.disc.V[e] * np.linalg.norm(gradient)
    assert rounding._force_per_strain(good)[v] == pytest.approx(force)
    assert np.linalg.norm(difference[v]) / force <= noise["strained"].largest * (1.0 + 1e-12)


def test_float32_matters_where_strains_are_small(tmp_path):
    usual, stiff = target(tmp_path, block(), E=1e5), target(tmp_path, block(), E=1e13)
    assert rounding.precision(usual).severity is Severity.OK
    found = rounding.precision(stiff)
    assert found.severity is Severity.NOTE
    assert "float64" in found.advice
    solver = stiff.scene.solver.model_copy(update={"precision": "float32"})
    single = replace(stiff, scene=stiff.scene.model_copy(update={"solver": solver}))
    assert rounding.precision(single).severity in (Severity.WARNING, Severity.PROBLEM)


def test_positions_in_single_precision(tmp_path):
    # 0.7 m and 100 substeps: h^2 g is nine half units in the last place, and some 10 % of gravity is lost.
    mesh = block()
    body = target(tmp_path, mesh.moved(0.7 * mesh.points))
    _, numbers = rounding._positions(body, 100)
    assert numbers["increment_in_half_ulps"] == pytest.approx(9.14, abs=0.01)


def test_material(tmp_path):
    assert material.poisson(target(tmp_path, block(), nu=0.3)).severity is Severity.OK
    assert material.poisson(target(tmp_path, block(), nu=-0.1)).severity is Severity.WARNING
    assert material.parameters(target(tmp_path, block())).severity is Severity.OK
    heap = material.parameters(target(tmp_path, block(), E=1e4))
    assert heap.severity is Severity.WARNING
    assert heap.numbers["weight_strain"] == pytest.approx(0.981)


def test_memory(tmp_path):
    body = target(tmp_path, block())
    found = memory.memory(body)
    own = sum(getattr(body.disc, name).nbytes for name in ("B", "V", "mu", "lam", "Vmu", "Vlam", "mass", "free"))
    assert own < found.numbers["arrays_bytes"] < 20 * own
    once = np.zeros(100)
    assert memory.array_bytes([once, once, {"view": once[10:]}]) == once.nbytes


def test_everything_held(tmp_path):
    from verify.diagnose.target import Target

    body = target(tmp_path, block(), more=HELD.format(x=0.9))
    held = Target(body.scene, body.world, replace(body.disc, free=np.zeros_like(body.disc.free)))
    found = step.stable_step(held)
    assert math.isinf(found.step)
    for finding in (step.explicit_step(held, found), regime.regime(held, found), rounding.precision(held)):
        assert finding.severity is Severity.OK


def test_diagnosis_is_data(tmp_path):
    import json

    told: list[str] = []
    found = diagnose(target(tmp_path, box_with_slivers(1e-3), nu=-0.1), told.append)
    content = json.loads(json.dumps(found.as_dict(), allow_nan=False))
    assert len(told) == 4
    assert found.worst is Severity.WARNING or found.worst is Severity.PROBLEM
    topics = [one["topic"] for one in content["findings"]]
    assert topics.count("sign of nu") == 1
    assert sum(content["counts"].values()) == len(topics) == len(set(topics))


def test_numbers_as_people_write_them():
    assert [shown(x) for x in (860.4, 1234.0, 0.0123, 3.4e-7, 0.0, 99.6)] == [
        "860",
        "1,200",
        "0.012",
        "3.4e-07",
        "0",
        "100",
    ]
    assert plain({"a": np.array([1, 2]), "b": np.inf, "c": (np.float64(2.0),)}) == {"a": [1, 2], "b": "inf", "c": [2.0]}
