# SPDX-License-Identifier: BSD-3-Clause
"""A grid, run.

1. On a small beam Verlet is closest to its own reference, errors fall with the substeps, single precision changes them
   by little, the reference's own error is a small part of the smallest.
2. What has been run is not run again, also after a stop; another row costs one run.
3. A run that fails, is killed or takes too long is a row with what was seen, never an end of the study.
4. Finalists are repeated, and only they; their times have a median and a spread.
5. The record is JSON without NaN; every row has passes, bytes, iterations, memory; the reports read it.
6. References outlive another solver's sources; the present ones do not.
7. The solver error of a converged solver is far below its error, that of one sweep is not; so is its energy gap.
8. What cannot be run is refused before anything runs.
"""

from __future__ import annotations

import json
import os
import signal
from dataclasses import replace

import pytest

from meshes.errors import InputError
from reports.benchmark.charts import charts
from reports.benchmark.render import render
from reports.benchmark.tables import notes, tables
from tests.verify.bench_scenes import beam_grid, make_study
from verify.work_precision import launch as launching
from verify.work_precision import request as requests
from verify.work_precision.executor import Job
from verify.work_precision.record import make_record
from verify.work_precision.store import Store

SOLVERS = [
    {"name": "verlet"},
    {"name": "fas", "substeps": [5, 20], "precision": ["float64", "float32"], "ratio": 8},
    {"name": "jacobi", "substeps": 20},
]


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    folder, told = tmp_path_factory.mktemp("study"), []
    study = make_study(folder, beam_grid(folder, SOLVERS), told=told)
    study.run()
    return study, make_record(study, "femgal bench"), told, folder


def test_errors(done):
    _, record, _, _ = done
    error = {row["label"]: row["error"] for row in record["rows"]}
    fas = "fas substeps={} precision={} ratio=8"
    assert error["verlet"] < error[fas.format(20, "float64")] < error[fas.format(5, "float64")] < 0.5
    for substeps in (5, 20):
        both = [error[fas.format(substeps, precision)] for precision in ("float64", "float32")]
        assert both[0] == pytest.approx(both[1], rel=1e-2)
    reference = record["problems"][0]["reference"]
    assert reference["own_error"] < 0.1 * error["verlet"]
    assert not reference["flagged"]


def test_numbers_of_rows(done):
    _, record, _, _ = done
    json.dumps(record, allow_nan=False)
    for row in record["rows"]:
        assert row["status"] == "done"
        assert (
            row["times"]["cpu"]["least"] <= row["seconds"] <= row["times"]["cpu"]["most"] or record["clock"] == "wall"
        )
        assert row["passes"] == pytest.approx(sum(row["passes_by_kind"].values()))
        assert row["bytes"] > row["passes"] * record["problems"][0]["tets"] * 52.0
        assert row["peak_mb"] > 50.0
        assert row["energy_gain"] < 0.01
    fas = record["rows"][1]
    assert fas["iterations"] == fas["substeps"][0] == 5
    assert record["rows"][0]["iterations"] is None


def test_nothing_is_run_twice(done):
    _, record, told, folder = done
    assert len([line for line in told if line.startswith("[")]) == 1 + 2 + 6
    again: list[str] = []
    more = [*SOLVERS[:2], {"name": "jacobi", "substeps": [20, 40]}]
    repeated = make_study(folder, beam_grid(folder, more), told=again)
    repeated.run()
    assert len([line for line in again if line.startswith("[")]) == 1
    rows = make_record(repeated, "again")["rows"]
    assert [row["times"] for row in rows[: len(record["rows"])]] == [row["times"] for row in record["rows"]]


@pytest.mark.slow
def test_solver_error_and_energy_gap(done):
    folder = done[-1]
    solvers = [
        {"name": "newton-pcg", "stepping": "bdf2", "substeps": 4, "tolerance": 1e-6},
        {"name": "jacobi", "stepping": "bdf2", "substeps": 4},
        {"name": "auto", "accuracy": 0.1},
    ]
    told: list[str] = []
    study = make_study(folder, beam_grid(folder, solvers), told=told, solver_error=True, gaps=2)
    study.run()
    exact, swept, chosen = make_record(study, "")["rows"]
    # The steps are the same, so what is left of the error is the steps'.
    assert exact["solver_error"] < 1e-4 < exact["error"]
    assert swept["solver_error"] > 10.0 * exact["solver_error"]
    assert max(exact["gaps"]) < 1e-6 < max(swept["gaps"]) < 1.0
    assert len(exact["gaps"]) == 2
    assert exact["linear_iterations"] > exact["iterations"] >= 4
    assert chosen["solver_error"] is None
    assert chosen["error"] < 0.2
    assert chosen["choice"]["solver"] in ("verlet", "newton-multigrid")
    assert chosen["wasted_passes"] < chosen["passes"]
    assert len([line for line in told if "newton-direct" in line]) == 2


class StopAfter:
    """An executor that the user stops after some runs."""

    def __init__(self, count: int) -> None:
        self.count = count

    def run(self, jobs, begun, done):
        for job in jobs:
            if self.count == 0:
                raise KeyboardInterrupt
            launching.launch(job.request, job.store.stem(job.request))
            self.count -= 1


def test_stop_and_resume(done):
    folder = done[-1]
    grid = beam_grid(folder, [{"name": "verlet"}, {"name": "jacobi", "substeps": [5, 10]}])
    stopped = make_study(folder, grid, StopAfter(0))
    with pytest.raises(KeyboardInterrupt):
        stopped.run()
    rows = make_record(stopped, "")["rows"]
    assert [row["status"] for row in rows] == ["done", "not run", "not run"]
    told: list[str] = []
    going_on = make_study(folder, grid, told=told)
    going_on.run()
    assert [line.split(": ")[-1] for line in told if line.startswith("[")] == [
        "jacobi substeps=5",
        "jacobi substeps=10",
    ]
    assert all(row["status"] == "done" for row in make_record(going_on, "")["rows"])


@pytest.mark.slow
def test_failures_are_rows(tmp_path):
    solvers = [{"name": "verlet", "substeps": 3}, {"name": "jacobi", "substeps": 4}]
    study = make_study(tmp_path, beam_grid(tmp_path, solvers, E=[1e9]))
    study.run()
    record = make_record(study, "")
    lost = record["rows"][0]
    assert (lost["status"], lost["failure_kind"], lost["error"]) == ("failed", "solver", None)
    assert "frame 1" in lost["failure"]
    assert record["rows"][1]["status"] == "done"
    drawn = tables(record)[1]
    assert drawn.rows[0][1] == "solver"
    assert any("frame 1" in line for line in notes(record))


def test_time_limit_and_longer_one(done):
    folder = done[-1]
    grid = beam_grid(folder, [{"name": "jacobi", "substeps": 4}])
    study = make_study(folder, replace_limit(grid, 0.05))
    study.run()
    row = make_record(study, "")["rows"][0]
    assert row["failure_kind"] == "time limit"
    assert "0.05 s" in row["failure"]
    assert row["seconds"] is None
    longer = make_study(folder, replace_limit(grid, 300.0))
    longer.run()
    assert make_record(longer, "")["rows"][0]["status"] == "done"


def replace_limit(grid, seconds):
    return grid.model_copy(update={"time_limit": seconds})


def test_killed_and_crashed(done, monkeypatch):
    folder = done[-1]
    study = make_study(folder, beam_grid(folder, [{"name": "jacobi", "substeps": [6, 7]}]))
    first, second = (study._request(study.problems[0], method) for method in study.methods)
    kill = "import os, signal; os.kill(os.getpid(), signal.SIGKILL)"
    for request, code in ((first, kill), (second, "raise SystemExit('out of ideas')")):
        monkeypatch.setattr(launching, "COMMAND", ("-c", code))
        launching.launch(request, study.store.stem(request))
    monkeypatch.undo()
    kinds = [study.store.find(request).numbers["failure_kind"] for request in (first, second)]
    assert kinds == ["killed", "crash"]
    assert "SIGKILL" in study.store.find(first).failure
    assert "out of ideas" in study.store.find(second).failure
    # Kept until they are asked for again.
    study.run()
    assert [row["status"] for row in make_record(study, "")["rows"]] == ["failed", "failed"]
    assert Store(study.store.folder, retry_failed=True).find(first) is None


def test_interrupt_ends_the_process(tmp_path, monkeypatch):
    request = requests.Request("motion", "endless", "")
    monkeypatch.setattr(launching, "COMMAND", ("-c", "import time; time.sleep(60)"))
    monkeypatch.setattr(launching, "_environment", lambda request: dict(os.environ))
    begun = []

    def interrupted(process, limit):
        begun.append(process)
        raise KeyboardInterrupt

    monkeypatch.setattr(launching, "_wait_for", interrupted)
    with pytest.raises(KeyboardInterrupt):
        launching.launch(request, tmp_path / "out")
    assert begun[0].returncode == -signal.SIGKILL
    assert list(tmp_path.iterdir()) == []


def test_finalists_are_repeated(done):
    _, record, _, folder = done
    target = 1.01 * record["rows"][0]["error"]
    grid = beam_grid(folder, [{"name": "verlet"}, SOLVERS[2]], repeats=3, targets=[target])
    study = make_study(folder, grid)
    study.run()
    rows = make_record(study, "")["rows"]
    # Jacobi does not get there.
    assert [(row["finalist"], row["runs"]) for row in rows] == [(True, 3), (False, 1)]
    times = rows[0]["times"]["cpu"]
    assert times["least"] <= times["median"] <= times["most"]


def test_reports_read_it(done):
    _, record, _, _ = done
    _, rows = tables(record)
    assert len(rows.rows) == len(record["rows"])
    files = render(record)
    assert json.loads(files["bench.json"]) == json.loads(json.dumps(record))
    assert "fas substeps=20 precision=float32" in files["bench.html"]
    assert {chart.name for chart in charts(record)} == {"error-seconds", "error-passes"}


def test_what_a_result_depends_on(done, monkeypatch):
    study, _, _, _ = done
    problem = study.problems[0]
    pair, row = study._pair(problem), study._request(problem, study.methods[0])
    named = [request.name for request in (*pair.both, row)]
    monkeypatch.setattr(requests, "source_digest", lambda **which: "othersrc")
    assert [request.name for request in pair.both] == named[:2]
    assert row.name != named[2]
    assert row.key == named[2][:16]
    assert study.store.find(row) is None
    older = Store(study.store.folder, keep_older=True).find(row)
    assert older is not None
    assert older.older
    assert replace(row, gaps=2).key != row.key
    assert row.repeated(1).key != row.key


@pytest.mark.parametrize(
    ("solvers", "keys", "expected"),
    [
        ([], {}, "one or more"),
        ([{"name": "magic"}], {}, "no such solver"),
        ([{"name": "fas", "substeps": []}], {}, "a choice of nothing"),
        ([{"name": "fas", "stebs": 4}], {}, "unknown key"),
        ([{"name": "fas", "cycle": ["V", "X"]}], {}, "not one of the choices"),
        ([{"name": "fas"}], {"colour": 3}, "unknown key"),
        ([{"name": "fas"}], {"vertices": [3]}, "vertices"),
        ([{"name": "fas"}], {"targets": []}, "empty"),
        ([{"name": "fas"}], {"scenes": []}, "empty"),
        ([{"name": "fas"}], {"scenes": ["no-such-scene"]}, "no such scene"),
        ([{"name": "fas"}, {"name": "fas"}], {}, "two curves of one name"),
    ],
)
def test_refusals(solvers, keys, expected, tmp_path):
    class Nobody:
        def run(self, jobs, begun, done):
            raise AssertionError("nothing must run")

    with pytest.raises(InputError) as caught:
        make_study(tmp_path, beam_grid(tmp_path, solvers, **keys), Nobody())
    assert expected in str(caught.value)


def test_scene_that_cannot_be_built(tmp_path):
    keys = {"set": {"constraints.0.where": {"box": {"min": [90.0, 90.0, 90.0], "max": [91.0, 91.0, 91.0]}}}}
    study = make_study(tmp_path, beam_grid(tmp_path, [{"name": "verlet"}], **keys))
    with pytest.raises(InputError, match="cannot be built"):
        study.run()
    assert len(list(study.store.folder.glob("*.json"))) == 1


def test_job_is_what_it_says(done):
    study, _, _, _ = done
    request = study._request(study.problems[0], study.methods[1])
    assert requests.Request.from_json(request.as_json()) == request
    assert Job(request, study.store).store.stem(request).parent == study.store.folder
