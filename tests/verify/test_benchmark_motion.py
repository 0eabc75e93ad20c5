# SPDX-License-Identifier: BSD-3-Clause
"""Error and time of motions.

1. The trajectory error of a scaled motion is the scale's; of a free body the fall is taken out; one that is lost is
   infinitely wrong.
2. A study on a small beam: Verlet is closest to its own reference, errors fall with the substeps, single precision
   changes them by little, the reference's own error is a small part of the smallest.
3. What has been run is not run again; another row costs one run.
4. A run that fails is a row with its failure, not an end of the study.
5. Momenta of a turning and moving body are those of a rigid one.
6. The table has a cell for every head, and the command prints it; --json - is one JSON object.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

from femgal.cli import main
from femgal.scene.load import parse_scene
from meshes.errors import InputError
from tests.femgal.scenes import hanging_beam_text
from verify.benchmark.motion import Candidate, candidates, study
from verify.benchmark.motion_table import notes, table
from verify.benchmark.trajectory import momenta, trajectory_error
from verify.problems.bodies import rng


def test_trajectory_error():
    mass, motion = rng(500).random(20) + 0.1, rng(501).standard_normal((4, 20, 3))
    assert trajectory_error(mass, motion, motion) == 0.0
    assert trajectory_error(mass, 1.01 * motion, motion) == pytest.approx(0.01, rel=1e-10)
    fall = motion + 1e3 * np.arange(4)[:, None, None]
    wrong = fall + 0.01 * motion
    assert trajectory_error(mass, wrong, fall) < 1e-4
    centred = motion - np.einsum("i,fij->fj", mass, motion)[:, None] / mass.sum()
    expected = 0.01 * np.sqrt(np.einsum("i,fij->", mass, motion**2) / np.einsum("i,fij->", mass, centred**2))
    assert trajectory_error(mass, wrong, fall, free=True) == pytest.approx(expected, rel=1e-6)
    motion[2, 3, 1] = np.nan
    assert trajectory_error(mass, motion, fall) == np.inf


def test_momenta():
    mass, x = rng(502).random(20) + 0.1, rng(503).standard_normal((20, 3))
    speed, turn = np.array([1.0, -2.0, 0.5]), np.array([0.3, 0.1, -0.7])
    centre = mass @ x / mass.sum()
    found = momenta(mass, x, speed + np.cross(turn, x - centre))
    arm = x - centre
    inertia = np.einsum("i,ijk->jk", mass, (arm**2).sum(1)[:, None, None] * np.eye(3) - arm[:, :, None] * arm[:, None])
    assert found["linear_momentum"] == pytest.approx((mass.sum() * speed).tolist())
    assert found["angular_momentum"] == pytest.approx((inertia @ turn).tolist())


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    work, told = tmp_path_factory.mktemp("study"), []
    base = parse_scene(hanging_beam_text(frames=3, solver_lines="threads = 1"), "beam.toml")
    rows = candidates([5, 20], ["exact"], ["float64", "float32"], [("constant", 8)])
    found = study(base, rows, work, announce=told.append)
    return base, rows, work, found, told


def test_study(result):
    _, rows, _, found, _ = result
    error = {row["label"]: row["error"] for row in found["rows"]}
    assert list(error) == [str(row) for row in rows]
    assert error["verlet float64"] < error["clusters 8 exact 20 float64"] < error["clusters 8 exact 5 float64"]
    assert error["clusters 8 exact 5 float64"] < 0.5
    for name in ("exact 5", "exact 20"):
        both = [error[f"clusters 8 {name} {precision}"] for precision in ("float64", "float32")]
        assert both[0] == pytest.approx(both[1], rel=1e-2)
    assert found["reference"]["own_error"] < error["verlet float64"]
    assert all(row["growth"] < 0.01 for row in found["rows"])
    assert all(row["peak_mb"] > 50.0 for row in found["rows"])


def test_nothing_is_run_twice(result):
    base, rows, work, found, told = result
    assert len(told) == len(set(told)) == 1 + len(rows)
    again: list[str] = []
    more = [*rows, *candidates([10], ["exact"], ["float64"], [("constant", 8)])[1:]]
    repeated = study(base, more, work, announce=again.append)
    assert again == ["clusters 8 exact 10 float64"]
    assert [row["seconds"] for row in repeated["rows"][: len(rows)]] == [row["seconds"] for row in found["rows"]]


def test_a_failed_run_is_a_row(tmp_path):
    stiff = hanging_beam_text(frames=1, solver_lines="threads = 1").replace("E = 1e5", "E = 1e8")
    hopeless = Candidate((("name", "verlet"), ("substeps", 3), ("precision", "float64")))
    found = study(parse_scene(stiff, "beam.toml"), [hopeless], tmp_path)
    assert found["rows"][0]["error"] is None
    assert "frame 1" in found["rows"][0]["failure"]
    assert "failed" in table(found).rows[0]
    assert any(found["rows"][0]["failure"] in line for line in notes(found))


def test_rows_are_what_they_say(result):
    base = result[0]
    other = base.model_copy(update={"solver": base.solver.model_copy(update={"name": "verlet", "substeps": None})})
    row = candidates([7], ["spectral"], ["float32"], [("constant", 16)])[1]
    solver = row.scene(other).solver
    assert (solver.name, solver.substeps, solver.steps, solver.ratio) == ("fas", 7, "spectral", 16)


def test_variants():
    rows = candidates([7, 9], ["exact"], ["float64"], [("linear", 8)], [(), (("cycle", "V"), ("pre", 1))])
    labels = [str(row) for row in rows]
    assert labels[0] == "verlet float64"
    assert labels[1:3] == ["linear exact 7 float64", "linear exact 9 float64"]
    assert labels[3:] == ["linear exact 7 float64 cycle V pre 1", "linear exact 9 float64 cycle V pre 1"]
    base = parse_scene(hanging_beam_text(frames=1), "beam.toml")
    solver = rows[3].scene(base).solver
    assert (solver.cycle, solver.pre, solver.transfer) == ("V", 1, "linear")
    with pytest.raises(InputError, match="cycle"):
        Candidate((*rows[1].settings, ("cycle", "X"))).scene(base)


def test_table_and_command(result, tmp_path):
    base, _, work, found, _ = result
    drawn = table(found)
    assert len(drawn.rows) == len(found["rows"])
    assert all(len(row) == len(drawn.heads) for row in drawn.rows)
    path = tmp_path / "beam.toml"
    from femgal.scene.write import scene_to_toml

    path.write_text(scene_to_toml(base))
    arguments = [
        "bench",
        "motion",
        str(path),
        "--substeps",
        "5,20",
        "--ratio",
        "8",
        "--work",
        str(work),
        "--variant",
        "",
    ]
    result_of = CliRunner().invoke(main, [*arguments, "--json", "-"], catch_exceptions=False)
    assert result_of.exit_code == 0
    assert json.loads(result_of.stdout)["rows"][1]["error"] == found["rows"][1]["error"]
    shown = CliRunner().invoke(main, arguments, catch_exceptions=False)
    assert "clusters 8 exact 20 float64" in shown.stdout
    words = CliRunner().invoke(main, [*arguments, "--substeps", "fifty"], catch_exceptions=False)
    assert words.exit_code == 2
    assert "--substeps" in words.stderr
    bad = CliRunner().invoke(main, [*arguments, "--steps", "boldly"], catch_exceptions=False)
    assert bad.exit_code == 2
