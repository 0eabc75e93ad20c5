# SPDX-License-Identifier: BSD-3-Clause
"""Who carries out requests: this machine, one after the other, or a cluster (`verify.work_precision.cluster`)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from verify.work_precision.launch import launch
from verify.work_precision.request import Request
from verify.work_precision.store import Store


@dataclass(frozen=True)
class Job:
    """A request, and the folder that its result belongs into."""

    request: Request
    store: Store


Done = Callable[[Job], None]


class Executor(Protocol):
    """Carries out requests."""

    def run(self, jobs: Sequence[Job], begun: Done, done: Done) -> None:
        """Run jobs until each has a result in its folder.

        Parameters
        ----------
        begun, done : Called when a job begins and when its result is there.
        """

    def close(self) -> None:
        """Let go of whatever it holds."""


class Local:
    """Runs on this machine, one at a time, so that none disturbs another's time."""

    def run(self, jobs: Sequence[Job], begun: Done, done: Done) -> None:
        """In the order given."""
        for job in jobs:
            begun(job)
            launch(job.request, job.store.stem(job.request))
            done(job)

    def close(self) -> None:
        """Nothing is held."""
