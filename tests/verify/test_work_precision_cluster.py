# SPDX-License-Identifier: BSD-3-Clause
"""The grid on a cluster.

1. Two workers run the same grid as this machine; every result is in the folder, errors are the same to the last bit.
2. A worker that is killed half-way loses nothing: its run is made by the other one, and leaves no process behind.
3. A run that kills its worker twice is reported as failed; all others are done. Workers without the folder send
   their results.
4. No scheduler, no worker, no Dask: clear errors within seconds, before anything runs, with exit code 2.
5. A run that nobody wants any more is ended without a result.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from click.testing import CliRunner

from femgal.cli import main
from meshes.errors import InputError
from tests.verify.bench_scenes import beam_file, beam_grid, make_study
from verify.work_precision import launch as launching
from verify.work_precision.record import make_record
from verify.work_precision.request import Request

distributed = pytest.importorskip("distributed")

from verify.work_precision.cluster import Cluster  # noqa: E402

SOLVERS = [{"name": "verlet"}, {"name": "jacobi", "substeps": [4, 5, 6, 7]}]

# A worker that shares no folder with the client and is killed by one of the runs.
FRAGILE = """
import os, signal
from verify.work_precision import cluster
from verify.work_precision.launch import launch as ordinary

def launch(request, out):
    if request.label.endswith("jacobi substeps=6"):
        os.kill(os.getpid(), signal.SIGKILL)
    ordinary(request, out)

cluster.launch = launch
cluster._is_shared = lambda token: False
"""


@contextmanager
def cluster(folder: Path, workers: int, *preload: str):
    """A scheduler and workers on loopback: the address, and the worker processes."""
    file, processes = folder / "scheduler.json", []
    common = {"env": os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}, "stderr": subprocess.DEVNULL}

    def start(*words: str) -> None:
        processes.append(subprocess.Popen([sys.executable, "-m", *words, "--scheduler-file", str(file)], **common))

    try:
        start("distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        for _ in range(workers):
            words = ("--no-nanny", "--nthreads", "1", "--no-dashboard", "--host", "127.0.0.1")
            start("distributed.cli.dask_worker", *words, *preload)
        with distributed.Client(scheduler_file=str(file), timeout=60, set_as_default=False) as client:
            if workers:
                client.wait_for_workers(workers, timeout=300)
            address = client.scheduler.address
        yield address, processes[1:]
    finally:
        for process in processes:
            process.kill()
            process.wait()


def children(pid: int) -> list[int]:
    """Processes that a process has started, over all its threads."""
    found = []
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        found += [int(child) for child in task.read_text().split()]
    return found


def kill_when_busy(worker: subprocess.Popen, orphans: list[int]) -> None:
    """Kill a worker as soon as it runs something."""
    while not (busy := children(worker.pid)):
        time.sleep(0.02)
    orphans += busy
    time.sleep(0.3)
    worker.kill()


@pytest.mark.slow
def test_a_killed_worker_loses_nothing(tmp_path):
    grid = beam_grid(tmp_path, SOLVERS)
    orphans: list[int] = []
    told: list[str] = []
    with cluster(tmp_path, 2) as (address, workers):
        executor = Cluster(address)
        killer = threading.Thread(target=kill_when_busy, args=(workers[0], orphans), daemon=True)
        study = make_study(tmp_path, grid, executor, told)
        killer.start()
        study.run()
        executor.close()
    killer.join(10)
    assert workers[0].returncode == -signal.SIGKILL
    record = make_record(study, "")
    assert [row["status"] for row in record["rows"]] == 5 * ["done"]
    assert len([line for line in told if line.startswith("[")]) == 1 + 7
    for pid in orphans:
        assert not Path(f"/proc/{pid}/cmdline").is_file() or b"child" not in Path(f"/proc/{pid}/cmdline").read_bytes()
    assert not list(study.store.folder.glob(".*"))
    here = make_study(tmp_path / "here", beam_grid(tmp_path, SOLVERS[:1]))
    here.run()
    assert make_record(here, "")["rows"][0]["error"] == record["rows"][0]["error"]


@pytest.mark.slow
def test_a_run_that_kills_its_workers(tmp_path):
    preload = tmp_path / "fragile.py"
    preload.write_text(FRAGILE)
    study = make_study(tmp_path, beam_grid(tmp_path, SOLVERS))
    with cluster(tmp_path, 3, "--preload", str(preload)) as (address, workers):
        study.executor = Cluster(address)
        study.run()
        study.executor.close()
        # Both of them, and the one that was left did the rest.
        assert sum(worker.poll() is not None for worker in workers) == 2
    rows = {row["label"]: row for row in make_record(study, "")["rows"]}
    lost = rows.pop("jacobi substeps=6")
    assert (lost["status"], lost["failure_kind"]) == ("failed", "killed")
    assert "2 times the worker was lost" in lost["failure"]
    assert {row["status"] for row in rows.values()} == {"done"}


def test_no_scheduler(tmp_path):
    words = ["bench", str(beam_file(tmp_path)), "--solvers", "verlet", "--work", str(tmp_path / "runs")]
    began = time.monotonic()
    result = CliRunner().invoke(main, [*words, "--cluster", "tcp://127.0.0.1:9"], catch_exceptions=False)
    assert result.exit_code == 2
    assert "the cluster cannot be reached" in result.stderr
    assert "dask scheduler" in result.stderr
    assert time.monotonic() - began < 60.0
    assert list((tmp_path / "runs").iterdir()) == []


def test_no_workers(tmp_path):
    with cluster(tmp_path, 0) as (address, _), pytest.raises(InputError, match="has no workers"):
        Cluster(address, patience=3.0)


def test_no_dask(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"femgal\[cluster\]"):
        Cluster("tcp://127.0.0.1:9")


def test_unwanted_runs_have_no_result(tmp_path, monkeypatch):
    monkeypatch.setattr(launching, "COMMAND", ("-c", "import time; time.sleep(60)"))
    monkeypatch.setattr(launching, "_environment", lambda request: dict(os.environ))

    def end_soon():
        while not launching._running:
            time.sleep(0.02)
        launching.end_all()

    threading.Thread(target=end_soon, daemon=True).start()
    with pytest.raises(launching.Unwanted):
        launching.launch(Request("motion", "endless", ""), tmp_path / "out")
    assert list(tmp_path.iterdir()) == []
