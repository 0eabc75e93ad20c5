# SPDX-License-Identifier: BSD-3-Clause
"""What `femgal bench kernels` measured: every sample, what follows from them, and the same as JSON."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from statistics import median
from typing import Any, NamedTuple

from meshes.errors import InputError
from verify.benchmark.timing import Timing, ratios

SCHEMA = "femgal-bench-kernels-1"


@dataclass(frozen=True)
class StreamResult:
    """STREAM triad on a number of threads; `bytes_moved` per call."""

    threads: int
    bytes_moved: int
    timing: Timing


@dataclass(frozen=True)
class FirstCall:
    """A pass over a mesh of a few tetrahedra.

    Parameters
    ----------
    name, variant : The pass.
    wall, cpu : Times [s] of its first call in this process: its kernels are compiled, or loaded from the cache, unless
        a pass before it had the same ones.
    launch : Later calls: what it costs to start the pass.
    """

    name: str
    variant: str
    wall: float
    cpu: float
    launch: Timing


@dataclass(frozen=True)
class PassResult:
    """A pass of `verify.benchmark.passes` on a number of threads."""

    name: str
    variant: str
    threads: int
    tets: int
    bytes_per_tet: float | None
    timing: Timing

    @property
    def rate(self) -> float:
        """Tetrahedra per second of wall time, from the median."""
        return self.tets / self.timing.median

    @property
    def cpu_rate(self) -> float:
        """Tetrahedra per second if every thread had the same work and a processor of its own."""
        return self.threads * self.tets / self.timing.cpu_median


class Ratio(NamedTuple):
    """Times over one another: median and extremes over the rounds of wall times, and medians of CPU times."""

    median: float
    smallest: float
    largest: float
    by_cpu: float


@dataclass(frozen=True)
class KernelReport:
    """All results of one run.

    Parameters
    ----------
    machine, mesh, settings : What was measured, where, and how; JSON values.
    stream, first_calls, passes : Results.
    """

    machine: dict[str, Any]
    mesh: dict[str, Any]
    settings: dict[str, Any]
    stream: tuple[StreamResult, ...]
    first_calls: tuple[FirstCall, ...]
    passes: tuple[PassResult, ...]

    def find(self, name: str, variant: str, threads: int) -> PassResult | None:
        """The result of a pass; None when it was not measured."""
        wanted = (name, variant, threads)
        return next((p for p in self.passes if (p.name, p.variant, p.threads) == wanted), None)

    def bound(self, result: PassResult) -> float | None:
        """Tetrahedra per second that the best STREAM triad on as many threads would allow."""
        stream = self._stream(result.threads)
        if result.bytes_per_tet is None:
            return None
        return stream.bytes_moved / stream.timing.best / result.bytes_per_tet

    def bound_share(self, result: PassResult) -> tuple[float, float] | None:
        """How much of the bound a pass reaches: by wall time, and by CPU time, both against those of STREAM."""
        bound, stream = self.bound(result), self._stream(result.threads)
        if bound is None or result.bytes_per_tet is None:
            return None
        bytes_moved = result.bytes_per_tet * result.tets
        by_cpu = bytes_moved / result.timing.cpu_median * min(stream.timing.cpu) / stream.bytes_moved
        return result.rate / bound, by_cpu

    def speed_up(self, result: PassResult) -> tuple[float, float] | None:
        """How many times as fast as on one thread: by wall time, the median of the rounds, and by CPU time.

        By CPU time: what it would be if every thread had the same work and a processor of its own.
        """
        one = self.find(result.name, result.variant, 1)
        if one is None:
            return None
        by_cpu = result.threads * one.timing.cpu_median / result.timing.cpu_median
        return median(ratios(one.timing, result.timing)), by_cpu

    def relative(self, result: PassResult, unit: str) -> Ratio | None:
        """Time of a pass over that of the pass `unit` of the same variant and threads, in the same rounds."""
        other = self.find(unit, result.variant, result.threads)
        if other is None:
            return None
        values = ratios(result.timing, other.timing)
        by_cpu = result.timing.cpu_median / other.timing.cpu_median
        return Ratio(median(values), min(values), max(values), by_cpu)

    def as_dict(self) -> dict[str, Any]:
        """Content of the JSON file: every sample [s], and the derived numbers of each pass beside them."""
        content: dict[str, Any] = {"schema": SCHEMA, **asdict(self)}
        for row, result in zip(content["passes"], self.passes, strict=True):
            row["derived"] = {
                "tets_per_second_wall_cpu": (result.rate, result.cpu_rate),
                "bound_tets_per_second": self.bound(result),
                "bound_share_wall_cpu": self.bound_share(result),
                "speed_up_wall_cpu": self.speed_up(result),
            }
        return content

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> KernelReport:
        """The report that `as_dict` described.

        Raises
        ------
        InputError
            Not such a report, or one of another version.
        """
        if content.get("schema") != SCHEMA:
            raise InputError(
                "not a report of `femgal bench kernels`", where="schema", found=content.get("schema"), allowed=SCHEMA
            )
        about = {key: content[key] for key in ("machine", "mesh", "settings")}
        stream = tuple(StreamResult(**_parsed(row, "timing")) for row in content["stream"])
        first_calls = tuple(FirstCall(**_parsed(row, "launch")) for row in content["first_calls"])
        passes = tuple(PassResult(**_parsed(row, "timing")) for row in content["passes"])
        return cls(**about, stream=stream, first_calls=first_calls, passes=passes)

    def _stream(self, threads: int) -> StreamResult:
        return next(result for result in self.stream if result.threads == threads)


def _parsed(row: dict[str, Any], timing: str) -> dict[str, Any]:
    samples = {key: tuple(values) for key, values in row[timing].items()}
    return {key: value for key, value in row.items() if key != "derived"} | {timing: Timing(**samples)}
