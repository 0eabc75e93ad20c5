# SPDX-License-Identifier: BSD-3-Clause
"""`femgal verify --compare`.

1. A run of femgal is judged against the reference: a table of the frames, a verdict, rows, exit code 0; all of it is in
   the record, and no folder is. The reference is kept for the next time.
2. A run of another material is exit code 1 with a hint; a wider tolerance lets it pass.
3. What does not belong together is exit code 2: another mesh, no scene, no result, options of the suite.
"""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from femgal.cli import main
from tests.femgal.scenes import hanging_beam_text


def run(*arguments):
    return CliRunner().invoke(main, [*map(str, arguments)], catch_exceptions=False)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "beam.toml"
    path.write_text(hanging_beam_text(frames=6, solver_lines="substeps = 20\nthreads = 1"))
    return path


@pytest.fixture(scope="module")
def good(scene):
    out = scene.parent / "good"
    assert run("run", scene, "--out", out).exit_code == 0
    return out


def test_a_good_run(scene, good, tmp_path):
    record = tmp_path / "record.json"
    done = run("verify", "--compare", good, "--scene", scene, "--json", record)
    assert done.exit_code == 0, done.output
    assert "PASS  compare/trajectory" in done.stdout
    assert "of the motion over its 7 frames" in done.stdout
    text = record.read_text()
    comparison = json.loads(text)["comparison"]
    assert comparison["error"] < 0.02
    assert [row["frame"] for row in comparison["rows"]] == list(range(7))
    assert comparison["velocities"] == "from the result"
    assert str(tmp_path) not in text
    again = run("verify", "--compare", good, "--scene", scene, "--json", "-")
    assert json.loads(again.stdout)["comparison"]["error"] == comparison["error"]
    assert "reference (" not in again.stderr


def test_another_material(scene, good):
    softer = run("verify", "--compare", good, "--scene", scene, "--set", "bodies.0.E=4e5")
    assert softer.exit_code == 1
    assert "FAIL  compare/trajectory" in softer.stdout
    assert "E / rho" in softer.stdout
    wide = run("verify", "--compare", good, "--scene", scene, "--set", "bodies.0.E=4e5", "--tolerance", "0.9")
    assert "PASS  compare/trajectory" in wide.stdout


def test_what_does_not_belong_together(scene, good, tmp_path):
    done = run("verify", "--compare", good, "--scene", scene, "--set", "bodies.0.vertices=200")
    assert done.exit_code == 2
    assert "another mesh" in done.stderr
    assert "reference (" not in done.stderr
    assert run("verify", "--compare", tmp_path / "none", "--scene", scene).exit_code == 2
    assert run("verify", "--compare", good).exit_code == 2
    assert run("verify", "--compare", good, "--scene", scene, "-k", "material").exit_code == 2
    assert run("verify", "--tolerance", "0.1").exit_code == 2
