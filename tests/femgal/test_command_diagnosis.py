# SPDX-License-Identifier: BSD-3-Clause
"""`femgal verify --mesh` and `--scene`.

1. Rows run on the user's mesh, findings are printed with what to do, and both are in the record; no folder is.
2. A problem is exit code 1 even where all rows pass.
3. --scene and --set give material and constraints; a mesh replaces that of the scene.
4. A broken file is exit code 2 with the reader's message; --set alone is a usage error.
5. --list shows the rows that would run.
"""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from femgal.cli import main
from meshes.generators import box
from meshes.io.tets import write_tets
from tests.femgal.scenes import hanging_beam_text

ROW = "sum-of-forces"


def run(*arguments):
    return CliRunner().invoke(main, ["verify", *map(str, arguments)], catch_exceptions=False)


@pytest.fixture
def block(tmp_path):
    path = tmp_path / "block.vtu"
    write_tets(path, box((0.8, 0.4, 0.4), (8, 4, 4)))
    return path


def test_diagnosis(block, tmp_path):
    record = tmp_path / "record.json"
    done = run("--mesh", block, "-k", ROW, "--json", record)
    assert done.exit_code == 0
    assert "[float64,own]" in done.stdout
    assert "Assumed" in done.stdout
    assert "0 problems" not in done.stdout
    text = record.read_text()
    content = json.loads(text)
    assert {row["status"] for row in content["rows"]} == {"PASS"}
    assert content["diagnosis"]["counts"]["problem"] == 0
    assert content["header"]["command"].startswith("femgal verify -k sum-of-forces --mesh block.vtu")
    assert str(tmp_path) not in text


def test_a_problem_is_exit_code_1(block):
    done = run("--mesh", block, "--set", "bodies.0.nu=0.499", "-k", ROW, "--json", "-")
    assert done.exit_code == 1
    assert json.loads(done.stdout)["diagnosis"]["counts"]["problem"] >= 1
    assert "PROBLEM" in done.stderr


def test_scene(block, tmp_path):
    scene = tmp_path / "hanging.toml"
    scene.write_text(hanging_beam_text())
    arguments = ["--scene", scene, "--set", "bodies.0.rho=100", "-k", ROW, "--json", "-"]
    for more, vertices in ((["--mesh", block], 9 * 5 * 5), ([], 396)):
        content = json.loads(run(*arguments, *more).stdout)
        found = {one["topic"]: one for one in content["diagnosis"]["findings"]}
        assert found["size"]["numbers"]["vertices"] == pytest.approx(vertices, rel=0.05)
        assert found["material"]["numbers"]["rho_kg_m3"] == [100.0, 100.0]
        assert found["parts"]["numbers"]["parts_not_held"] == 0
        assert "Assumed" not in found["material"]["what"]


def test_bad_input(tmp_path):
    broken = tmp_path / "broken.msh"
    broken.write_text("$MeshFormat\n")
    done = run("--mesh", broken)
    assert done.exit_code == 2
    assert str(broken) in done.stderr
    assert run("--mesh", tmp_path / "none.msh").exit_code == 2
    assert run("--set", "bodies.0.nu=0.3").exit_code == 2


def test_list(block):
    done = run("--mesh", block, "--list", "-k", ROW)
    assert done.exit_code == 0
    assert "own" in done.stdout
