# SPDX-License-Identifier: BSD-3-Clause
"""Grid files, their shorthand, and the lengths of motions.

1. The example is a grid, and its lists make all combinations.
2. Scene files count from the folder of the grid file; options replace keys of the file.
3. The shorthand makes the same tables: common choices go to the solvers that have the key and do not say otherwise,
   and Verlet takes its precision only.
4. Problems are every scene x size x material, the small ones first; bodies get the values, nothing else changes.
5. A motion is as long as is asked for; else periods of the lowest mode, capped by the scene, in frames that are at
   least so many; with both, frames so short that they are no more than these periods.
6. Bad grids and words are refused with what is allowed.
"""

from __future__ import annotations

import pytest

from meshes.errors import InputError
from tests.verify.bench_scenes import beam_file, beam_grid
from verify.work_precision.grid import EXAMPLE, SolverGrid, load_grid, make_grid
from verify.work_precision.horizon import LEAST_FRAMES, choose_horizon
from verify.work_precision.method import Method, check_name
from verify.work_precision.problem import problems
from verify.work_precision.shorthand import choices, numbers, solver_tables


def test_example(tmp_path):
    (tmp_path / "grid.toml").write_text(EXAMPLE)
    (tmp_path / "beam-drop.toml").write_text(beam_file(tmp_path).read_text())
    grid = load_grid(tmp_path / "grid.toml")
    methods = grid.methods()
    assert [method.curve for method in methods] == ["verlet"] + 10 * ["fas, bdf2"]
    assert str(methods[1]) == "fas stepping=bdf2 substeps=5 steps=exact"
    assert len({str(method) for method in methods}) == len(methods)
    found = problems(grid)
    assert len(found) == 2 * 2 * 2 * 2
    assert [dict(problem.axes)["vertices"] for problem in found] == 8 * [2000] + 8 * [20000]
    assert found[4].scene.bodies[0].mesh == "beam"


def test_options_replace_keys(tmp_path):
    (tmp_path / "grid.toml").write_text(EXAMPLE)
    grid = load_grid(tmp_path / "grid.toml", {"frames": 7, "scenes": ["rabbit-drape"], "E": [1e5]})
    assert (grid.frames, grid.scenes, grid.E, grid.rho) == (7, ("rabbit-drape",), (1e5,), (1.0, 1000.0))


def test_substeps_left_open_are_several():
    assert SolverGrid(name="verlet").methods() == [Method("verlet", (), "verlet")]
    assert len(SolverGrid(name="fas").methods()) > 3
    assert [m.settings for m in SolverGrid(name="fas", substeps=4).methods()] == [(("substeps", 4),)]
    assert {key for m in SolverGrid(name="auto").methods() for key, _ in m.settings} == {"accuracy"}


def test_step_lengths_are_one_value():
    methods = SolverGrid(name="fas", substeps=4, steps=["exact", [0.25, 0.5]]).methods()
    assert [dict(method.settings)["steps"] for method in methods] == ["exact", (0.25, 0.5)]


def test_choices():
    assert choices("5, 10") == [5, 10]
    assert choices("exact,[0.25,0.5],1e4,true") == ["exact", [0.25, 0.5], 1e4, True]
    assert numbers("1,1e3", "--rho") == [1, 1000.0]
    with pytest.raises(InputError, match="not a list of numbers"):
        numbers("1,many", "--rho")


def test_shorthand():
    tables = solver_tables(
        ["verlet", "fas"],
        ["fas label=mine cycle=V pre=1 substeps=7"],
        {"substeps": [5, 10], "precision": ["float32"], "steps": ["exact", "spectral"]},
    )
    assert tables == [
        {"name": "verlet", "precision": ["float32"]},
        {"name": "fas", "substeps": [5, 10], "precision": ["float32"], "steps": ["exact", "spectral"]},
        {
            "name": "fas",
            "label": "mine",
            "cycle": ["V"],
            "pre": [1],
            "substeps": [7],
            "precision": ["float32"],
            "steps": ["exact", "spectral"],
        },
    ]
    grid = make_grid({"scenes": ["rabbit-drape"], "solvers": tables}, "typed")
    assert len(grid.methods()) == 1 + 4 + 2
    base = problems(grid)[0].scene
    assert grid.methods()[-1].scene(base, 1).solver.cycle == "V"


@pytest.mark.parametrize(
    ("names", "specs", "common", "expected"),
    [
        (["magic"], [], {}, "no such solver"),
        (["vrlet"], [], {}, "did you mean verlet?"),
        (["fas"], [], {"accuracy": [0.1]}, "no solver of this grid has such a key"),
        (["fas"], [], {"colour": ["red"]}, "no solver of this grid has such a key"),
        ([], ["fas substeps"], {}, "not a choice"),
        ([], ["fas 'substeps=5"], {}, "not a solver"),
    ],
)
def test_bad_words(names, specs, common, expected):
    with pytest.raises(InputError) as caught:
        solver_tables(names, specs, common)
    assert expected in str(caught.value)


def test_check_name_lists_all():
    with pytest.raises(InputError, match=r"allowed: fas, .*verlet"):
        check_name("magic", "here")


def test_problems_change_what_they_say(tmp_path):
    found = problems(beam_grid(tmp_path, [{"name": "fas"}], E=[1e4, 1e6], rho=[1.0], set={"damping": 0.5}))
    assert [problem.id for problem in found] == ["hanging-beam E=10000 rho=1", "hanging-beam E=1e+06 rho=1"]
    body, scene = found[1].scene.bodies[0], found[1].scene
    assert (body.E, body.rho, body.nu, body.vertices, scene.damping) == (1e6, 1.0, 0.4, 400, 0.5)
    assert scene.solver.ratio == 32  # the scene's own solver is none of the grid's
    assert not found[0].is_chaotic
    bad = problems(beam_grid(tmp_path, [{"name": "fas"}], slivers=[10.0, 1.0]))
    assert [problem.id for problem in bad] == ["hanging-beam slivers=10", "hanging-beam slivers=1"]
    assert [problem.scene.bodies[0].slivers for problem in bad] == [10.0, 1.0]
    assert dict(bad[1].axes) == {"vertices": None, "slivers": 1.0, "E": None, "nu": None, "rho": None}
    assert problems(make_grid({"scenes": ["cube-random"], "solvers": [{"name": "fas"}]}, ""))[0].is_chaotic


def test_horizon(tmp_path):
    scene = problems(beam_grid(tmp_path, [{"name": "fas"}]))[0].scene.model_copy(update={"frames": 60})
    assert choose_horizon(scene, 0.3, 5.0, 9).frames == 9
    assert choose_horizon(scene, None, 5.0, None).frames == 60
    assert choose_horizon(scene, 0.1, 5.0, None).frames == 30
    assert choose_horizon(scene, 4.0, 5.0, None).frames == 60
    assert choose_horizon(scene, 0.1, None, None).frames == 30
    assert choose_horizon(scene, 0.1, None, 9).frames_per_second == scene.frames_per_second
    few = choose_horizon(scene, 0.03, 0.5, 4)
    assert (few.frames, few.frames_per_second) == (4, 266.7)
    assert choose_horizon(scene, 3.0, 0.5, 4).frames_per_second == scene.frames_per_second
    assert choose_horizon(scene, None, 0.5, 4).frames == 4
    stiff = choose_horizon(scene, 1e-3, 5.0, None)
    assert stiff.frames == LEAST_FRAMES
    assert stiff.seconds == pytest.approx(5e-3, rel=1e-3)
    shortened = stiff.of(scene)
    assert (shortened.frames, shortened.frames_per_second) == (stiff.frames, stiff.frames_per_second)
    assert stiff.as_dict()["periods"] == pytest.approx(5.0, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "expected"), [("scenes = [", "not valid TOML"), ("scenes = 3\n[[solvers]]\nname='fas'", "scenes")]
)
def test_bad_files(text, expected, tmp_path):
    path = tmp_path / "grid.toml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_grid(path)
    assert expected in str(caught.value)
    with pytest.raises(InputError, match="cannot be read"):
        load_grid(tmp_path / "missing.toml")
