# SPDX-License-Identifier: BSD-3-Clause
"""What is measured in a comparison: vertices, frames, start, reference, trajectory, energy and momenta."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from verify.compare.comparison import Comparison
from verify.compare.hints import energy_scale, hints
from verify.compare.plots import plots
from verify.problems.bodies import mean_edge
from verify.suite.case import Measurement, Skip
from verify.suite.measure import compare

Floats = NDArray[np.float64]


def vertices(comparison: Comparison) -> Measurement:
    """How far vertices that are the same are apart."""
    matching = comparison.aligned.matching
    edge = mean_edge(comparison.reference.target.disc.mesh)
    return Measurement(matching.distance, 0.0, matching.distance / edge, matching.how)


def frames(comparison: Comparison) -> Measurement:
    """Frames that are missing at the end, and frames that are lost."""
    frames, last = comparison.aligned.frames, comparison.last_frame
    lost = int((~comparison.aligned.finite).sum())
    missing = last - int(frames[-1])
    notes = []
    if missing:
        notes.append(f"it ends at frame {frames[-1]} of {last}")
    if lost:
        first = frames[np.flatnonzero(~comparison.aligned.finite)[0]]
        notes.append(f"{lost} of its frames hold what is no number, the first is {first}")
    step = np.diff(frames)
    if len(step) and step.max() > 1:
        notes.append(f"{len(frames)} of the {frames[-1] + 1} frames up to there are given")
    if comparison.aligned.beyond:
        notes.append(f"{comparison.aligned.beyond} frames after the end of the scene are left out")
    return Measurement(float(missing + lost), 0.0, float(missing + lost), "; ".join(notes))


def start(comparison: Comparison) -> Measurement:
    """How far frame 0 is from the start of the scene."""
    if comparison.aligned.frames[0] != 0:
        raise Skip("the result does not have frame 0")
    off = float(comparison.largest[0])
    return Measurement(off, 0.0, off / mean_edge(comparison.reference.target.disc.mesh))


def reference(comparison: Comparison) -> Measurement:
    """The reference's own error."""
    label = f"{comparison.reference.label}, {comparison.reference.substeps} substeps in the last frame"
    return Measurement(comparison.own_error, 0.0, comparison.own_error, label)


def trajectory(comparison: Comparison) -> Measurement:
    """The trajectory error, where it is largest, and what may be the matter."""
    worst = comparison.worst
    place = comparison.place(worst)
    where = ", ".join(f"{c:.4g}" for c in place["rest_m"])
    note = (
        f"own error of the reference {comparison.own_error:.1e}; largest difference "
        f"{comparison.largest[worst]:.3g} m in frame {comparison.aligned.frames[worst]} at vertex {place['vertex']}, "
        f"at rest ({where}) m"
    )
    lines = "\n".join([note, *hints(comparison)])
    return Measurement(comparison.error, 0.0, comparison.error, lines, plots(comparison))


def energy(comparison: Comparison) -> Measurement:
    """Total energy."""
    return _field(comparison.theirs.total, comparison.ours.total, energy_scale(comparison), comparison)


def linear(comparison: Comparison) -> Measurement:
    """Linear momentum."""
    return _field(comparison.theirs.linear, comparison.ours.linear, impulse_scale(comparison), comparison)


def angular(comparison: Comparison) -> Measurement:
    """Angular momentum about the centre of mass."""
    return _field(comparison.theirs.angular, comparison.ours.angular, spin_scale(comparison), comparison)


def spin_scale(comparison: Comparison) -> float:
    """The same times the radius of gyration at rest [kg m^2/s]."""
    mass, X = comparison.reference.mass, comparison.reference.target.disc.mesh.points
    arm = X - mass @ X / mass.sum()
    return float(np.sqrt(mass @ (arm**2).sum(axis=1) / mass.sum())) * impulse_scale(comparison)


def impulse_scale(comparison: Comparison) -> float:
    """sqrt(2 M E_kin) at its largest [kg m/s]: the momentum if all went one way."""
    kinetic = comparison.ours.kinetic
    most = float(np.nanmax(kinetic)) if np.isfinite(kinetic).any() else 0.0
    return float(np.sqrt(2.0 * comparison.reference.mass.sum() * most))


def _field(theirs: Floats, ours: Floats, scale: float, comparison: Comparison) -> Measurement:
    """Largest difference over the frames whose numbers are known on our side."""
    known = np.isfinite(ours).reshape(len(ours), -1).all(axis=1)
    if not known.any() or scale == 0.0:
        raise Skip("nothing moves, or too few frames for velocities")
    note = "" if comparison.aligned.v is not None else "velocities of both from differences between frames"
    a, b = (of[known].reshape(int(known.sum()), -1) for of in (theirs, ours))
    row = int(np.argmax(np.where(np.isfinite(a), np.abs(a - b), np.inf).max(axis=1)))
    measured = compare(a[row], b[row], scale)
    frame = f"largest in frame {comparison.aligned.frames[known][row]}"
    return Measurement(measured.computed, measured.reference, measured.error, f"{frame}; {note}" if note else frame)
