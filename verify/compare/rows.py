# SPDX-License-Identifier: BSD-3-Clause
"""A comparison as rows of the suite, so that it is shown, judged and written like every other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from verify.compare import measures
from verify.compare.comparison import Comparison
from verify.suite.case import Case, Kind, Measurement, Row, Skip
from verify.suite.use import Use

Measure = Callable[[Comparison], Measurement]

# Largest relative error that counts as the same motion, where the user does not say.
TOLERANCE = 0.02
# Share of the tolerance that the reference's own error may have, or nothing can be judged.
REFERENCE_SHARE = 0.3
# Vertices are the same when they are as close as this share of the mean edge; so is the start.
SAME = 1e-3
_SOURCE = "velocity Verlet in double precision at a share of its stable step (femgal), held against itself"


@dataclass(frozen=True)
class _Question:
    """A row to be: the fields are those of `Case`."""

    name: str
    title: str
    quantity: str
    unit: str
    formula: str
    measure: Measure


_ABOUT_THE_RESULT = (
    (
        _Question(
            "vertices",
            "Every vertex of the result is one of the scene",
            "largest distance at rest over the mean edge",
            "m",
            "rest positions of the scene",
            measures.vertices,
        ),
        SAME,
        "positions in float32",
    ),
    (
        _Question(
            "frames",
            "The result has all frames, and all are numbers",
            "frames of the scene that are missing at the end or hold what is no number",
            "1",
            "frames of the scene",
            measures.frames,
        ),
        0.0,
        "none may be lost",
    ),
    (
        _Question(
            "start",
            "The result starts where the scene does",
            "largest distance at frame 0 over the mean edge",
            "m",
            "start of the scene",
            measures.start,
        ),
        SAME,
        "positions in float32",
    ),
)
_REFERENCE = _Question(
    "reference",
    "The reference is far better than what it judges",
    "relative trajectory error of the reference itself",
    "1",
    "a third of its distance to itself at twice the step",
    measures.reference,
)
_JUDGED_BY_THE_REFERENCE = (
    _Question(
        "trajectory",
        "The motion is that of the scene",
        "mass-weighted RMS of the difference over vertices and frames, over that of the motion",
        "1",
        "x(t) of the semi-discrete problem",
        measures.trajectory,
    ),
    _Question(
        "energy",
        "The energy is that of the scene in every frame",
        "largest difference of the total energy over the largest kinetic and elastic energy",
        "J",
        "elastic + kinetic + that of gravity",
        measures.energy,
    ),
    _Question(
        "linear-momentum",
        "The momentum is that of the scene in every frame",
        "largest difference over sqrt(2 M E_kin) at its largest",
        "kg m/s",
        "sum of m v",
        measures.linear,
    ),
    _Question(
        "angular-momentum",
        "The angular momentum is that of the scene in every frame",
        "largest difference over sqrt(2 M E_kin) times the radius of gyration",
        "kg m^2/s",
        "sum of m (x - c) x v about the centre of mass",
        measures.angular,
    ),
)


def comparison_rows(comparison: Comparison, tolerance: float = TOLERANCE) -> list[Row]:
    """Rows that say what is right and what is not.

    Parameters
    ----------
    tolerance : Largest relative error of motion, energies and momenta.
    """
    rows = [_row(comparison, question, limit, reason) for question, limit, reason in _ABOUT_THE_RESULT]
    enough = REFERENCE_SHARE * tolerance
    rows.append(_row(comparison, _REFERENCE, enough, f"{REFERENCE_SHARE:g} of what the others are judged by"))
    reason = "said by the user; 2 % where nothing is said: what default settings should reach"
    rows += [_row(comparison, question, tolerance, reason, enough) for question in _JUDGED_BY_THE_REFERENCE]
    return rows


def _row(
    comparison: Comparison, question: _Question, tolerance: float, reason: str, enough: float | None = None
) -> Row:
    """One row; with `enough` it is not judged by a reference whose own error is larger."""

    def measured(use: Use) -> Measurement:
        if enough is not None and not comparison.own_error <= enough:
            raise Skip(f"the reference itself is uncertain by {comparison.own_error:.2g}")
        return question.measure(comparison)

    return Row(
        Case(
            f"compare/{question.name}",
            question.title,
            question.quantity,
            question.unit,
            Kind.CROSS_CODE,
            question.formula,
            _SOURCE,
            tolerance,
            reason,
            measured,
        ),
        {},
    )
