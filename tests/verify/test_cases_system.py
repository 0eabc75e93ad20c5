# SPDX-License-Identifier: BSD-3-Clause
"""The cases about whole runs.

1. No quick row fails, and each question is asked.
2. They notice: a softer material, energies that leave something out, a frame that remembers a failed attempt, a
   resumed run that has forgotten, threads that count.
3. Ranges are shared out in the row about threads, and a row that shares nothing is red. A user's Ctrl-C is not
   swallowed by the row that presses its own.
4. Without the mesh, or on a device that has no simulation, a row is skipped and says why.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from femgal import runner
from femgal.kernels.cpu import threads
from verify.cases import system
from verify.problems.scenes import hanging, simulation
from verify.suite.case import Row
from verify.suite.run import Status, choose, run, run_row
from verify.suite.use import Use

USE = Use()
CASES = {row.case.id: row.case for row in choose("system/*")}


def row(name: str, **values) -> Row:
    return Row(CASES[f"system/{name}"], values)


def test_quick_rows():
    results = list(run(choose("system/*", quick=True), USE))
    assert [f"{r.row}: {r.note}" for r in results if r.status is not Status.PASS] == []
    asked = {result.row.case.id.split("/")[1] for result in results}
    assert asked == {case.split("/")[1] for case in CASES} - {"one-pass"}


def failing(monkeypatch, name: str, value, asked: Row) -> None:
    with monkeypatch.context() as context:
        context.setattr(system, name, value)
        result = run_row(asked, USE)
    assert result.status is Status.FAIL
    assert result.measurement is not None
    assert result.measurement.error > 0.0


def test_a_softer_body_is_noticed(monkeypatch):
    system._newton_displacements("bar", USE)  # of the right body, kept for the comparison
    softer = lambda mesh, frames, **settings: hanging(mesh, frames, E=0.999e5, **settings)  # noqa: E731
    failing(monkeypatch, "hanging", softer, row("newton", mesh="bar", solver="jacobi"))


def test_a_force_that_energies_leave_out_is_noticed(monkeypatch):
    def heavier(scene, use):
        sim = simulation(scene, use)
        sim.disc.mass[:] *= 1.0 + 1e-6
        return sim

    failing(monkeypatch, "simulation", heavier, row("energies", solver="verlet"))


def test_a_trace_of_a_failed_attempt_is_noticed(monkeypatch):
    def remembering(scene, use):
        sim = simulation(scene, use)
        step, count = sim.stepper.step, [0]

        def counted(state, h):
            count[0] += 1
            after = step(state, h)
            return replace(after, x=after.x + 1e-16 * count[0])

        sim.stepper.step = counted
        return sim

    failing(monkeypatch, "simulation", remembering, row("retake"))


def test_a_forgetful_checkpoint_is_noticed(monkeypatch):
    load = runner.load_checkpoint

    def forgetful(folder, **settings):
        arrays, meta = load(folder, **settings)
        return arrays | {"v": arrays["v"].astype(np.float32).astype(np.float64)}, meta

    monkeypatch.setattr(runner, "load_checkpoint", forgetful)
    assert run_row(row("resume", solver="verlet"), USE).status is Status.FAIL


def test_threads_that_count_are_noticed(monkeypatch):
    def counting(scene, use, threads=None):
        sim = simulation(scene, use, threads)
        sim.world.v0[0, 0] += 1e-15 * (threads or 0)
        return sim

    failing(monkeypatch, "simulation", counting, row("threads", solver="verlet", threads=2, precision="float64"))


def test_threads_that_share_nothing_are_noticed(monkeypatch):
    before = threads.SMALLEST_SHARE
    monkeypatch.setattr(system, "simulation", lambda scene, use, n=None: simulation(scene, use, 1))
    result = run_row(row("threads", solver="verlet", threads=2, precision="float64"), USE)
    assert result.status is Status.FAIL
    assert "no pass was shared" in result.note
    assert before == threads.SMALLEST_SHARE


def test_ctrl_c_of_the_user_goes_through(monkeypatch):
    def pressed(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(system, "run_scene", pressed)
    with pytest.raises(KeyboardInterrupt):
        run_row(row("resume", solver="verlet"), USE)


def test_rows_are_skipped_where_they_cannot_run(monkeypatch):
    on_cuda = run_row(row("retake"), Use("cuda"))
    assert on_cuda.status is Status.SKIP
    assert "CUDA" in on_cuda.note
    monkeypatch.setenv("FEMGAL_MESH_PATH", "")
    monkeypatch.setenv("FEMGAL_CACHE_DIR", "/nonexistent")
    without = run_row(row("one-pass", mesh="bunny", solver="fas"), USE)
    assert without.status is Status.SKIP
    assert "bunny.ply" in without.note


@pytest.mark.slow
def test_the_bunny_against_newton():
    result = run_row(row("newton", mesh="bunny", solver="fas-linear"), USE)
    assert result.status in (Status.PASS, Status.SKIP), result.note
