# SPDX-License-Identifier: BSD-3-Clause
"""Importing and asking for help stay light.

1. `import femgal` loads none of the heavy packages.
2. `femgal --help` loads none of them either, nor NumPy.
3. `femgal --help` answers in 0.3 s of CPU time: start-up of the interpreter included, best of three.
4. The example in the package's docstring does what it says.
5. Every public name of `femgal` resolves, and a wrong one is refused.
"""

from __future__ import annotations

import doctest
import os
import subprocess
import sys

import pytest

import femgal

HEAVY = ("numba", "numba.cuda", "pyvista", "vtk", "matplotlib", "skfem", "meshio", "h5py")


def loaded_after(code: str) -> set[str]:
    report = "import sys; print('\\nMODULES', *sys.modules)"
    result = subprocess.run([sys.executable, "-c", f"{code}\n{report}"], capture_output=True, text=True, check=True)
    return set(result.stdout.rpartition("MODULES")[2].split())


def test_import_loads_nothing_heavy():
    modules = loaded_after("import femgal")
    assert "femgal" in modules
    assert modules.isdisjoint(HEAVY)


HELP = """
import sys
sys.argv = ["femgal", "--help"]
from femgal.cli import main
try:
    main()
except SystemExit as stop:
    assert stop.code == 0
"""


def test_help_loads_nothing_heavy():
    modules = loaded_after(HELP)
    assert "femgal.cli" in modules
    assert modules.isdisjoint({*HEAVY, "numpy", "scipy", "pydantic", "rich"})


def test_help_is_quick():
    def cpu_seconds() -> float:
        before = os.times()
        subprocess.run([sys.executable, "-c", HELP], capture_output=True, check=True)
        after = os.times()
        return after.children_user + after.children_system - before.children_user - before.children_system

    assert min(cpu_seconds() for _ in range(3)) <= 0.3


def test_the_example_runs():
    outcome = doctest.testmod(femgal)
    assert outcome.attempted >= 5
    assert outcome.failed == 0


@pytest.mark.parametrize("name", femgal.__all__)
def test_public_names_resolve(name):
    assert getattr(femgal, name).__name__ == name


def test_wrong_name_is_refused():
    with pytest.raises(AttributeError, match="no attribute 'solve_everything'"):
        femgal.solve_everything  # noqa: B018
