# SPDX-License-Identifier: BSD-3-Clause
"""Work shared out over threads.

1. Every row is visited exactly once, whatever the numbers of rows and threads, even and ragged.
2. Small ranges stay in the calling thread; large ones do reach as many threads as asked for.
3. A ragged range is shared out by pairs: no thread gets more than its part and one row.
4. An error in a range reaches the caller, from whichever thread it comes.
5. A forked child may use the workers of its parent.
6. Without a number the threads are the processors that the process may use.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import numpy as np
import pytest

from femgal.kernels.cpu.threads import SMALLEST_SHARE, Workers
from verify.problems.bodies import rng


def ranges(workers: Workers, ptr_or_rows) -> list[tuple[int, int, int]]:
    """(start, stop, thread) of every call, by start."""
    seen: list[tuple[int, int, int]] = []

    def record(start, stop):
        seen.append((start, stop, threading.get_ident()))

    if isinstance(ptr_or_rows, int):
        workers.run(record, ptr_or_rows)
    else:
        workers.run_ragged(record, ptr_or_rows)
    return sorted(seen)


def assert_covers(seen: list[tuple[int, int, int]], rows: int) -> None:
    visited = np.zeros(rows, int)
    for start, stop, _ in seen:
        visited[start:stop] += 1
    assert (visited == 1).all()
    assert max(stop for _, stop, _ in seen) == rows


@pytest.mark.parametrize("threads", [1, 2, 3, 7])
@pytest.mark.parametrize("rows", [0, 1, SMALLEST_SHARE - 1, 2 * SMALLEST_SHARE, 10_007])
def test_even_ranges_cover(threads, rows):
    seen = ranges(Workers(threads), rows)
    assert_covers(seen, rows)
    assert len(seen) == min(threads, max(1, rows // SMALLEST_SHARE))


@pytest.mark.parametrize("threads", [1, 2, 3, 7])
@pytest.mark.parametrize("shape", ["even", "one heavy row", "random", "empty rows", "single row", "no pairs"])
def test_ragged_ranges_cover(threads, shape):
    counts = {
        "even": np.full(3000, 12),
        "one heavy row": np.where(np.arange(3000) == 17, 10**6, 1),
        "random": rng(30).integers(0, 100, 3000),
        "empty rows": np.where(np.arange(3000) % 7 == 0, 50, 0),
        "single row": np.array([10**6]),
        "no pairs": np.zeros(50, int),
    }[shape]
    ptr = np.concatenate([[0], np.cumsum(counts)])
    seen = ranges(Workers(threads), ptr)
    assert_covers(seen, len(counts))
    if len(seen) > 1:
        heaviest = max(ptr[stop] - ptr[start] for start, stop, _ in seen)
        assert heaviest <= ptr[-1] / len(seen) + counts.max()


def test_small_ranges_stay_here():
    assert ranges(Workers(4), SMALLEST_SHARE)[0][2] == threading.get_ident()


def test_large_ranges_reach_other_threads():
    workers = Workers(3)
    meet = threading.Barrier(3, timeout=20.0)  # passes only when three threads are inside at once
    workers.run(lambda start, stop: meet.wait(), 3 * SMALLEST_SHARE)
    assert not meet.broken


@pytest.mark.parametrize("bad", [0, 1, 2])
def test_errors_reach_the_caller(bad):
    def fail(start, stop):
        if start == bad * SMALLEST_SHARE:
            raise ZeroDivisionError(f"range {bad}")

    with pytest.raises(ZeroDivisionError, match=f"range {bad}"):
        Workers(3).run(fail, 3 * SMALLEST_SHARE)


FORKED = f"""
import os, signal, threading, time
from femgal.kernels.cpu.threads import Workers
workers, rows = Workers(3), 3 * {SMALLEST_SHARE}
meet = threading.Barrier(3)
workers.run(lambda start, stop: meet.wait(), rows)
time.sleep(0.2)  # both threads of the pool are idle now
if (child := os.fork()) == 0:
    signal.alarm(3)
    workers.run(lambda start, stop: None, rows)
    os._exit(0)
raise SystemExit(os.waitpid(child, 0)[1])
"""


def test_forked_child():
    assert subprocess.run([sys.executable, "-c", FORKED], check=False).returncode == 0


def test_default_is_what_the_process_may_use():
    assert Workers().threads == len(os.sched_getaffinity(0))
