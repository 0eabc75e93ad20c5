# SPDX-License-Identifier: BSD-3-Clause
"""The measuring core.

1. Median, best, worst and CPU median are those of the samples.
2. Candidates take turns, every other round backwards, each warmed up; every sample belongs to its round.
3. A sample of several calls is their mean.
4. Waiting counts as wall time and not as CPU time; CPU time is the sum over threads.
5. Ratios are taken round by round, so a disturbance that hits a whole round cancels.
6. The garbage collector is off while it measures, and afterwards as before, also when a candidate fails.
"""

from __future__ import annotations

import gc
import threading
import time

import pytest

from verify.benchmark.timing import Timing, interleaved, ratios, timed


def test_statistics():
    timing = Timing((3.0, 1.0, 10.0, 2.0), (0.5, 0.25, 4.0))
    assert (timing.median, timing.best, timing.worst, timing.cpu_median) == (2.5, 1.0, 10.0, 0.5)


@pytest.mark.parametrize("warm_up", [0, 2])
def test_candidates_take_turns(warm_up):
    called, rounds = [], []
    candidates = {name: (lambda name=name: called.append(name)) for name in "abc"}
    timings = interleaved(candidates, 3, warm_up=warm_up, on_round=rounds.append)
    once = [*"abc", *"cba", *"abc"]
    assert called == [name for name in once for _ in range(warm_up + 1)]
    assert rounds == [0, 1, 2]
    assert list(timings) == ["a", "b", "c"]
    assert all(len(timing.wall) == len(timing.cpu) == 3 for timing in timings.values())


def test_samples_belong_to_their_round():
    waits = iter([0.0, 0.03, 0.0])
    timing = interleaved({"one": lambda: time.sleep(next(waits))}, 3, warm_up=0)["one"]
    assert timing.worst == timing.wall[1] >= 0.03


def test_mean_of_several_calls():
    called = []
    wall, _ = timed(lambda: (called.append(1), time.sleep(0.004)), calls=5)
    assert len(called) == 5
    assert wall >= 0.004
    begun = time.perf_counter()
    wall, _ = timed(lambda: time.sleep(0.004), calls=5)
    assert 5 * wall <= time.perf_counter() - begun


def test_waiting_is_no_cpu_time():
    wall, cpu = timed(lambda: time.sleep(0.05))
    assert wall >= 0.05
    assert cpu < 0.5 * wall


def burn(seconds: float = 0.02) -> None:
    until = time.thread_time() + seconds
    while time.thread_time() < until:
        pass


def test_cpu_time_is_summed_over_threads():
    def both():
        other = threading.Thread(target=burn)
        other.start()
        burn()
        other.join()

    _, cpu = timed(both)
    assert cpu >= 0.04


def test_ratios_are_within_rounds():
    quiet, disturbed = Timing((1.0, 8.0, 2.0), (1.0,) * 3), Timing((2.0, 16.0, 4.0), (1.0,) * 3)
    assert ratios(disturbed, quiet) == (2.0, 2.0, 2.0)


def test_garbage_collector():
    states = []
    interleaved({"one": lambda: states.append(gc.isenabled())}, 2)
    assert states == [False] * 4
    assert gc.isenabled()
    with pytest.raises(ZeroDivisionError):
        interleaved({"one": lambda: 1 / 0}, 1)
    assert gc.isenabled()
    gc.disable()
    try:
        interleaved({"one": lambda: None}, 1)
        assert not gc.isenabled()
    finally:
        gc.enable()
