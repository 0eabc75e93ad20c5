# SPDX-License-Identifier: BSD-3-Clause
"""Who may import whom.

1. meshes and reports import nothing of ours, femgal imports meshes, verify imports femgal and meshes. Commands of
   femgal may import verify and reports too, when they are called.
2. Within femgal, the physics knows no array and no backend, kernels know no solver, and nothing but the command line
   and the runner knows about output files.
3. The repository's top level is what it is meant to be.
"""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("femgal", "meshes", "verify", "reports")


def imports_of(folder: Path, nodes=ast.walk) -> set[tuple[str, str]]:
    """(file, module) of every import below a folder, those inside functions too unless `nodes` leaves them out."""
    found = set()
    for path in folder.rglob("*.py"):
        for node in nodes(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found |= {(str(path.relative_to(ROOT)), alias.name) for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                found.add((str(path.relative_to(ROOT)), node.module))
    return found


@pytest.mark.parametrize(
    ("room", "allowed"),
    [("meshes", {"meshes"}), ("reports", {"reports"}), ("femgal", {"femgal", "meshes"}), ("verify", set(ROOMS[:3]))],
)
def test_rooms(room, allowed):
    ours = {(file, module) for file, module in imports_of(ROOT / room) if module.split(".")[0] in ROOMS}
    outside = {(file, module) for file, module in ours if module.split(".")[0] not in allowed}
    of_commands = {
        (f, m) for f, m in outside if f.startswith("femgal/commands/") and m.startswith(("verify.", "reports."))
    }
    assert outside - of_commands == set()


def test_commands_import_verify_and_reports_only_when_called():
    at_once = imports_of(ROOT / "femgal" / "commands", ast.iter_child_nodes)
    assert len(at_once) > 10
    assert {(file, module) for file, module in at_once if module.split(".")[0] in ("verify", "reports")} == set()


@pytest.mark.parametrize(
    ("folder", "forbidden"),
    [
        ("materials", ("kernels", "hierarchy", "solvers", "timestep", "scene", "output", "simulation", "runner")),
        ("kernels", ("solvers", "timestep", "scene", "output", "simulation", "runner")),
        ("hierarchy", ("kernels", "solvers", "timestep", "scene", "output", "simulation", "runner")),
        ("assembly", ("solvers", "timestep", "scene", "output", "simulation", "runner")),
        ("gauss_seidel", ("solvers", "timestep", "scene", "output", "simulation", "runner")),
        ("schwarz", ("solvers", "timestep", "scene", "output", "simulation", "runner")),
        ("solvers", ("scene", "output", "simulation", "runner", "commands")),
        ("timestep", ("output", "simulation", "runner", "commands")),
        ("output", ("kernels", "hierarchy", "solvers", "timestep", "simulation", "runner", "commands")),
    ],
)
def test_inside_femgal(folder, forbidden):
    found = {(file, module) for file, module in imports_of(ROOT / "femgal" / folder)}
    wrong = {(f, m) for f, m in found if any(m == f"femgal.{n}" or m.startswith(f"femgal.{n}.") for n in forbidden)}
    assert wrong == set()


def test_top_level():
    tracked = {path.name for path in ROOT.iterdir() if not path.name.startswith(".")}
    expected = {"pyproject.toml", "README.md", "LICENSE", "CHANGELOG.md", "tests", *ROOMS}
    assert expected <= tracked
