# SPDX-License-Identifier: BSD-3-Clause
"""What a scene file may and may not say.

1. A minimal scene gets the documented defaults.
2. Every value outside its range or of another type is refused, naming its key, the value and what is allowed.
3. Choices that exclude one another are refused when given together, and when none is given where one is needed.
4. Everything that may be written in two ways means the same.
5. A scene never changes after it was read.
6. The linear transfer has ratio 8, given or not; the constant one has 32 when none is given. Cycles that go down first
   smooth there, when not told otherwise.
"""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from femgal.scene.load import parse_scene
from femgal.scene.problems import SceneError

BODY = 'mesh = "cube"\nE = 1e6\nnu = 0.4\nrho = 1000.0\n'
HELD = "[[constraints]]\nwhere = { all = true }\n"


def scene(top: str = "", body: str = "", rest: str = ""):
    return parse_scene(f"{top}\n[[bodies]]\n{BODY}{body}\n{rest}", "my.toml")


def replaced(key: str, value: str):
    lines = [f"{key} = {value}" if line.startswith(f"{key} =") else line for line in BODY.splitlines()]
    return parse_scene("[[bodies]]\n" + "\n".join(lines), "my.toml")


def test_defaults():
    found = scene()
    assert (found.frames, found.frames_per_second, found.gravity) == (60, 60.0, (0.0, 0.0, -9.81))
    assert (found.name, found.damping, found.constraints) == ("my", 0.0, ())
    assert (found.solver.name, found.solver.steps, found.solver.ratio) == ("fas", "exact", 32)
    assert (found.solver.substeps, found.solver.iterations, found.solver.layers) == (None, 1, "full")
    assert found.output.fields == ("displacement", "velocity", "von_mises")
    assert (found.bodies[0].up, found.bodies[0].initial.kind) == ("z", "rest")


@pytest.mark.parametrize(
    ("key", "value", "parts"),
    [
        ("E", "0.0", ["bodies[0].E: out of range", "0 < E [Pa]"]),
        ("E", "-5.0", ["bodies[0].E: out of range", "found:   -5.0", "0 < E [Pa]"]),
        ("E", "inf", ["bodies[0].E: not a finite number", "0 < E [Pa]"]),
        ("E", '"1e6"', ["bodies[0].E: wrong type", 'found:   "1e6"']),
        ("E", "true", ["bodies[0].E: wrong type", "found:   true"]),
        ("nu", "0.5", ["bodies[0].nu: out of range", "-1 < nu < 0.5"]),
        ("nu", "-1.0", ["bodies[0].nu: out of range", "-1 < nu < 0.5"]),
        ("rho", "0", ["bodies[0].rho: out of range", "0 < rho [kg/m^3]"]),
        ("mesh", '""', ["bodies[0].mesh", "a catalogue name or the path of a mesh file"]),
        ("mesh", "7", ["bodies[0].mesh: wrong type"]),
    ],
)
def test_material_out_of_range(key, value, parts):
    with pytest.raises(SceneError) as error:
        replaced(key, value)
    for part in ["my.toml: 1 problem", *parts]:
        assert part in str(error.value)


@pytest.mark.parametrize(
    ("top", "body", "rest", "parts"),
    [
        ("frames = 0", "", "", ["frames: out of range", "1 <= frames, an integer"]),
        ("frames = 1.5", "", "", ["frames: wrong type", "1 <= frames, an integer"]),
        ("frames_per_second = 0", "", "", ["frames_per_second", "1e-06"]),
        ("gravity = [0, 0]", "", "", ["gravity: not three finite numbers", "[x, y, z] [m/s^2]"]),
        ("gravity = [0, 0, nan]", "", "", ["gravity: not three finite numbers"]),
        (f"gravity = [0, 0, {10**400}]", "", "", ["gravity: not three finite numbers"]),
        (f"damping = {10**400}", "", "", ["damping: "]),
        ("gravity = -9.81", "", "", ["gravity: not three finite numbers", "found:   -9.81"]),
        ("damping = -1", "", "", ["0 <= damping [1/s]"]),
        ("name = 3", "", "", ["name: wrong type", "text in quotes"]),
        ("", "vertices = 7", "", ["bodies[0].vertices", "8 <= vertices, an integer"]),
        ("", "height = 0", "", ["0 < height <= 1e+09 [m]"]),
        ("", "size = -1", "", ["0 < size <= 1e+09 [m]"]),
        ("", 'up = "w"', "", ["bodies[0].up", '"x", "y", "z"']),
        ("", "translate = [1, 2, 3, 4]", "", ["bodies[0].translate", "[m]"]),
        ("", "rotate = [{axis = 'x'}]", "", ["bodies[0].rotate[0].degrees: required key is missing", "[degrees]"]),
        ("", "rotate = [{axis = [0, 0, 0], degrees = 3}]", "", ["rotate[0].axis: a direction of length zero"]),
        ("", "rotate = [{axis = 'q', degrees = 3}]", "", ["rotate[0].axis: not a direction", '"x", "y", "z" or three']),
        ("", "rotate = [5]", "", ["bodies[0].rotate[0]: wrong type", "a table with keys from: axis, degrees"]),
        ("", "velocity = ['a', 0, 0]", "", ["bodies[0].velocity", "[m/s]"]),
        ("", "initial = { scale = 2 }", "", ["bodies[0].initial.kind: required key is missing", "random"]),
        ("", "initial = { kind = 'rnadom' }", "", ["initial.kind: not one of", "did you mean random?"]),
        ("", "initial = { kind = 3 }", "", ["initial.kind: not one of", "found:   3"]),
        ("", "initial = 'random'", "", ["bodies[0].initial", '"random"']),
        ("", "initial = { kind = 'random', scale = 0 }", "", ["bodies[0].initial.scale", "0 < scale"]),
        ("", "initial = { kind = 'random', seed = -1 }", "", ["bodies[0].initial.seed", "0 <= seed, an integer"]),
        ("", "initial = { kind = 'flat', thickness = -1 }", "", ["0 <= thickness [m]"]),
        ("", "initial = { kind = 'rest', seed = 3 }", "", ["bodies[0].initial.seed: unknown key", "kind"]),
        ("", "initial = { kind = 'stretched', pulls = [] }", "", ["initial.pulls: the list is empty", "at least one"]),
        ("", "regions = [{ E = 1.0 }]", "", ["bodies[0].regions[0]: give either id or where"]),
        ("", "regions = [{ id = 1, where = {all = true}, E = 1.0 }]", "", ["exactly one of id, where"]),
        ("", "regions = [{ id = 1 }]", "", ["regions[0]: changes nothing", "at least one of E, nu, rho"]),
        ("", "regions = [{ id = 1, E = -1.0 }]", "", ["bodies[0].regions[0].E", "0 < E [Pa]"]),
        ("", "height = 1.0\nsize = 1.0", "", ["bodies[0]: height and size both scale", "one of height, size"]),
    ],
)
def test_bodies_and_globals(top, body, rest, parts):
    with pytest.raises(SceneError) as error:
        scene(top, body, rest)
    for part in ["my.toml: 1 problem", *parts]:
        assert part in str(error.value)


def constraint(text: str) -> str:
    return f"[[constraints]]\n{text}"


@pytest.mark.parametrize(
    ("rest", "parts"),
    [
        (constraint("body = 0"), ["constraints[0].where: required key is missing", "box, sphere, halfspace"]),
        (constraint("where = {}"), ["constraints[0].where: not one selection", "exactly one of box, sphere"]),
        (constraint("where = { all = false }"), ["constraints[0].where: not one selection"]),
        (constraint("where = { all = true, none = true }"), ["constraints[0].where: not one selection"]),
        (constraint("where = { all = 1 }"), ["constraints[0].where.all: wrong type", "true or false"]),
        (constraint("where = { box = { min = [0, 0, 2], max = [1, 1, 1] } }"), ["min is above max", "min <= max"]),
        (constraint("where = { box = { min = [0, 0, 0] } }"), ["constraints[0].where.box.max: required"]),
        (constraint("where = { sphere = { center = [0, 0, 0], radius = 0 } }"), ["0 < radius <= 1e+09 [m]"]),
        (constraint("where = { halfspace = { point = [0, 0, 0], normal = [0, 0, 0] } }"), ["length zero"]),
        (constraint("where = { tip = { direction = 'z', depth = 0 } }"), ["where.tip.depth", "0 < depth <= 1e+09 [m]"]),
        (constraint("where = { all = true }\nbody = 1"), ["constraints[0].body: no such body", "0 <= body <= 0"]),
        (constraint("where = { all = true }\nbody = -1"), ["constraints[0].body", "0 <= body"]),
    ],
)
def test_selectors(rest, parts):
    with pytest.raises(SceneError) as error:
        scene(rest=rest)
    for part in ["my.toml: 1 problem", *parts]:
        assert part in str(error.value)


@pytest.mark.parametrize(
    ("path", "parts"),
    [
        ("path = { times = [0, 0], offsets = [[0, 0, 0], [1, 0, 0]] }", ["path.times: times do not increase", "later"]),
        ("path = { times = [1, 0], offsets = [[0, 0, 0], [1, 0, 0]] }", ["path.times", "found:   [1, 0]"]),
        ("path = { times = [], offsets = [] }", ["path.times", "one or more times [s]"]),
        ("path = { times = [0, 1], offsets = [[0, 0, 0]] }", ["lists differ in length", "2 times, 1 offsets"]),
        ("path = { times = [0], offsets = [[0, 0]] }", ["path.offsets[0]: not three finite numbers"]),
        ("path = { times = [0], offsets = [[0, 0, 0]], kind = 'linear' }", ["path.kind", "unknown"]),
        ("rotation = { times = [0, 1], degrees = [0], axis = 'x' }", ["as many degrees as times"]),
        ("rotation = { times = [0], degrees = [0] }", ["constraints[0].rotation.axis: required key is missing"]),
        ("rotation = { times = [0], degrees = ['a'], axis = 'x' }", ["rotation.degrees[0]: wrong type"]),
    ],
)
def test_paths(path, parts):
    with pytest.raises(SceneError) as error:
        scene(rest=HELD + path)
    for part in ["my.toml: 1 problem", "constraints[0]", *parts]:
        assert part in str(error.value)


@pytest.mark.parametrize(
    ("rest", "parts"),
    [
        ("[solver]\nname = 'jacbi'", ["solver.name", '"scalar-jacobi"', "did you mean jacobi?"]),
        ("[solver]\nsubsteps = 0", ["1 <= substeps <= 1e+07, an integer"]),
        ("[solver]\niterations = 0", ["1 <= iterations, an integer"]),
        ("[solver]\ntolerance = 0.0", ["0 < tolerance [m]"]),
        ("[solver]\nratio = 1", ["2 <= ratio, an integer"]),
        ("[solver]\ntransfer = 'cubic'", ["solver.transfer", '"constant", "linear"']),
        (
            "[solver]\ntransfer = 'linear'\nratio = 32",
            [
                "solver.ratio: each lattice",
                "found:   32",
                '8 with transfer = "linear"',
                "leave ratio out, or set it to 8",
            ],
        ),
        ("[solver]\ntransfer = 'linear'\nratio = 1", ["2 <= ratio, an integer"]),
        ("[solver]\nlayers = -1", ["solver.layers", '"full" or an integer >= 0']),
        ("[solver]\nlayers = true", ["solver.layers", "found:   true"]),
        ("[solver]\nsteps = [0.25, 2.0]", ["solver.steps", "0 < w < 2"]),
        ("[solver]\nsteps = [0.25]", ["solver.steps", "[w_coarse, w_fine]"]),
        ("[solver]\nsteps = 'backtrack'", ["solver.steps", '"backtracking"']),
        ("[solver]\ncycle = 'v'", ["solver.cycle", '"coarse-to-fine", "V", "F", "W"', "did you mean V?"]),
        ("[solver]\npre = -1", ["0 <= pre, an integer"]),
        ("[solver]\npost = 1.5", ["solver.post: wrong type", "0 <= post, an integer"]),
        ("[solver]\npre = 1", ["solver.pre: this cycle does not go down", "found:   1", 'set cycle = "V"']),
        ("[solver]\npost = 0", ["solver.post: smooths nothing", "found:   0", "at least 1 where pre = 0"]),
        ("[solver]\ncycle = 'W'\npre = 0\npost = 0", ["solver.post: smooths nothing"]),
        ("[solver]\nchebyshev = 1.0\niterations = 2", ["solver.chebyshev", '"auto" or a number between 0 and 1']),
        ("[solver]\nchebyshev = 0\niterations = 2", ["solver.chebyshev: not a spectral radius", "found:   0"]),
        ("[solver]\nchebyshev = true\niterations = 2", ["solver.chebyshev", "found:   true"]),
        (
            "[solver]\nchebyshev = 'auto'",
            ["solver.chebyshev", "one iteration has none before it", "found:   auto", "raise iterations"],
        ),
        (
            "[solver]\nname = 'verlet'\nchebyshev = 0.9\niterations = 3",
            ["solver.chebyshev", "verlet does not iterate", "found:   0.9", "leave it out"],
        ),
        ("[solver]\nsafety = 1.1", ["0 < safety <= 1"]),
        ("[solver]\nthreads = 0", ["1 <= threads, an integer"]),
        ("[output]\nformat = 'vtk'", ["output.format", '"vtkhdf", "vtu"']),
        ("[output]\nevery = 0", ["1 <= every, an integer"]),
        ("[output]\ncheckpoint_every = 0", ["1 <= checkpoint_every, an integer"]),
        ("[output]\nfields = ['displacment']", ["output.fields: ", "displacment", "displacement"]),
        ("[output]\nfields = 'J'", ["output.fields: wrong type", "a list of field names"]),
    ],
)
def test_solver_and_output(rest, parts):
    with pytest.raises(SceneError) as error:
        scene(rest=rest)
    for part in ["my.toml: 1 problem", *parts]:
        assert part in str(error.value)


def test_a_scene_needs_bodies():
    with pytest.raises(SceneError, match=r"bodies: required key is missing\n    allowed: at least one \[\[bodies\]\]"):
        parse_scene("frames = 3", "my.toml")
    with pytest.raises(SceneError, match="bodies: the list is empty"):
        parse_scene("bodies = []", "my.toml")
    with pytest.raises(SceneError, match="bodies: wrong type"):
        parse_scene("[bodies]\n" + BODY, "my.toml")


def test_axis_letters_are_vectors():
    letter, vector = (scene(body=f"rotate = [{{ axis = {axis}, degrees = 90 }}]") for axis in ("'y'", "[0, 1, 0]"))
    assert letter == vector


def test_integers_count_as_numbers():
    assert scene("gravity = [0, 0, -9]") == scene("gravity = [0.0, 0.0, -9.0]")


def test_solver_choices_are_kept():
    found = scene(rest="[solver]\nsteps = [0.25, 0.5]\nlayers = 2\nname = 'verlet'\nsafety = 1").solver
    assert (found.steps, found.layers, found.name, found.safety) == ((0.25, 0.5), 2, "verlet", 1.0)


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ("", ("constant", 32)),
        ("transfer = 'constant'", ("constant", 32)),
        ("ratio = 8", ("constant", 8)),
        ("transfer = 'linear'", ("linear", 8)),
        ("transfer = 'linear'\nratio = 8", ("linear", 8)),
    ],
)
def test_transfer_and_ratio(lines, expected):
    solver = scene(rest=f"[solver]\n{lines}").solver
    assert (solver.transfer, solver.ratio) == expected


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ("", ("coarse-to-fine", 0, 1)),
        ("post = 3", ("coarse-to-fine", 0, 3)),
        ("cycle = 'V'", ("V", 1, 1)),
        ("cycle = 'F'\npre = 2", ("F", 2, 1)),
        ("cycle = 'W'\npre = 0\npost = 2", ("W", 0, 2)),
        ("cycle = 'coarse-to-fine'\npre = 0", ("coarse-to-fine", 0, 1)),
    ],
)
def test_cycle_and_counts(lines, expected):
    solver = scene(rest=f"[solver]\n{lines}").solver
    assert (solver.cycle, solver.pre, solver.post) == expected


def test_scenes_are_frozen():
    with pytest.raises(ValidationError, match="frozen"):
        scene().frames = 3
