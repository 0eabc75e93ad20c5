# SPDX-License-Identifier: BSD-3-Clause
"""Somebody else's result against the reference.

1. The reference's own motion, read back from every format, is right; its error is that of float32, and is the
   trajectory error of the benchmark.
2. Another order of the vertices is found by position, with its tetrahedra; numbers of vertices are the user's own.
3. Another mesh is refused with a hint: other vertices, other tetrahedra, another unit, elsewhere, turned.
4. A truncated result, one with a NaN, one that starts elsewhere and one that lacks frames are told apart.
5. Times that are no frames are refused.
6. Hints: another stiffness is found as a tempo, a shift by a frame, a turned sign, growing and lost energy.
7. Energies and momenta: with velocities against what the reference told, without them both from differences; of a
   result whose velocities are wrong only those rows fail.
8. Long steps and another material of femgal's own solver are judged rightly.
9. A reference that is not good enough judges nothing.
10. The table has a cell for every head; plots hold positive numbers; everything is JSON.
"""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from femgal.output.series import open_series
from femgal.simulation import Simulation
from meshes.errors import InputError
from meshes.generators import box
from meshes.types import TetMesh
from tests.verify.diagnosed import HELD, scene_of
from verify.benchmark.trajectory import trajectory_error
from verify.compare.comparison import compare_motion
from verify.compare.hints import hints
from verify.compare.plots import plots
from verify.compare.reference import find_reference
from verify.compare.result import ForeignMotion, read_motion
from verify.compare.rows import comparison_rows
from verify.compare.table import table, verdict
from verify.diagnose.target import target_of
from verify.suite.run import Status, run_row
from verify.suite.use import Use

FRAMES = 8


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    mesh = box((1.0, 0.3, 0.3), (8, 2, 2), jitter=0.1, seed=90281)
    more = "velocity = [0.0, 0.0, -1.0]\n" + HELD.format(x=0.01)
    described = scene_of(tmp_path_factory.mktemp("scene"), mesh, E=2e5, more=more)
    return described.model_copy(update={"frames": FRAMES})


@pytest.fixture(scope="module")
def reference(scene, tmp_path_factory):
    told: list[str] = []
    work = tmp_path_factory.mktemp("references")
    found = find_reference(target_of(scene), work, announce=told.append)
    assert len(told) == 2
    find_reference(target_of(scene), work, announce=told.append)
    assert len(told) == 2
    return found


def velocities(reference):
    """Good to second order: the reference does not keep its own."""
    return np.gradient(reference.x, reference.target.frame, axis=0)


def own(reference, **changes):
    """The reference's own motion as a result."""
    mesh = reference.target.disc.mesh
    motion = ForeignMotion("own", reference.times, reference.x.copy(), mesh.points, mesh.cells)
    return replace(motion, **changes)


def judged(comparison, tolerance=0.02):
    """Verdicts by name of the row."""
    results = [run_row(row, Use()) for row in comparison_rows(comparison, tolerance)]
    return {result.row.case.id.split("/")[1]: result for result in results}


def failed(comparison, tolerance=0.02):
    return {name for name, result in judged(comparison, tolerance).items() if result.status is Status.FAIL}


def shuffled(reference, seed=90283):
    """The reference's motion with its vertices in another order, and a mesh to write it with."""
    mesh = reference.target.disc.mesh
    order = np.random.default_rng(seed).permutation(len(mesh.points))
    place = np.argsort(order)
    return TetMesh(mesh.points[order], place[mesh.cells].astype(np.int32)), reference.x[:, order]


def test_the_right_motion(reference):
    same = compare_motion(own(reference), reference)
    assert same.error == 0.0
    assert 0.0 < same.own_error < 1e-3
    assert not failed(same)
    assert hints(same) == []
    rng = np.random.default_rng(90285)
    noisy = own(reference, x=reference.x + 1e-3 * rng.standard_normal(reference.x.shape))
    found = compare_motion(noisy, reference)
    start = reference.x[0]
    assert found.error == pytest.approx(trajectory_error(reference.mass, noisy.x - start, reference.x - start))
    row = found.worst
    assert found.largest.max() == found.largest[row]
    distance = np.linalg.norm(noisy.x - reference.x, axis=2)
    assert found.largest[row] == pytest.approx(distance.max())
    vertex = int(np.argmax(distance[row]))
    assert found.place(row)["rest_m"] == pytest.approx(reference.target.disc.mesh.points[vertex].tolist())


@pytest.mark.parametrize("format", ["vtkhdf", "vtu"])
def test_series_in_another_order(reference, tmp_path, format):
    mesh, x = shuffled(reference)
    writer = open_series(tmp_path, mesh, format=format)
    for k, time in enumerate(reference.times):
        writer.append(time, {"displacement": (x[k] - mesh.points).astype(np.float32)}, {}, {})
    writer.close()
    found = compare_motion(read_motion(tmp_path), reference)
    assert "another order" in found.aligned.matching.how
    assert found.error < 1e-6
    assert not failed(found)
    worst = found.place(found.worst)
    assert mesh.points[worst["vertex"]] == pytest.approx(np.array(worst["rest_m"]), abs=1e-6)


def test_points_that_move(reference, tmp_path):
    import meshio

    mesh, x = shuffled(reference)
    sets = []
    for k, time in enumerate(reference.times):
        meshio.Mesh(x[k], [("tetra", mesh.cells)]).write(tmp_path / f"{k}.vtu")
        sets.append(f'<DataSet timestep="{time}" part="0" file="{k}.vtu"/>')
    (tmp_path / "moved.pvd").write_text(
        f'<VTKFile type="Collection"><Collection>{"".join(sets)}</Collection></VTKFile>'
    )
    found = compare_motion(read_motion(tmp_path / "moved.pvd"), reference)
    assert found.error < 1e-6
    assert not failed(found)


def write_csv(path, reference, columns, x, rest=None, first=0):
    lines = [columns]
    for k in range(first, len(x)):
        for v in range(x.shape[1]):
            row = [k, v, *x[k, v], *(() if rest is None else rest[v])]
            lines.append(",".join(repr(float(number)) for number in row))
    np.random.default_rng(90287).shuffle(lines[1:])
    path.write_text("\n".join(lines) + "\n")
    return path


def test_tables(reference, tmp_path):
    X, numbers = reference.target.disc.mesh.points, reference.target.vertex_numbers
    in_file = np.empty_like(reference.x)
    in_file[:, numbers] = reference.x
    rest = np.empty_like(X)
    rest[numbers] = X
    plain = write_csv(tmp_path / "u.csv", reference, "frame,vertex,ux,uy,uz", in_file - rest)
    found = compare_motion(read_motion(plain), reference)
    assert found.error < 1e-12
    assert "as in the mesh file" in found.aligned.matching.how
    # Not the solver's order, or nothing was shown.
    assert not np.array_equal(numbers, np.arange(len(X)))
    mesh, x = shuffled(reference)
    for columns, values, places in (
        ("frame,vertex,x,y,z,X,Y,Z", x, mesh.points),
        ("frame,vertex,ux,uy,uz,X,Y,Z", x - mesh.points, mesh.points),
        ("frame,vertex,x,y,z", x, None),
    ):
        path = write_csv(tmp_path / "x.csv", reference, columns, values, places)
        assert compare_motion(read_motion(path), reference).error < 1e-9, columns
    without_start = write_csv(tmp_path / "late.csv", reference, "frame,vertex,ux,uy,uz", in_file - rest, first=1)
    found = compare_motion(read_motion(without_start), reference)
    assert judged(found)["start"].status is Status.SKIP
    assert not failed(found)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("frame,vertex,ux,uy\n0,0,0,0\n", "columns are missing"),
        ("vertex,ux,uy,uz\n0,0,0,0\n", "columns are missing"),
        ("frame,ux,uy,uz\n0,0,0,0\n", "no column of vertices"),
        ("frame,vertex,ux,uy,uz\n0,0,a,b,c\n", "not a table of numbers"),
        ("frame,vertex,ux,uy,uz\n0,0,0,0,0,0\n", "do not match"),
        ("frame,vertex,ux,uy,uz\n", "holds no frame"),
        ("", "holds no frame|empty"),
        ("frame,vertex,ux,uy,uz\n0,0,0,0,0\n0,1,0,0,0\n1,0,0,0,0\n", "not complete"),
        ("frame,vertex,ux,uy,uz\n0,0,0,0,0\n0,0,0,0,0\n", "not numbered from 0"),
    ],
)
def test_bad_tables(tmp_path, text, said):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=said):
        read_motion(path)


def test_another_mesh_is_refused(reference):
    mesh = reference.target.disc.mesh
    X = mesh.points
    fewer = own(reference, x=reference.x[:, :-1], rest=X[:-1], cells=None)
    with pytest.raises(InputError, match=f"{len(X) - 1} vertices"):
        compare_motion(fewer, reference)
    for rest, hint in (
        (1000.0 * X, "1000 times as large"),
        (X + np.array([0.0, 0.0, 2.0]), "stands elsewhere"),
        (X[:, [2, 0, 1]], "which axis points up"),
        (X + 0.05 * np.random.default_rng(90289).standard_normal(X.shape), "rest positions"),
    ):
        with pytest.raises(InputError, match="another mesh") as refused:
            compare_motion(own(reference, rest=rest), reference)
        assert hint in str(refused.value)
    flipped = mesh.cells.copy()
    flipped[0] = [v for v in range(5) if v not in set(mesh.cells[0].tolist())][:1] + mesh.cells[0, 1:].tolist()
    with pytest.raises(InputError, match="other tetrahedra"):
        compare_motion(own(reference, cells=flipped), reference)
    turned = compare_motion(own(reference, cells=mesh.cells[::-1, [1, 2, 3, 0]]), reference)
    assert turned.error == 0.0


def test_truncated_lost_and_displaced(reference):
    short = compare_motion(own(reference, x=reference.x[:5], times=reference.times[:5]), reference)
    assert failed(short) == {"frames"}
    assert "ends at frame 4 of 8" in judged(short)["frames"].note
    assert "up to frame 4" in verdict(short)
    x = reference.x.copy()
    x[3, 7, 1] = np.nan
    lost = compare_motion(own(reference, x=x), reference)
    assert {"frames", "trajectory"} <= failed(lost)
    assert "the first is 3" in judged(lost)["frames"].note
    assert "lost after frame 2" in verdict(lost)
    shifted = compare_motion(own(reference, x=reference.x + np.array([0.01, 0.0, 0.0])), reference)
    assert {"start", "trajectory"} <= failed(shifted)
    assert any("starts elsewhere" in hint for hint in hints(shifted))
    some = compare_motion(own(reference, x=reference.x[::2], times=reference.times[::2]), reference)
    assert not failed(some)
    assert "5 of the 9 frames" in judged(some)["frames"].note
    longer = own(reference, x=np.concatenate([reference.x, reference.x[-1:]]), times=np.arange(10) / 60.0)
    assert "after the end" in judged(compare_motion(longer, reference))["frames"].note


@pytest.mark.parametrize("times", [np.arange(9) / 50.0, np.arange(9) - 1.0, np.zeros(9), np.arange(9)[::-1] / 60.0])
def test_times_that_are_no_frames(reference, times):
    with pytest.raises(InputError):
        compare_motion(own(reference, times=times), reference)


def test_hints(reference):
    from scipy.interpolate import CubicSpline

    start = reference.x[0]
    spline = CubicSpline(np.arange(FRAMES + 1), reference.x - start)
    slower = compare_motion(own(reference, x=start + spline(0.8 * np.arange(FRAMES + 1))), reference)
    told = hints(slower)
    assert any("0.80" in hint and "E / rho 0.64" in hint for hint in told), told
    late = reference.x[np.maximum(np.arange(FRAMES + 1) - 1, 0)]
    assert any("one frame behind" in hint for hint in hints(compare_motion(own(reference, x=late), reference)))
    turned = compare_motion(own(reference, x=2.0 * start - reference.x), reference)
    assert any("signs" in hint for hint in hints(turned))
    twice = compare_motion(own(reference, x=2.0 * reference.x - start), reference)
    assert any("2.00 times as large" in hint for hint in hints(twice))


def test_energies_and_momenta(reference):
    kept = compare_motion(own(reference, v=velocities(reference)), reference)
    assert kept.ours.total[1:] == pytest.approx(kept.ours.total[0], rel=1e-3)
    assert kept.theirs.elastic == pytest.approx(kept.ours.elastic, rel=1e-4, abs=1e-6)
    without = compare_motion(own(reference), reference)
    assert np.isnan(without.ours.kinetic[-1])
    assert without.theirs.kinetic == pytest.approx(without.ours.kinetic, nan_ok=True)
    wrong = compare_motion(own(reference, v=1.5 * velocities(reference)), reference)
    assert failed(wrong, 0.1) == {"energy", "linear-momentum", "angular-momentum"}


def run_of(scene, **solver):
    """A run of femgal's own solver as a result."""
    settings = scene.solver.model_copy(update=solver)
    simulation = Simulation.prepare(scene.model_copy(update={"solver": settings}))
    states = [frame.state for frame in simulation.frames()]
    mesh = simulation.disc.mesh
    return ForeignMotion(
        "run",
        np.arange(len(states)) / scene.frames_per_second,
        np.stack([state.x for state in states]),
        mesh.points,
        mesh.cells,
        np.stack([state.v for state in states]),
    )


def test_runs_of_femgal(scene, reference):
    good = compare_motion(run_of(scene), reference)
    assert not failed(good)
    long_steps = compare_motion(run_of(scene, substeps=1), reference)
    assert long_steps.error > 5.0 * good.error
    assert {"trajectory", "energy"} <= failed(long_steps)
    assert any("lost" in hint for hint in hints(long_steps))
    softer = scene.model_copy(update={"bodies": (scene.bodies[0].model_copy(update={"E": 1e5}),)})
    other = compare_motion(run_of(softer), reference)
    assert {"trajectory", "energy"} <= failed(other)
    assert any("E / rho 0.5" in hint or "E / rho 0.4" in hint for hint in hints(other))
    exact = compare_motion(run_of(scene, name="verlet"), reference)
    assert exact.error < 10.0 * exact.own_error


def test_a_reference_that_is_not_good_enough(reference):
    poor = replace(reference, own=1e4 * reference.own)
    found = judged(compare_motion(own(reference), poor))
    assert found["reference"].status is Status.FAIL
    assert {found[name].status for name in ("trajectory", "energy", "linear-momentum")} == {Status.SKIP}


def test_what_is_shown(reference):
    lost = reference.x.copy()
    lost[6:] = np.nan
    for x in (reference.x, 1.01 * reference.x, lost):
        found = compare_motion(own(reference, x=x), reference)
        drawn = table(found, most=3)
        assert all(len(row) == len(drawn.heads) for row in drawn.rows)
        assert drawn.rows[-1][0] == str(FRAMES)
        content = json.loads(json.dumps(found.as_dict(), allow_nan=False))
        assert len(content["rows"]) == FRAMES + 1
        for plot in plots(found):
            assert all(min(curve.x + curve.y) > 0.0 for curve in plot.curves)
