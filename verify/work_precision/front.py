# SPDX-License-Identifier: BSD-3-Clause
"""The best of a curve: its front of error against cost, and the cost of an error on it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

Row = dict[str, Any]


@dataclass(frozen=True)
class TimeTo:
    """What an error costs.

    Parameters
    ----------
    cost : Seconds or passes per frame.
    rows : The one or two rows that say so, the cheaper first.
    at_most : Whether the cheapest row of all has a smaller error already: a cheaper one might do.
    """

    cost: float
    rows: tuple[Row, ...]
    at_most: bool


def front(rows: Iterable[Row], cost: str) -> list[Row]:
    """Rows that no other beats in both error and cost, the cheapest first; errors fall from row to row."""
    found: list[Row] = []
    for row in sorted(_judged(rows, cost), key=lambda row: (row[cost], row["error"])):
        if not found or row["error"] < found[-1]["error"]:
            found.append(row)
    return found


def _judged(rows: Iterable[Row], cost: str) -> list[Row]:
    return [row for row in rows if row["error"] is not None and row["error"] > 0.0 and row[cost]]


def cost_of(target: float, rows: Iterable[Row], cost: str) -> TimeTo | None:
    """What an error costs on the front of some rows, interpolated between logarithms; None where none reaches it."""
    best = front(rows, cost)
    within = next((number for number, row in enumerate(best) if row["error"] <= target), None)
    if within is None:
        return None
    after = best[within]
    if within == 0:
        return TimeTo(after[cost], (after,), after["error"] < target)
    before = best[within - 1]
    share = math.log(before["error"] / target) / math.log(before["error"] / after["error"])
    return TimeTo(before[cost] * (after[cost] / before[cost]) ** share, (before, after), False)


def finalists(rows: Sequence[Row], targets: Iterable[float], cost: str, curves: int = 3) -> list[Row]:
    """Rows that decide who is soonest at a target, of the best few curves at each; rows of one scene."""
    chosen: dict[int, Row] = {}
    names = list(dict.fromkeys(row["curve"] for row in rows))
    for target in targets:
        costs = [cost_of(target, [row for row in rows if row["curve"] == name], cost) for name in names]
        best = sorted((found for found in costs if found is not None), key=lambda found: found.cost)[:curves]
        chosen |= {id(row): row for found in best for row in found.rows}
    return list(chosen.values())
