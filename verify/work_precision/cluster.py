# SPDX-License-Identifier: BSD-3-Clause
"""Carries out requests on a cluster of Dask distributed, one at a time on each worker.

Every run is a process of its own there as well, so that one that crashes is a failed row and no lost worker. A worker
that is gone takes its run with it: the run goes to another one, and after the second lost worker it counts as failed.
Workers that see the study's folder write results there themselves; those of the others travel to the client.
"""

from __future__ import annotations

import secrets
import tempfile
import time
from collections import Counter, deque
from collections.abc import Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from pathlib import Path
from typing import Any

from femgal.output.atomic import replacing
from meshes.errors import InputError
from verify.work_precision.executor import Done, Job
from verify.work_precision.launch import end_all, launch
from verify.work_precision.request import Request
from verify.work_precision.sources import source_digest
from verify.work_precision.store import write_result

# Longest wait for the scheduler and for a first worker [s].
PATIENCE = 10.0

# Longest wait for another worker after the last one was lost [s]: whoever starts them may be about to.
RECOVERY = 60.0

# Lost workers after which a run is blamed.
MOST_LOST = 2

# Seconds between looks at who is still there.
_PULSE = 0.2

# What a run leaves behind: its numbers, and its arrays where it has any. None where it lies in the folder already.
_Left = tuple[bytes, bytes | None] | None


def carry_out(request: str, stem: str, token: str) -> _Left:
    """Run a request; on a worker.

    Parameters
    ----------
    request : As `Request.as_json` writes it.
    stem : Path of the result for the client.
    token : Name of a file beside the result: who sees it shares the folder.
    """
    asked, out = Request.from_json(request), Path(stem)
    if _is_shared(out.parent / token):
        launch(asked, out)
        return None
    with tempfile.TemporaryDirectory(prefix="femgal-worker-") as folder:
        here = Path(folder) / out.name
        launch(asked, here)
        motion = here.with_suffix(".npz")
        return here.with_suffix(".json").read_bytes(), motion.read_bytes() if motion.is_file() else None


def _is_shared(token: Path) -> bool:
    return token.is_file()


class Cluster:
    """Runs on the workers of a scheduler.

    Parameters
    ----------
    address : Of the scheduler: ``tcp://host:8786``.
    patience : Longest wait for it and for a first worker [s].

    Raises
    ------
    InputError
        Dask distributed is not installed, nobody answers, there is no worker, or workers have other sources.
    """

    def __init__(self, address: str, patience: float = PATIENCE) -> None:
        try:
            from distributed import Client
        except ImportError:
            raise InputError(
                "a cluster needs Dask distributed",
                where="--cluster",
                found="no distributed",
                advice='pip install "femgal[cluster]"',
            ) from None
        self._address = address
        try:
            self._client: Any = Client(address, timeout=patience, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise InputError(
                "the cluster cannot be reached",
                where="--cluster",
                found=f"{address}: {str(error).splitlines()[0] if str(error) else type(error).__name__}",
                allowed="the address of a running scheduler, such as tcp://127.0.0.1:8786",
                advice="start one with `dask scheduler`, and workers with `dask worker ADDRESS --nthreads 1`",
            ) from None
        try:
            self._check_workers(patience)
        except BaseException:
            self.close()
            raise

    def run(self, jobs: Sequence[Job], begun: Done, done: Done) -> None:
        """Until every job has a result in its folder.

        Raises
        ------
        InputError
            The cluster is gone; what has ended is kept.
        """
        token = f".cluster-{secrets.token_hex(8)}"
        marks = {job.store.folder.resolve() / token for job in jobs}
        for mark in marks:
            mark.touch()
        fleet = _Fleet(self._client, token, begun, done)
        try:
            fleet.run(jobs)
        except (OSError, TimeoutError) as error:
            raise InputError(
                "the cluster is gone",
                where=self._address,
                found=str(error) or type(error).__name__,
                advice="the same command goes on where it was",
            ) from error
        except BaseException:
            fleet.abandon()
            raise
        finally:
            for mark in marks:
                mark.unlink(missing_ok=True)

    def close(self) -> None:
        """Let go of the scheduler."""
        with suppress(OSError, TimeoutError):
            self._client.close(timeout=PATIENCE)

    def _check_workers(self, patience: float) -> None:
        try:
            self._client.wait_for_workers(1, timeout=patience)
        except TimeoutError:
            raise InputError(
                "the cluster has no workers",
                where="--cluster",
                found=self._address,
                advice="start one with `dask worker ADDRESS --nthreads 1`",
            ) from None
        theirs = set(self._client.run(source_digest).values())
        if theirs != {source_digest()}:
            raise InputError(
                "workers have other sources",
                where="--cluster",
                found=", ".join(sorted(theirs)),
                allowed=source_digest(),
                advice="install the same femgal on all of them and start them again",
            )


class _Fleet:
    """Workers, and the job of each."""

    def __init__(self, client: Any, token: str, begun: Done, done: Done) -> None:
        self._client, self._token, self._begun, self._done = client, token, begun, done
        self._queue: deque[Job] = deque()
        self._running: dict[Any, tuple[Job, str]] = {}
        self._lost: Counter[str] = Counter()

    def run(self, jobs: Sequence[Job]) -> None:
        """Until all are done."""
        self._queue.extend(jobs)
        while self._queue or self._running:
            alive = list(self._client.scheduler_info(n_workers=-1)["workers"])
            self._give_up_the_dead(alive)
            self._send(alive)
            self._collect()

    def abandon(self) -> None:
        """End all runs, without a result."""
        with suppress(Exception):  # the user wants to stop, and the cluster may be the reason
            self._client.cancel(list(self._running), force=True)
            self._client.run(end_all, wait=False)

    def _send(self, alive: Sequence[str]) -> None:
        busy = {worker for _, worker in self._running.values()}
        for worker in alive:
            if worker in busy or not self._queue:
                continue
            job = self._queue.popleft()
            if not self._lost[job.request.name]:
                self._begun(job)
            arguments = (job.request.as_json(), str(job.store.stem(job.request).resolve()), self._token)
            future = self._client.submit(
                carry_out, *arguments, workers=[worker], allow_other_workers=False, pure=False, retries=0
            )
            self._running[future] = (job, worker)

    def _give_up_the_dead(self, alive: Sequence[str]) -> None:
        for future, (job, worker) in list(self._running.items()):
            # A result that has arrived needs its worker no more, if it lies in the folder.
            if worker not in alive and future.status != "finished":
                future.cancel()
                del self._running[future]
                self._lose(job)

    def _lose(self, job: Job) -> None:
        """Its worker is gone: once more elsewhere, unless it has a result or does that to workers."""
        self._lost[job.request.name] += 1
        if job.store.find(job.request) is not None:
            self._done(job)
        elif self._lost[job.request.name] < MOST_LOST:
            self._queue.appendleft(job)
        else:
            self._fail(job, "killed", f"{MOST_LOST} times the worker was lost while it ran")

    def _collect(self) -> None:
        if not self._running:
            self._client.wait_for_workers(1, timeout=RECOVERY)
            return
        time.sleep(_PULSE)
        for future in [future for future in self._running if future.done()]:
            job, _ = self._running.pop(future)
            self._keep(job, future)

    def _keep(self, job: Job, future: Any) -> None:
        from distributed import KilledWorker

        try:
            left: _Left = future.result(timeout=PATIENCE)
        except (KilledWorker, CancelledError, TimeoutError, OSError):
            self._lose(job)
        except Exception as error:  # whatever the worker says is a result
            self._fail(job, "crash", f"{type(error).__name__}: {error}")
        else:
            _store(job, left)
            self._done(job)

    def _fail(self, job: Job, kind: str, what: str) -> None:
        numbers: dict[str, Any] = {"label": job.request.label, "failure": what, "failure_kind": kind, "rows": []}
        write_result(job.store.stem(job.request), numbers)
        self._done(job)


def _store(job: Job, left: _Left) -> None:
    """Write what came from a worker that does not share the folder: the numbers last."""
    if left is None:
        return
    stem = job.store.stem(job.request)
    for suffix, content in ((".npz", left[1]), (".json", left[0])):
        if content is not None:
            with replacing(stem.with_suffix(suffix)) as part:
                part.write_bytes(content)
