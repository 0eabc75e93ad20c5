# SPDX-License-Identifier: BSD-3-Clause
"""`femgal bench SCENE...`.

1. It prints the table, writes --report and --json, and the same command goes on; --json - is one JSON object.
2. Bad requests are refused with exit code 2 and what is allowed, before anything runs.
3. A stop writes what is there, with exit code 130.
4. --example prints a grid that --grid reads. Loading the command loads no heavy package.
"""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
from click.testing import CliRunner, Result

from femgal.cli import main
from tests.verify.bench_scenes import beam_file


def run(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["bench", *map(str, arguments)], catch_exceptions=False)


def test_tables_and_files(tmp_path):
    beam = beam_file(tmp_path)
    words = [beam, "--frames", 1, "--solvers", "verlet,jacobi", "--substeps", "4", "--work", tmp_path / "runs"]
    words += ["--references", tmp_path / "references"]
    result = run(*words, "--report", tmp_path / "out")
    assert result.exit_code == 0
    assert "jacobi substeps=4" in result.stdout
    assert "its own error" in result.stdout
    record = json.loads((tmp_path / "out" / "bench.json").read_text())
    assert record["command"].startswith("femgal bench beam.toml --solvers verlet,jacobi --substeps 4 --frames 1")
    assert str(tmp_path) not in json.dumps(record)
    assert len((tmp_path / "out" / "bench.csv").read_text().splitlines()) == 3
    alone = run(*words, "--json", "-")
    assert [row["times"] for row in json.loads(alone.stdout)["rows"]] == [row["times"] for row in record["rows"]]
    assert "[1/" not in alone.stderr


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("rabbit-drape", "--solvers", "magic"), "allowed: fas"),
        (("rabbit-drape",), "one or more [[solvers]] tables"),
        (("--solvers", "fas"), "name one or more scenes"),
        (("no-such-scene", "--solvers", "fas"), "no such scene"),
        (("rabbit-drape", "--solvers", "fas", "--E", "soft"), "numbers separated by commas"),
        (("rabbit-drape", "--solvers", "fas", "--E", "-1"), "E"),
        (("rabbit-drape", "--solvers", "fas", "--vary", "stebs=4"), "no solver of this grid has such a key"),
        (("rabbit-drape", "--substeps", "4"), "--solvers"),
        (("rabbit-drape", "--solver", "fas cycle=X"), "not one of the choices"),
        (("rabbit-drape", "--solvers", "fas", "--repeats", "0"), "--repeats"),
        (("rabbit-drape", "--solvers", "fas", "--targets", "2"), "targets"),
        (("--grid", "missing.toml"), "cannot be read"),
        (("rabbit-drape", "--solvers", "fas", "--json", "missing/folder.json"), "does not exist"),
    ],
)
def test_refusals(arguments, expected, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run(*arguments)
    assert result.exit_code == 2
    assert expected in result.stderr
    assert "[1/" not in result.stderr
    assert result.stdout == ""


def test_stop(tmp_path, monkeypatch):
    from verify.work_precision.study import Study

    def stopped(self):
        raise KeyboardInterrupt

    monkeypatch.setattr(Study, "run", stopped)
    out = tmp_path / "bench.json"
    result = run(beam_file(tmp_path), "--solvers", "fas", "--work", tmp_path / "runs", "--json", out)
    assert result.exit_code == 130
    assert "the same command goes on" in result.stderr
    assert {row["status"] for row in json.loads(out.read_text())["rows"]} == {"not run"}


def test_example(tmp_path):
    from verify.work_precision.grid import load_grid

    result = run("--example")
    assert result.exit_code == 0
    (tmp_path / "grid.toml").write_text(result.stdout)
    assert load_grid(tmp_path / "grid.toml").repeats == 5


def test_help_names_both():
    result = run("--help")
    assert "bench [OPTIONS] [SCENES]..." in result.stdout
    assert "femgal bench kernels" in result.stdout
    assert run().stdout == result.stdout
    assert "bench kernels [OPTIONS]" in run("kernels", "--help").stdout


def test_loading_is_light():
    code = (
        "import sys, femgal.commands.bench as b\n"
        "from click.testing import CliRunner\n"
        "assert CliRunner().invoke(b.command, ['--help']).exit_code == 0\n"
        "print(sorted({'numpy', 'numba', 'scipy', 'rich', 'verify', 'distributed'} & set(sys.modules)))"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert loaded.strip() == "[]"
