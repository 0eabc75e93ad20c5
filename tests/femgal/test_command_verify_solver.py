# SPDX-License-Identifier: BSD-3-Clause
"""`femgal verify --solver`.

1. A file's function goes through the cases about solvers, and the exit code says whether it passed; the end says
   how many rows ask for a promise that it does not give.
2. What cannot be loaded, and options that do not go together, are exit code 2 before anything runs.
"""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from femgal.cli import main

SOLVERS = """
from dataclasses import replace

def ballistic(mesh, material, state, h):
    v = state.v + h * state.gravity
    v[state.constrained] = 0.0
    return replace(state, x=state.x + h * v, v=v)

def frozen(mesh, material, state, h):
    return state
"""


def run(*arguments):
    return CliRunner().invoke(main, ["verify", *map(str, arguments)])


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(SOLVERS)
    return path


def test_a_solver_of_ones_own(file):
    good = run("--solver", f"{file}:ballistic", "-k", "constrained stepping/order")
    assert good.exit_code == 0, good.output
    assert "dynamics/constrained[own]" in good.output
    assert "not run: 1 of these rows (they need step.method or step.order" in good.output
    assert "2 of 2" in good.output or "2/2" in good.output
    bad = run("--solver", f"{file}:frozen", "-k", "centre-of-mass constrained")
    assert bad.exit_code == 1
    assert "FAIL" in bad.output
    listed = run("--solver", f"{file}:frozen", "--list")
    assert listed.exit_code == 0
    assert "stepping/order" in listed.output
    assert "patch/" not in listed.output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--solver", "{file}:none"), ("no such function", "ballistic, frozen")),
        (("--solver", "{file}"), ("not the name of a function", "file.py:function")),
        (("--solver", "{file}:frozen", "-k", "patch/*"), ("solver of one's own", "stepping, dynamics")),
        (("--solver", "{file}:frozen", "--set", "bodies.0.nu=0.3"), ("--solver goes without",)),
    ],
)
def test_what_cannot_be_run(file, arguments, words):
    result = run(*(argument.format(file=file) for argument in arguments))
    assert result.exit_code == 2
    for word in words:
        assert word in result.output
