# SPDX-License-Identifier: BSD-3-Clause
"""How much too stiff linear tetrahedra make this body: in bending, and by volume where nu is near 1/2."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from verify.diagnose.cantilever import over_stiffness
from verify.diagnose.finding import Finding, Severity, shown
from verify.diagnose.target import Target
from verify.diagnose.thickness import Thickness

# Over-stiffness beyond which bending is noted, is visibly wrong, and is another body.
NOTED, WRONG, ANOTHER_BODY = 1.1, 1.5, 3.0
# Poisson's ratio at which the same elements do not lock by volume, for comparison.
UNLOCKED_NU = 0.3
# Up to here more elements help, as in any bending.
FAIR_NU = 0.45


def bending(target: Target, thickness: Thickness) -> Finding:
    """Elements through the thickness, and what a cantilever of as many says about bending."""
    nu = _common(target.world.nu)
    thin, middle = (float(np.percentile(thickness.elements, q)) for q in (10, 50))
    factor = {"thin": over_stiffness(nu, thin), "middle": over_stiffness(nu, middle)}
    slim = thickness.elements <= thin
    numbers = {
        "elements_through_thin_tenth": thin,
        "elements_through_median": middle,
        "thickness_of_thin_tenth_m": np.percentile(thickness.length, 10),
        "thickness_median_m": np.percentile(thickness.length, 50),
        "over_stiffness_thin_tenth": factor["thin"],
        "over_stiffness_median": factor["middle"],
        "thin_at_m": thickness.start[slim][:3],
        "nu": nu,
    }
    if middle <= 1.1 * thin:
        where, beams = f"{shown(thin)} elements through the thickness of most of the body", _times(factor["thin"])
    else:
        where = (
            f"Up to {shown(thin)} elements through the thickness at the thinnest tenth of the boundary, up to "
            f"{shown(middle)} at half of it"
        )
        beams = f"{_times(factor['thin'])} and {_times(factor['middle'])}"
    what = (
        f"{where}. Cantilevers of linear tetrahedra with so many elements and nu = {nu:.4g} are {beams} as stiff as "
        "the material."
    )
    severity = _severity(factor["thin"])
    advice = "" if severity is Severity.OK else _advice(nu, thin, factor["thin"])
    return Finding("bending", severity, what, advice, numbers)


def volumetric(target: Target, thickness: Thickness) -> Finding:
    """Locking by volume: lam / mu, constraints against unknowns, and the cantilever at nu = 0.3 beside it."""
    disc, nu = target.disc, _common(target.world.nu)
    ratio = float((disc.lam / disc.mu).max()) - 1.0
    free = int(disc.free.sum())
    cells = float(np.percentile(thickness.elements, 50))
    locked, unlocked = over_stiffness(nu, cells), over_stiffness(min(nu, UNLOCKED_NU), cells)
    factor = locked / unlocked
    numbers = {
        "nu": nu,
        "lam_over_mu": ratio,
        "tets_per_unknown": disc.n_tets / max(1, 3 * free),
        "over_stiffness": locked,
        "over_stiffness_at_nu_0.3": unlocked,
        "factor": factor,
    }
    what = (
        f"lam / mu = {ratio:.4g} (Lame's parameters, nu = {nu:.4g}), {shown(numbers['tets_per_unknown'])} tetrahedra "
        f"per unknown. Each keeps its own volume: bending is {_times(factor)} as stiff as with the same "
        f"elements at nu = {UNLOCKED_NU:g}, each held against its own material."
    )
    severity = _severity(factor)
    if severity is Severity.OK or nu <= FAIR_NU:
        return Finding("volume locking", min(severity, Severity.NOTE, key=_rank), what, numbers=numbers)
    advice = (
        "Linear tetrahedra cannot keep volume and bend at the same time. Take nu <= 0.45 where the last per cent of "
        "volume does not matter, or compare with quadratic or mixed elements: refining helps only slowly."
    )
    return Finding("volume locking", severity, what, advice, numbers)


def _common(nu: NDArray[np.float64]) -> float:
    """The largest Poisson's ratio of at least a hundredth of the elements."""
    return float(np.percentile(nu, 99))


def _rank(severity: Severity) -> int:
    return severity.rank


def _severity(factor: float) -> Severity:
    if factor < NOTED:
        return Severity.OK
    if factor < WRONG:
        return Severity.NOTE
    return Severity.WARNING if factor < ANOTHER_BODY else Severity.PROBLEM


def _advice(nu: float, cells: float, factor: float) -> str:
    enough = next((n for n in (2, 3, 4, 6, 8, 12, 16, 24) if n > cells and over_stiffness(nu, n) <= NOTED), None)
    if enough is None:
        return "No affordable refinement cures this at such a nu: see volume locking."
    more = (enough / max(cells, 1.0)) ** 3
    return (
        f"{enough} elements through the thickness would be {_times(over_stiffness(nu, enough))} as stiff (about "
        f"{shown(more)} times the vertices, when refined evenly); or read frequencies as up to "
        f"{shown(factor**0.5)} times too high where this part bends."
    )


def _times(factor: float) -> str:
    return f"{shown(factor, 3)} times"
