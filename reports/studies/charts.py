# SPDX-License-Identifier: BSD-3-Clause
"""The plots of a study, as titles, labels and curves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

Numbers = Mapping[str, Any]
Plot = dict[str, Any]
Points = list[tuple[float, float]]

_MOTION_LABELS = {
    "seconds": "seconds per frame",
    "passes": "element passes per frame",
    "iterations": "iterations per frame",
    "substeps": "substeps per frame",
    "eps18": "eps18 [m]",
    "error": "trajectory error",
}
_SUBSTEP_LABELS = {
    "seconds": "seconds",
    "passes": "element passes",
    "iteration": "iterations",
    "eps18": "eps18 [m]",
    "gap": "energy gap",
    "distance": "distance from the minimiser",
}
_AXES = {"vertices": "vertices", "E": "E [Pa]"}

# Costs of a level that are drawn along the axis.
_COSTS = ("seconds", "substeps", "iterations")


def row_plots(part: Numbers, clock: str) -> list[Plot]:
    """What the study asks for, scene by scene: points of a motion's rows, or the iterates of a substep."""
    found = []
    for problem in part["problems"]:
        for pair in part["plots"]:
            x, y = pair.split()
            curves = [_curve(name, _points(part, problem, name, x, y, clock)) for name in part["curves"]]
            if any(curve["x"] for curve in curves):
                found.append(_plot(part, problem["id"], _label(part, x), _label(part, y), curves))
    return found


def axis_plots(part: Numbers) -> list[Plot]:
    """Cost of each level of eps18 along the axis, one plot for each group of scenes that differ in nothing else."""
    if not part["axis"]:
        return []
    return [plot for group in _groups(part) for level in part["levels"] for plot in _costs(part, group, level)]


def _costs(part: Numbers, group: Sequence[Numbers], level: float) -> Iterator[Plot]:
    for cost in _COSTS:
        curves = [_curve(name, _cost_points(part, group, name, level, cost)) for name in part["curves"]]
        if max(len(curve["x"]) for curve in curves) > 1:
            title = f"to eps18 {level:g}{_rest(part, group[0])}"
            yield _plot(part, title, _AXES[part["axis"]], _label(part, cost), curves)


def _plot(part: Numbers, title: str, x: str, y: str, curves: list[Plot]) -> Plot:
    return {"id": part["id"], "title": title, "x": x, "y": y, "curves": curves}


def _label(part: Numbers, quantity: str) -> str:
    return (_MOTION_LABELS if part["kind"] == "motion" else _SUBSTEP_LABELS)[quantity]


def _points(part: Numbers, problem: Numbers, curve: str, x: str, y: str, clock: str) -> Points:
    if part["kind"] == "motion":
        rows = [row for row in part["rows"] if row["status"] == "done"]
    else:
        names = {"seconds": "cpu_seconds"} if clock == "cpu" else {}
        x = names.get(x, x)
        rows = part["traces"]
    mine = [row for row in rows if row["problem"] == problem["id"] and row["curve"] == curve]
    points = mine if part["kind"] == "motion" else [row for trace in mine for row in _thinned(trace["iterates"])]
    pairs = ((_scalar(row[x]), _scalar(row[y])) for row in points)
    return sorted((a, b) for a, b in pairs if a is not None and b is not None)


# Points of a curve that the eye can tell apart.
_MOST_POINTS = 40


def _thinned(iterates: Sequence[Numbers]) -> list[Numbers]:
    """Iterates at numbers that grow by a constant factor, the first and the last among them."""
    last = len(iterates) - 1
    wanted = {round(last ** (k / _MOST_POINTS)) for k in range(_MOST_POINTS + 1)} if last > 0 else set()
    return [row for number, row in enumerate(iterates) if number in wanted or number in (0, last)]


def _scalar(value: Any) -> float | None:
    """Of a span its end."""
    last = value[-1] if isinstance(value, list | tuple) else value
    return None if last is None else float(last)


def _cost_points(part: Numbers, group: Sequence[Numbers], curve: str, level: float, cost: str) -> Points:
    costs = {
        entry["problem"]: entry[cost]
        for entry in part["entries"]
        if entry["curve"] == curve and entry["measure"] == "eps18" and entry["level"] == level
    }
    pairs = ((axis_value(part, problem), costs.get(problem["id"])) for problem in group)
    return sorted((x, float(y)) for x, y in pairs if y is not None)


def axis_value(part: Numbers, problem: Numbers) -> float:
    """Where a problem stands on the axis."""
    value = problem["axes"].get(part["axis"])
    return float(value if value is not None else problem.get("vertices") or 0.0)


def _groups(part: Numbers) -> list[list[Numbers]]:
    groups: dict[str, list[Numbers]] = {}
    for problem in part["problems"]:
        groups.setdefault(_rest(part, problem), []).append(problem)
    return list(groups.values())


def _rest(part: Numbers, problem: Numbers) -> str:
    """Everything that a scene's name says beside the axis."""
    others = (f"{key}={value:g}" for key, value in problem["axes"].items() if value and key != part["axis"])
    return ", ".join(["", *others])


def _curve(name: str, points: Points) -> Plot:
    return {"name": name, "x": [x for x, _ in points], "y": [y for _, y in points]}
