# SPDX-License-Identifier: BSD-3-Clause
"""`femgal bench preconditioners`.

1. Every preconditioner is measured on every size, material and state; what is known of them shows in the counts.
2. The systems are those of the materials asked for: iterations are the same with the scene's own E and rho set to them.
3. Iterations that are not enough are said to be, in the table too.
4. The command writes the record; what cannot be is refused before anything is measured, with exit code 2.
"""

from __future__ import annotations

import json
import re

import pytest
from click.testing import CliRunner

from femgal.cli import main
from femgal.scene.load import load_scene
from femgal.simulation import Simulation
from meshes.errors import InputError
from verify.benchmark import preconditioners
from verify.benchmark.preconditioners import PRECONDITIONERS, STATES, Settings, bench_preconditioners, tables


def test_everything_is_measured():
    seen = []
    settings = Settings("beam-bend", (150, 300), (1e4, 1e8), (1.0,))
    record = bench_preconditioners(settings, seen.append)
    rows = record["results"]
    assert len(rows) == len(seen) == 2 * 2 * len(PRECONDITIONERS) * len(STATES)
    assert {row["preconditioner"] for row in rows} == set(PRECONDITIONERS)
    assert all(row["refresh"] > 0.0 and row["seconds"] > 0.0 for row in rows)
    hard = {row["preconditioner"]: row for row in rows if row["E"] == 1e8 and row["state"] == "rest"}
    assert all(row["rough"] >= 1 and row["smooth"] >= 1 for row in rows)
    assert hard["v-cycle"]["smooth"] <= 10 < hard["layers"]["smooth"] < hard["blocks"]["smooth"]
    made = tables(record)
    assert [len(table.rows) for table in made] == [2 * 2 * len(STATES)] * len(PRECONDITIONERS)
    assert made[-1].title.startswith("v-cycle: at most")


def test_materials_are_those_asked_for(monkeypatch):
    settings = Settings("beam-bend", (200,), (3e5,), (20.0,), ("blocks",))
    one = bench_preconditioners(settings)["results"]

    def of_that_material(settings, vertices, name):
        overrides = {"bodies.0.E": 3e5, "bodies.0.rho": 20.0, "solver.name": "newton-multigrid"}
        overrides |= {"solver.preconditioner": name, "solver.threads": 1}
        return Simulation.prepare(load_scene(settings.scene, vertices=vertices, overrides=overrides))

    monkeypatch.setattr(preconditioners, "_simulation", of_that_material)
    other = bench_preconditioners(settings)["results"]
    assert [(row["smooth"], row["rough"]) for row in one] == [(row["smooth"], row["rough"]) for row in other]


def test_too_many_iterations(monkeypatch):
    monkeypatch.setattr(preconditioners, "MOST_ITERATIONS", 3)
    record = bench_preconditioners(Settings("beam-bend", (150,), (1e8,), (1.0,), ("blocks",)))
    assert [row["smooth"] for row in record["results"]] == [None, None]
    assert "more than 3 iterations in 4 of 4" in tables(record)[0].title
    assert tables(record)[0].rows[0][1] == "> 3"


def test_the_command(tmp_path):
    out = tmp_path / "found.json"
    arguments = ["bench", "preconditioners", "beam-bend", "--vertices", "150", "--E", "1e6", "--rho", "1000"]
    result = CliRunner().invoke(main, [*arguments, "--preconditioners", "v-cycle", "--json", str(out)])
    assert result.exit_code == 0, result.output
    assert json.loads(out.read_text())["schema"] == preconditioners.SCHEMA
    assert "v-cycle: at most" in result.stdout


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ({"preconditioners": ("v-cycle", "ilu")}, ["--preconditioners", "ilu", "blocks, layers, cycle, mas, v-cycle"]),
        ({"preconditioners": ()}, ["nothing"]),
        ({"E": (0.0,)}, ["--E", "positive"]),
        ({"rho": ()}, ["--rho"]),
        ({"reduction": 1.0}, ["--reduction", "between 0 and 1"]),
    ],
)
def test_what_cannot_be(arguments, expected):
    with pytest.raises(InputError) as error:
        Settings("beam-bend", (150,), **arguments)
    assert all(text in str(error.value) for text in expected)


def test_a_scene_of_two_materials(tmp_path):
    text = CliRunner().invoke(main, ["scenes", "--show", "beam-stretch"]).stdout
    (tmp_path / "mixed.toml").write_text(re.sub(r"^E = .*$", "E = 1e7", text, count=1, flags=re.MULTILINE))
    with pytest.raises(InputError, match="several materials"):
        bench_preconditioners(Settings(str(tmp_path / "mixed.toml"), (100,)))


def test_not_a_number():
    result = CliRunner().invoke(main, ["bench", "preconditioners", "beam-bend", "--E", "soft"])
    assert result.exit_code == 2
    assert "--E" in result.output
