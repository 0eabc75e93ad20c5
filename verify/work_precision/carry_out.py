# SPDX-License-Identifier: BSD-3-Clause
"""Runs what has no result yet, and tells what begins and how it ends."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable

from verify.work_precision.executor import Executor, Job
from verify.work_precision.request import Request
from verify.work_precision.store import Store


def carry_out(executor: Executor, wanted: Iterable[tuple[Request, Store]], announce: Callable[[str], None]) -> None:
    """Run what has no result yet, each request once.

    Parameters
    ----------
    wanted : Requests, each with the folder that its result belongs into.
    announce : Told what begins, and what has ended how.
    """
    jobs = {request.name: Job(request, store) for request, store in wanted if store.find(request) is None}
    count = itertools.count(1)
    total = len(jobs)

    def begun(job: Job) -> None:
        announce(f"[{next(count)}/{total}] {job.request.label}")

    def done(job: Job) -> None:
        announce(f"    {_told(job)}")

    if jobs:
        executor.run(list(jobs.values()), begun, done)


def _told(job: Job) -> str:
    found = job.store.find(job.request)
    if found is None:
        return f"{job.request.label}: no result"
    if found.failure:
        return f"{job.request.label}: FAILED, {found.failure.splitlines()[0]}"
    frames = found.numbers.get("rows")
    if not frames:
        return f"{job.request.label}: done"
    if job.request.kind == "substep":
        return f"{job.request.label}: {frames[-1]['iteration']} iterations in {frames[-1]['seconds']:.3g} s"
    seconds = sum(frame["seconds"] for frame in frames) / len(frames)
    return f"{job.request.label}: {seconds:.3g} s per frame"
