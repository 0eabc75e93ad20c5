# SPDX-License-Identifier: BSD-3-Clause
"""Judges claims by figures: every claim says by which rule, every rule says what it compared."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from verify.studies.definition import Claim, Part
from verify.studies.entries import COSTS

Numbers = Mapping[str, Any]

HOLDS, FAILS, UNKNOWN = "holds", "does not hold", "cannot be judged here"


@dataclass(frozen=True)
class Case:
    """One comparison that a claim rests on.

    Parameters
    ----------
    where : Problem, level and curves.
    found : What was compared, in words.
    holds : Whether it supports the claim; None when there is nothing to compare.
    """

    where: str
    found: str
    holds: bool | None


def judge(claim: Claim, part: Part, numbers: Numbers) -> dict[str, Any]:
    """The verdict on a claim, with every comparison; JSON-ready.

    A claim holds when all its comparisons do, does not hold when none does, and holds in part in between.

    Parameters
    ----------
    numbers : Record of the part.
    """
    cases = list(_RULES[claim.rule](claim, part, numbers))
    judged = [case for case in cases if case.holds is not None]
    good = sum(bool(case.holds) for case in judged)
    return {
        "text": claim.text,
        "source": claim.source,
        "part": part.id,
        "rule": rule_in_words(claim),
        "verdict": _verdict(good, len(judged)),
        "good": good,
        "judged": len(judged),
        "cases": [asdict(case) for case in cases],
    }


def _verdict(good: int, judged: int) -> str:
    if not judged:
        return UNKNOWN
    if good == judged:
        return HOLDS
    return f"{HOLDS} in {good} of {judged} comparisons" if good else FAILS


def rule_in_words(claim: Claim) -> str:
    """What is compared, and when that supports the claim."""
    of, than, what = " and ".join(claim.of), " and ".join(claim.than), _QUANTITIES[claim.what]
    if claim.what in COSTS:
        what += " to each level of eps18" if claim.measure == "eps18" else " to each level of our error"
    if claim.rule == "inner-minimum":
        return (
            f"of the tried numbers of substeps the least {what} of {of} belongs neither to the fewest nor to the most"
        )
    if claim.rule == "trend":
        bounds = [f"at least {claim.least:g}"] if claim.least is not None else []
        bounds += [f"at most {claim.most:g}"] if claim.most is not None else []
        whose = f"{what}: {than} over {of}" if than else f"{what} of {of}"
        return f"{whose}, at the last value of the axis over that at the first: {' and '.join(bounds)}"
    if not than:
        return f"{what} of {of}: at most {claim.factor:g}"
    return f"{what}: {of} at most {claim.factor:g} times {than}"


_QUANTITIES = {
    "seconds": "seconds",
    "passes": "element passes",
    "iterations": "iterations",
    "substeps": "substeps per frame",
    "seconds per frame": "seconds per frame",
    "eps18": "eps18",
    "error": "trajectory error",
    "peak_mb": "peak memory [MB]",
}


def _at_most(claim: Claim, part: Part, numbers: Numbers) -> Iterator[Case]:
    for problem in _problems(claim, part, numbers):
        for level in _levels(claim, part):
            for of in claim.of:
                ours = _value(claim, numbers, problem["id"], of, level)
                others: tuple[str | None, ...] = claim.than or (None,)
                yield from (_compared(claim, numbers, problem["id"], level, of, ours, other) for other in others)


def _compared(
    claim: Claim, numbers: Numbers, problem: str, level: float | None, of: str, ours: float | None, other: str | None
) -> Case:
    where = _where(problem, claim, level)
    if other is None:
        return Case(f"{where}: {of}", _shown(ours), None if ours is None else ours <= claim.factor)
    theirs = _value(claim, numbers, problem, other, level)
    where = f"{where}: {of} against {other}"
    found = f"{_shown(ours)} against {_shown(theirs)}"
    if ours is not None and theirs is not None:
        return Case(where, f"{found}, ratio {ours / theirs:.3g}" if theirs else found, ours <= claim.factor * theirs)
    if not _both_were_run(numbers, problem, (of, other)) or claim.what not in COSTS:
        return Case(where, found, None)
    # A level that one of them does not reach at all is a comparison too.
    return Case(where, found, None if ours is None and theirs is None else ours is not None)


def _trend(claim: Claim, part: Part, numbers: Numbers) -> Iterator[Case]:
    for group in _along(part, _problems(claim, part, numbers)):
        for level in _levels(claim, part):
            for of in claim.of:
                values = [_trend_value(claim, numbers, problem["id"], of, level) for problem in group]
                yield _change(claim, part, group, level, of, values)


def _change(
    claim: Claim, part: Part, group: list[Numbers], level: float | None, of: str, values: list[float | None]
) -> Case:
    where = _where(f"{group[0]['id']} to {axis_value(part, group[-1]):g}", claim, level) + f": {of}"
    first, last = values[0], values[-1]
    if len(values) < 2 or not first or last is None:
        return Case(where, f"{_shown(first)} to {_shown(last)}", None)
    change = last / first
    holds = (claim.least is None or change >= claim.least) and (claim.most is None or change <= claim.most)
    return Case(where, f"{_shown(first)} to {_shown(last)}, factor {change:.3g}", holds)


def _trend_value(claim: Claim, numbers: Numbers, problem: str, of: str, level: float | None) -> float | None:
    ours = _value(claim, numbers, problem, of, level)
    if not claim.than:
        return ours
    theirs = _value(claim, numbers, problem, claim.than[0], level)
    return theirs / ours if ours and theirs is not None else None


def _inner_minimum(claim: Claim, part: Part, numbers: Numbers) -> Iterator[Case]:
    for problem in _problems(claim, part, numbers):
        for of in claim.of:
            rows = [row for row in numbers["rows"] if row["problem"] == problem["id"] and row["curve"] == of]
            costs = {
                row["substeps"][0]: row["seconds"]
                for row in rows
                if row["status"] == "done" and not row["unconverged"] and not row["retakes"]
            }
            yield _minimum(f"{problem['id']}: {of}", costs, {row["settings"]["substeps"] for row in rows})


def _minimum(where: str, costs: dict[int, float], tried: set[int]) -> Case:
    if len(costs) < 2 or len(tried) < 3:
        return Case(where, f"{len(costs)} of {len(tried)} numbers of substeps reach it", None)
    best = min(costs, key=lambda count: costs[count])
    # Fewer substeps that do not reach the level at all cost more than any that do.
    inside = best != max(costs) and (best != min(costs) or min(costs) > min(tried))
    return Case(
        where, f"least at {best} of {', '.join(map(str, sorted(costs)))}: {costs[best]:.3g} s per frame", inside
    )


_RULES: dict[str, Callable[[Claim, Part, Numbers], Iterator[Case]]] = {
    "at-most": _at_most,
    "trend": _trend,
    "inner-minimum": _inner_minimum,
}


def axis_value(part: Part, problem: Numbers) -> float:
    """Where a problem stands on the part's axis."""
    value = problem["axes"].get(part.axis) if part.axis else None
    return float(value if value is not None else problem.get("vertices") or 0.0)


def _along(part: Part, problems: list[Numbers]) -> list[list[Numbers]]:
    """Problems that differ in the axis alone, from its least value to its largest."""
    groups: dict[tuple[Any, ...], list[Numbers]] = {}
    for problem in problems:
        rest = tuple(value for key, value in problem["axes"].items() if key != part.axis)
        groups.setdefault((problem.get("scene"), *rest), []).append(problem)
    return [sorted(group, key=lambda problem: axis_value(part, problem)) for group in groups.values()]


def _problems(claim: Claim, part: Part, numbers: Numbers) -> list[Numbers]:
    return [p for p in numbers["problems"] if not claim.at or axis_value(part, p) in claim.at]


def _levels(claim: Claim, part: Part) -> tuple[float | None, ...]:
    if claim.what not in COSTS:
        return (None,)
    return part.levels if claim.measure == "eps18" else part.targets


def _value(claim: Claim, numbers: Numbers, problem: str, curve: str, level: float | None) -> float | None:
    """Cost of a level, or the largest number of the curve's rows.

    A row that had to take more substeps than it was asked for says nothing of what it was asked for.
    """
    if level is not None:
        key = {"problem": problem, "curve": curve, "measure": claim.measure, "level": level}
        entries = (e for e in numbers["entries"] if all(e[name] == value for name, value in key.items()))
        return next((e[claim.what] for e in entries), None)
    rows = numbers.get("rows", numbers.get("traces", ()))
    mine = [row for row in rows if row["problem"] == problem and row["curve"] == curve and row["status"] == "done"]
    what = {"seconds per frame": "seconds"}.get(claim.what, claim.what)
    values = [row[what] for row in mine if row[what] is not None and not row.get("retakes")]
    return max(values, default=None)


def _both_were_run(numbers: Numbers, problem: str, curves: tuple[str, ...]) -> bool:
    rows = numbers.get("rows", numbers.get("traces", ()))
    mine = [row for row in rows if row["problem"] == problem and row["curve"] in curves]
    return {row["curve"] for row in mine if _has_ended(row)} == set(curves)


def _has_ended(row: Numbers) -> bool:
    """A motion that is lost has shown what the solver can do; one that was stopped has not."""
    return bool(row["status"] == "done" or row.get("failure_kind") == "solver")


def _where(problem: str, claim: Claim, level: float | None) -> str:
    if level is None:
        return problem
    return f"{problem}, {'eps18' if claim.measure == 'eps18' else 'error'} {level:g}"


def _shown(value: float | None) -> str:
    return "not reached" if value is None else f"{value:.3g}"
