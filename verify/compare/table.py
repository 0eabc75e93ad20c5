# SPDX-License-Identifier: BSD-3-Clause
"""The table of a comparison, frame by frame, and one sentence about the whole."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from verify.benchmark.kernel_tables import TextTable
from verify.compare.comparison import Comparison
from verify.compare.hints import energy_scale
from verify.compare.measures import impulse_scale, spin_scale
from verify.diagnose.finding import percent, shown

MOST_ROWS = 24
_HEADS = (
    "frame",
    "time [s]",
    "error",
    "largest [m]",
    "at vertex",
    "elastic [J]",
    "kinetic [J]",
    "total [J]",
    "total - ref",
    "|p - ref|",
    "|L - ref|",
)


def table(comparison: Comparison, most: int = MOST_ROWS) -> TextTable:
    """Frames evenly spread, the last, the worst and the first lost among them.

    Differences of energy and momenta are in units of what they are judged by; the record holds both sides in full.
    """
    chosen = _chosen(comparison, most)
    scene, n = comparison.reference.target.scene.name, len(comparison.aligned.frames)
    title = f"{comparison.name} against {scene}: {len(chosen)} of {n} frames"
    gaps = (
        _gap(comparison.theirs.total - comparison.ours.total, energy_scale(comparison)),
        _gap(_length(comparison.theirs.linear - comparison.ours.linear), impulse_scale(comparison)),
        _gap(_length(comparison.theirs.angular - comparison.ours.angular), spin_scale(comparison)),
    )
    return TextTable(title, _HEADS, tuple(_line(comparison, row, gaps) for row in chosen))


def verdict(comparison: Comparison) -> str:
    """How far the motion is from the scene's, in one sentence."""
    n = len(comparison.aligned.frames)
    own = f"the reference itself is off by {percent(comparison.own_error)}"
    if not math.isfinite(comparison.error):
        return f"{comparison.name} is lost after frame {comparison.good_until}; {own}"
    part = "" if comparison.good_until == comparison.last_frame else f" up to frame {comparison.good_until}"
    return f"{comparison.name} is off by {percent(comparison.error)} of the motion over its {n} frames{part}; {own}"


def _chosen(comparison: Comparison, most: int) -> list[int]:
    n = len(comparison.aligned.frames)
    spread = set(range(0, n, max(1, math.ceil(n / most))))
    lost = np.flatnonzero(~comparison.aligned.finite)[:1].tolist()
    return sorted(spread | {comparison.worst, n - 1} | set(lost))


def _gap(difference: NDArray[np.float64], scale: float) -> NDArray[np.float64]:
    return difference / scale if scale > 0.0 else np.full_like(difference, np.nan)


def _length(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.linalg.norm(vectors, axis=1))


def _line(comparison: Comparison, row: int, gaps: tuple[NDArray[np.float64], ...]) -> tuple[str, ...]:
    frame, theirs = int(comparison.aligned.frames[row]), comparison.theirs
    return (
        str(frame),
        f"{frame * comparison.reference.target.frame:.4g}",
        _relative(comparison.frame_error[row]),
        _relative(comparison.largest[row]),
        str(comparison.place(row)["vertex"]),
        *(_number(energy[row]) for energy in (theirs.elastic, theirs.kinetic, theirs.total)),
        f"{gaps[0][row]:+.1e}" if np.isfinite(gaps[0][row]) else "-",
        *(_relative(gap[row]) for gap in gaps[1:]),
    )


def _relative(value: float) -> str:
    return f"{value:.1e}" if np.isfinite(value) else "-"


def _number(value: float) -> str:
    return shown(float(value), 3) if np.isfinite(value) else "-"
