# SPDX-License-Identifier: BSD-3-Clause
"""What may be the matter with a motion that differs: the guesses of someone who has seen many."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from verify.compare.comparison import Comparison
from verify.diagnose.finding import percent, shown

Floats = NDArray[np.float64]

# A guess is worth telling when it explains all but this share of the difference.
EXPLAINS = 0.4
# Tempos that are tried, and how many vertices take part.
_TEMPOS = np.geomspace(0.4, 2.5, 61)
_MOST_VERTICES = 500
# Changes of tempo and size that say nothing.
_SMALL = 0.02
# Energy, in units of what the reference exchanges, that is worth a word.
_ENERGY = 0.02


def hints(comparison: Comparison) -> list[str]:
    """Guesses about the cause of the difference, the most telling first; none where there is little to explain."""
    if not comparison.error > max(10.0 * comparison.own_error, 1e-3):
        return []
    return [guess for look in (_start, _motion, _energy) for guess in look(comparison)]


def _start(comparison: Comparison) -> Iterator[str]:
    if comparison.aligned.frames[0] != 0:
        return
    off = comparison.largest[0]
    size = float(np.ptp(comparison.reference.x[0], axis=0).max())
    if off > 1e-5 * size:
        yield f"It starts elsewhere: frame 0 is up to {off:.3g} m from the start of the scene."


def _motion(comparison: Comparison) -> Iterator[str]:
    """Motions that are a frame ahead or behind, or faster, slower, larger or smaller, and the same otherwise."""
    before = _unexplained(comparison, 0.0)
    after, size, tempo = _best_tempo(comparison)
    for shift, word in ((1.0, "ahead"), (-1.0, "behind")):
        shifted = _unexplained(comparison, shift)
        if shifted < min(EXPLAINS * before, after):
            yield f"It is one frame {word}: check which time its first frame has."
            return
    if not after < EXPLAINS * before or (abs(tempo - 1.0) < _SMALL and abs(size - 1.0) < _SMALL):
        return
    said = f"It is the reference's motion {shown(tempo, 3)} times as fast and {shown(size, 3)} times as large"
    said += f" (that explains {percent(1.0 - after / before)} of the difference)."
    if size < 0.0:
        yield said + " Its direction is turned round: check signs and axes."
    elif abs(tempo - 1.0) >= _SMALL:
        yield (
            said
            + f" So would be a body with E / rho {shown(tempo**2)} times the scene's: check E, nu, rho and locking."
        )
    else:
        yield said + " Check units, initial velocity and gravity."


def _energy(comparison: Comparison) -> Iterator[str]:
    theirs, ours = comparison.theirs.total, comparison.ours.total
    scale = energy_scale(comparison)
    gap = theirs - ours
    known = np.flatnonzero(np.isfinite(gap))
    if not len(known) or scale == 0.0:
        return
    last, most = float(gap[known[-1]] / scale), float(gap[known].max() / scale)
    if most > _ENERGY and most > -last:
        frame = comparison.aligned.frames[known[int(np.argmax(gap[known]))]]
        yield (
            f"Its energy is up to {percent(most)} above the reference's (frame {frame}): steps that are too long, or "
            "another material."
        )
    elif last < -_ENERGY:
        yield (
            f"It has lost {percent(-last)} of the energy at the last frame: damping by the method or by long steps, or "
            "another material."
        )


def energy_scale(comparison: Comparison) -> float:
    """Largest kinetic and elastic energy of the reference [J]."""
    both = comparison.ours.kinetic + comparison.ours.elastic
    return float(np.nanmax(both)) if np.isfinite(both).any() else 0.0


def _best_tempo(comparison: Comparison) -> tuple[float, float, float]:
    """What the best tempo leaves unexplained, its size, and itself."""
    from scipy.optimize import minimize_scalar

    best = int(np.argmin([_fit(comparison, tempo)[0] for tempo in _TEMPOS]))
    ends = _TEMPOS[max(best - 1, 0)], _TEMPOS[min(best + 1, len(_TEMPOS) - 1)]
    tempo = float(minimize_scalar(lambda one: _fit(comparison, one)[0], bounds=ends, method="bounded").x)
    return *_fit(comparison, tempo), tempo


def _fit(comparison: Comparison, tempo: float) -> tuple[float, float]:
    """What a tempo leaves unexplained with the best size, and that size."""
    theirs, ours, kept = _sampled(comparison, lambda frames: tempo * frames)
    norm = float((ours**2).sum())
    if not kept or norm == 0.0:
        return np.inf, 1.0
    size = float((theirs * ours).sum()) / norm
    return float(((theirs - size * ours) ** 2).sum()) / kept, size


def _unexplained(comparison: Comparison, shift: float) -> float:
    theirs, ours, kept = _sampled(comparison, lambda frames: frames + shift)
    return float(((theirs - ours) ** 2).sum()) / kept if kept else np.inf


def _sampled(comparison: Comparison, at: Callable[[Floats], Floats]) -> tuple[Floats, Floats, int]:
    """Weighted displacements of both, the reference's at other times; and the number of frames that it has."""
    from scipy.interpolate import CubicSpline

    reference, aligned = comparison.reference, comparison.aligned
    some = np.linspace(0, len(reference.mass) - 1, min(len(reference.mass), _MOST_VERTICES)).astype(int)
    weight = np.sqrt(reference.mass[some])[:, None]
    wanted = at(aligned.frames.astype(float))
    kept = (wanted >= 0.0) & (wanted <= len(reference.x) - 1) & aligned.finite & (aligned.frames > 0)
    start = reference.x[0, some]
    spline = CubicSpline(np.arange(len(reference.x)), (reference.x[:, some] - start) * weight)
    return (aligned.x[kept][:, some] - start) * weight, spline(wanted[kept]), int(kept.sum())
