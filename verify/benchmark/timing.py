# SPDX-License-Identifier: BSD-3-Clause
"""Times calls on a machine that others use too.

Candidates that are to be compared run in turns, round after round, and are compared within their round: what disturbs
the machine for seconds disturbs them all. Beside the wall time stands the CPU time of all threads of the process, which
waiting for a busy processor does not raise.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import TypeVar

Call = Callable[[], object]
Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True)
class Timing:
    """Times of repeated calls of one candidate; sample k belongs to round k.

    Parameters
    ----------
    wall : Elapsed time of each call [s].
    cpu : CPU time of each call [s], summed over the threads of the process.
    """

    wall: tuple[float, ...]
    cpu: tuple[float, ...]

    @property
    def median(self) -> float:
        """Median wall time [s]."""
        return median(self.wall)

    @property
    def best(self) -> float:
        """Shortest wall time [s]."""
        return min(self.wall)

    @property
    def worst(self) -> float:
        """Longest wall time [s]."""
        return max(self.wall)

    @property
    def cpu_median(self) -> float:
        """Median CPU time [s]."""
        return median(self.cpu)


def timed(call: Call, calls: int = 1) -> tuple[float, float]:
    """Wall and CPU time [s] of one call, as the mean over `calls` of them in a row."""
    cpu, wall = time.process_time(), time.perf_counter()
    for _ in range(calls):
        call()
    return (time.perf_counter() - wall) / calls, (time.process_time() - cpu) / calls


def interleaved(
    candidates: Mapping[Key, Call],
    repeats: int,
    *,
    calls: int = 1,
    warm_up: int = 1,
    on_round: Callable[[int], None] = lambda number: None,
) -> dict[Key, Timing]:
    """Time candidates in turns.

    Parameters
    ----------
    candidates : What to call, by any key.
    repeats : Rounds, 1 or more: one sample of each candidate per round. Every other round goes backwards through the
        candidates, so that a machine that slows down steadily favours none.
    calls : Calls per sample; more than one for calls shorter than the clock can tell.
    warm_up : Untimed calls before each sample. One brings back what the other candidates threw out of the caches: a
        solver makes its passes one after another over the same mesh.
    on_round : Called with 0, 1, ... before each round.
    """
    samples: dict[Key, list[tuple[float, float]]] = {name: [] for name in candidates}
    collecting = gc.isenabled()
    gc.disable()
    try:
        for number in range(repeats):
            on_round(number)
            for key in list(candidates)[:: -1 if number % 2 else 1]:
                for _ in range(warm_up):
                    candidates[key]()
                samples[key].append(timed(candidates[key], calls))
    finally:
        if collecting:
            gc.enable()
    return {key: Timing(*_columns(pairs)) for key, pairs in samples.items()}


def ratios(of: Timing, to: Timing) -> tuple[float, ...]:
    """Wall time of one candidate over that of another, round by round."""
    return tuple(a / b for a, b in zip(of.wall, to.wall, strict=True))


def _columns(pairs: Sequence[tuple[float, float]]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    return tuple(pair[0] for pair in pairs), tuple(pair[1] for pair in pairs)
