# SPDX-License-Identifier: BSD-3-Clause
"""What the settings of a scene make of the mass that is stepped with, from the scene to the terminal.

1. Nothing is done, and nothing computed, for solvers without a stable step and for given substeps.
2. Verlet keeps the masses bit for bit unless told to scale them.
3. A sliver is warned of in the log, by `femgal plan` and on the terminal of a run; a good mesh is not.
4. Scaled mass is reported in the log, by `femgal plan` as a table and as JSON, and on the terminal, and 5 % is the
   share beyond which it is warned of.
5. A run with a sliver takes a third of the substeps with scaled mass, keeps its energy all the same, and resumes bit
   for bit.
6. Scaled mass without a step to lengthen is refused with advice, and so are shares out of range.
"""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from click.testing import CliRunner

from femgal.cli import main
from femgal.runner import run
from femgal.scene.load import load_scene
from femgal.scene.problems import SceneError
from femgal.simulation import Simulation
from femgal.timestep.build import prepare_mass
from meshes.io.tets import write_tets
from tests.femgal.slivers import box_with_slivers
from verify.problems.bodies import distorted_box, uniform

SCENE = """
name = "sliver"
frames = {frames}
[[bodies]]
mesh = "{mesh}"
E = 1e5
nu = 0.4
rho = 1000.0
velocity = [0.0, 0.0, 0.5]
[[constraints]]
where = {{halfspace = {{point = [0.01, 0.5, 0.5], normal = [-1, 0, 0]}}, relative = true}}
[solver]
name = "{solver}"
{lines}
[output]
fields = ["displacement"]
"""
WARNING = "1 of 867 tetrahedra keep the step of verlet from being twice as long"


@pytest.fixture(scope="module")
def mesh_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("meshes") / "sliver.msh"
    write_tets(path, box_with_slivers(1e-3, 1, (9, 4, 4)))
    return path


@pytest.fixture
def scene_file(tmp_path, mesh_file):
    def write(solver="verlet", lines="", frames=3):
        path = tmp_path / "sliver.toml"
        path.write_text(SCENE.format(mesh=mesh_file, solver=solver, lines=lines, frames=frames))
        return path

    return write


def settings(**values):
    name = values.pop("name", "verlet")
    return load_scene("cube-random", overrides={"solver.name": name, "solver.substeps": None}).solver.model_copy(
        update=values
    )


@pytest.mark.parametrize("values", [{"name": "fas"}, {"name": "jacobi"}, {"substeps": 100}])
def test_no_step_no_work(monkeypatch, values):
    def forbidden(*arguments):
        raise AssertionError("the stable step was looked at")

    disc = uniform(box_with_slivers(1e-4, 1, (9, 4, 4)))
    monkeypatch.setattr("femgal.timestep.build.element_stiffness", forbidden)
    assert prepare_mass(settings(**values), disc) == (disc, None, ())
    with pytest.raises(AssertionError, match="looked at"):
        prepare_mass(settings(), disc)


def test_masses_stay_unless_scaled():
    disc = uniform(distorted_box((9, 4, 4)))
    kept, scaling, warnings = prepare_mass(settings(), disc)
    assert kept is disc
    assert (scaling, warnings) == (None, ())
    heavy, scaling, warnings = prepare_mass(settings(mass_scaling=0.02), disc)
    assert heavy.mass.sum() == pytest.approx(1.02 * disc.mass.sum(), rel=1e-6)
    assert scaling is not None
    assert warnings == ()


@pytest.mark.parametrize(("share", "warned"), [(0.05, False), (0.051, True)])
def test_more_than_five_per_cent_is_warned_of(share, warned):
    _, _, warnings = prepare_mass(settings(mass_scaling=share), uniform(distorted_box((9, 4, 4))))
    assert len(warnings) == warned


def test_sliver_is_warned_of(scene_file, tmp_path):
    path = scene_file()
    result = CliRunner().invoke(main, ["run", str(path), "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    log = json.loads((tmp_path / "out" / "run.json").read_text())
    planned = CliRunner().invoke(main, ["plan", str(path)])
    for text in (result.stderr, planned.output, "\n".join(log["warnings"])):
        assert WARNING in text
    assert log["mass_scaling"] is None
    for lines in ("mass_scaling = 0.01", "substeps = 4000"):
        assert WARNING not in "\n".join(Simulation.prepare(load_scene(scene_file(lines=lines))).world.warnings)
    assert WARNING not in "\n".join(Simulation.prepare(load_scene(scene_file("jacobi"))).world.warnings)


def test_scaled_mass_is_reported(scene_file, tmp_path):
    path = scene_file(lines="mass_scaling = 0.06")
    result = CliRunner().invoke(main, ["run", str(path), "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    log = json.loads((tmp_path / "out" / "run.json").read_text())
    planned = json.loads(CliRunner().invoke(main, ["plan", str(path), "--json"]).stdout)
    assert planned["mass_scaling"] == log["mass_scaling"]
    found = log["mass_scaling"]
    assert (found["largest_share"], found["share"]) == pytest.approx((0.06, 0.06), rel=1e-6)
    assert found["added"] == pytest.approx(0.06 * found["mass"], rel=1e-6)
    kilograms = re.search(r"mass scaling: (\S+) kg \(6 %\) added at (\d+) vertices", result.stderr)
    assert kilograms is not None
    assert float(kilograms[1]) == pytest.approx(found["added"], rel=1e-3)
    assert int(kilograms[2]) == found["vertices"]
    row = next(row for row in log["plan"] if "mass scaling" in row)
    assert "runs" in row
    assert f"{found['vertices']} vertices" in row
    for text in (result.stderr, "\n".join(log["warnings"]), "\n".join(planned["warnings"])):
        assert "adds 6 % to the mass and weight" in text


def test_fewer_substeps_same_quality(scene_file, tmp_path):
    plain = run(load_scene(scene_file(frames=6)))
    scene = load_scene(scene_file(lines="mass_scaling = 0.01", frames=6))
    scaled = run(scene)
    assert (plain.status, scaled.status) == ("finished", "finished")
    assert plain.rows[-1]["substeps"] >= 3 * scaled.rows[-1]["substeps"]
    energies = np.array([row["total_energy"] for row in scaled.rows])
    assert np.abs(energies / energies[0] - 1.0).max() <= 0.01
    difference = np.linalg.norm(scaled.displacements[-1] - plain.displacements[-1])
    assert difference <= 0.02 * np.linalg.norm(plain.displacements[-1])
    run(scene.model_copy(update={"frames": 3}), tmp_path / "out")
    resumed = run(scene, tmp_path / "out", resume=True)
    assert resumed.state is not None
    assert scaled.state is not None
    assert resumed.state.x.tobytes() == scaled.state.x.tobytes()


@pytest.mark.parametrize(
    ("solver", "lines", "parts"),
    [
        ("fas", "mass_scaling = 0.01", ['found:   name = "fas"', 'name = "verlet", substeps left out', "leave mass"]),
        (
            "verlet",
            "mass_scaling = 0.01\nsubsteps = 9",
            ["found:   substeps = 9", "leave substeps or mass_scaling out"],
        ),
        ("verlet", "mass_scaling = 0", ["out of range", "0 < mass_scaling <= 1"]),
        ("verlet", "mass_scaling = 1.5", ["out of range", "0 < mass_scaling <= 1"]),
        ("verlet", "mass_scaling = true", ["wrong type"]),
    ],
)
def test_refusals(scene_file, solver, lines, parts):
    with pytest.raises(SceneError, match=r"solver\.mass_scaling") as error:
        load_scene(scene_file(solver, lines))
    for part in parts:
        assert part in str(error.value)
