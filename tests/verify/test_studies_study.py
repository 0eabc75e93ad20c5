# SPDX-License-Identifier: BSD-3-Clause
"""A study, run on a small beam.

1. Its record is JSON without NaN: parts with problems, rows or traces, entries, speedups with the paper's beside, and
   a verdict on every claim; the tables show them.
2. What has been run is not run again, also after a stop; what has not been run is told as such.
3. Sizes beyond those that have references make none.
4. What cannot be run is refused before anything runs.
"""

from __future__ import annotations

import json

import pytest

from meshes.errors import InputError
from tests.verify.bench_scenes import beam_file
from verify.studies import motion
from verify.studies.definition import StudyDefinition
from verify.studies.motion import Bench
from verify.studies.study import PublishedStudy
from verify.studies.tables import notes, tables
from verify.work_precision.executor import Local
from verify.work_precision.store import Store
from verify.work_precision.study import Options

SOLVERS = [
    {"name": "newton-pcg", "substeps": [1, 4]},
    {"name": "jacobi", "substeps": [4, 16], "steps": "lu2025"},
    {"name": "fas", "label": "fas-constant", "substeps": [4, 16], "steps": "lu2025", "ratio": 8},
]
SUBSTEP_SOLVERS = [{"name": "jacobi"}, {"name": "newton-pcg"}]


def claim(part, **keys):
    return {"text": "t", "source": "s", "part": part, "of": ["jacobi"], "than": ["newton-pcg"], **keys}


def definition(folder, **motion_grid):
    scenes = [str(beam_file(folder))]
    about = {"title": "t", "source": "s", "about": "a", "targets": [0.5, 0.1]}
    parts = [
        {
            "id": "step",
            "kind": "substep",
            "grid": {"scenes": scenes, "solvers": SUBSTEP_SOLVERS},
            "substeps": [4],
            "options": {"iterations": 6},
            "levels": [0.5, 1e-3],
            "plots": ["iteration eps18"],
            **about,
        },
        {
            "id": "motion",
            "kind": "motion",
            "grid": {"scenes": scenes, "solvers": SOLVERS, "frames": 1, **motion_grid},
            "levels": [1e-3, 1e-12],
            "baseline": "newton-pcg",
            "axis": "E",
            "table": "stiffness",
            "plots": ["seconds eps18", "seconds error"],
            **about,
        },
    ]
    claims = [claim("step", what="iterations"), claim("motion"), claim("motion", what="eps18", factor=1e6)]
    return StudyDefinition.model_validate(
        {"name": "small", "title": "Small", "question": "?", "parts": parts, "claims": claims}
    )


def make(folder, given, executor=None, told=None):
    announce = (lambda text: None) if told is None else told.append
    stores = Store(folder / "runs"), Store(folder / "references")
    return PublishedStudy(given, Bench(*stores, executor or Local(), Options("cpu"), announce))


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    folder, told = tmp_path_factory.mktemp("studies"), []
    given = definition(folder, E=[1e5])
    study = make(folder, given, told=told)
    study.run()
    return study.record("femgal study small"), folder, given, told


def test_record(done):
    record = done[0]
    json.dumps(record, allow_nan=False)
    step, whole = record["parts"]
    assert {trace["status"] for trace in step["traces"]} == {row["status"] for row in whole["rows"]} == {"done"}
    assert step["problems"][0]["vertices"] == whole["problems"][0]["vertices"] > 100
    assert len(step["entries"]) == 2 * 2 * 2
    assert len(whole["entries"]) == 3 * 2 * 2
    reached = [e for e in whole["entries"] if e["level"] == 1e-3]
    assert all(e["seconds"] > 0.0 and e["passes"] > 0.0 for e in reached)
    missed = [e for e in whole["entries"] if e["level"] == 1e-12]
    assert all(e["seconds"] is None and e["best"] > 1e-12 for e in missed)
    assert [c["judged"] > 0 for c in record["claims"]] == [True, True, True]


def test_speedups(done):
    found = {(e["curve"], e["measure"], e["level"]): e for e in done[0]["parts"][1]["speedups"]}
    assert found["newton-pcg", "eps18", 1e-3]["speedup"] == 1.0
    assert found["fas-constant", "eps18", 1e-3]["published"] == 4.09
    assert found["fas-constant", "eps18", 1e-12]["speedup"] is None
    assert done[0]["parts"][0]["speedups"] == []


def test_tables(done):
    drawn = tables(done[0])
    assert [len(table.rows) for table in drawn] == [2, 2, 3, 3, 3]
    assert all(len(row) == len(table.heads) for table in drawn for row in table.rows)
    assert "4.09" in drawn[2].rows[2]
    assert len(notes(done[0])) == 1


class StopAfter:
    """Stops in the middle of the jobs, as Ctrl-C does."""

    def __init__(self, count):
        self.count = count

    def run(self, jobs, begun, done):
        Local().run(jobs[: self.count], begun, done)
        raise KeyboardInterrupt


def test_stop_and_resume(done, tmp_path):
    _, folder, given, told = done
    again: list[str] = []
    make(folder, given, told=again).run()
    assert again == []
    assert any(" iterations in " in line for line in told)
    stopped = make(tmp_path, given, StopAfter(1))
    with pytest.raises(KeyboardInterrupt):
        stopped.run()
    step, whole = stopped.record("")["parts"]
    assert [trace["status"] for trace in step["traces"]] == ["done", "not run"]
    assert {row["status"] for row in whole["rows"]} == {"not run"}
    tables(stopped.record(""))


def test_large_sizes_have_no_reference(tmp_path, monkeypatch):
    monkeypatch.setattr(motion, "MOST_OF_REFERENCES", 10)
    small = definition(tmp_path).parts[1]
    solvers = [{"name": "jacobi", "substeps": 2}, {"name": "newton-pcg", "substeps": 1}]
    grid = {"scenes": ["rabbit-drape"], "solvers": solvers, "frames": 1, "vertices": [300]}
    part = small.model_copy(update={"grid": grid})
    told: list[str] = []
    stores = Store(tmp_path / "runs"), Store(tmp_path / "references")
    large = motion.MotionPart(part, Bench(*stores, Local(), Options("cpu"), told.append))
    large.run()
    assert not any("reference" in line for line in told)
    record = large.record()
    assert record["problems"][0]["reference"]["failure"] == "none was asked for"
    assert [row["error"] for row in record["rows"]] == [None, None]
    assert record["rows"][0]["eps18"] > 0.0


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"options": {"iteration": 3}}, "options of step"),
        ({"options": {"iterations": "many"}}, "options of step"),
        ({"grid": {"scenes": ["no-such-scene"], "solvers": SUBSTEP_SOLVERS}}, "no such scene"),
        ({"grid": {"scenes": ["rabbit-drape"], "solvers": [{"name": "magic"}]}}, "no such solver"),
    ],
)
def test_refused(tmp_path, changes, expected):
    given = definition(tmp_path)
    broken = given.parts[0].model_copy(update=changes)
    with pytest.raises(InputError, match=expected):
        make(tmp_path, given.model_copy(update={"parts": (broken,)}))
