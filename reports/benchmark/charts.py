# SPDX-License-Identifier: BSD-3-Clause
"""The plots of a record, as titles, labels and curves; every plot has the same curves in the same order and colour."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

Record = Mapping[str, Any]
Entry = Mapping[str, Any]
Plot = dict[str, Any]

# Costs that errors are drawn against: key of a row, name of the file, and label of the axis.
COSTS = (("seconds", "error-seconds"), ("passes", "error-passes"))


@dataclass(frozen=True)
class Chart:
    """Plots of one kind.

    Parameters
    ----------
    name : Of its file.
    title : What the plots show.
    plots : As `reports.verification.plot` draws them, each with the id of what it belongs to.
    """

    name: str
    title: str
    plots: tuple[Plot, ...]


def charts(record: Record) -> list[Chart]:
    """All plots that the record has something to draw for."""
    found = [Chart(name, f"Error against {cost}", _errors(record, cost)) for cost, name in COSTS]
    if any(row["solver_error"] is not None for row in record["rows"]):
        found.append(
            Chart("solver-error-seconds", "Solver error against seconds", _errors(record, "seconds", "solver_error"))
        )
    found.append(Chart("cost-size", "Cost against size", tuple(_against_size(record))))
    found.append(Chart("cost-stiffness", "Cost against stiffness over density", tuple(_against_stiffness(record))))
    found.append(Chart("cost-slivers", "Cost against mesh quality", tuple(_against_slivers(record))))
    return [chart for chart in found if chart.plots]


def clock_label(record: Record) -> str:
    """Which time counts."""
    return "CPU seconds" if record["clock"] == "cpu" else "seconds"


def front(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Points that no other beats in both cost and error, the cheapest first."""
    found: list[tuple[float, float]] = []
    for point in sorted(points):
        if not found or point[1] < found[-1][1]:
            found.append(point)
    return found


def _errors(record: Record, cost: str, error: str = "error") -> tuple[Plot, ...]:
    return tuple(
        plot for problem in record["problems"] if (plot := _error_plot(record, problem, cost, error)) is not None
    )


def _error_plot(record: Record, problem: Entry, cost: str, error: str) -> Plot | None:
    rows = [row for row in record["rows"] if row["problem"] == problem["id"] and row[cost] and row[error]]
    if not rows:
        return None
    curves = [_curve(name, front([(r[cost], r[error]) for r in rows if r["curve"] == name])) for name in _names(record)]
    what = {"seconds": f"{clock_label(record)} per frame", "passes": "element passes per frame"}[cost]
    own = problem["reference"]["own_error"]
    if own and error == "error":
        costs = [row[cost] for row in rows]
        curves.append({"name": "the reference's own error", "x": [min(costs), max(costs)], "y": [own, own]})
    label = "trajectory error" if error == "error" else "solver error"
    return {"id": problem["id"], "title": problem["id"], "x": what, "y": label, "curves": curves}


def _against_size(record: Record) -> Iterator[Plot]:
    def size(problem: Entry) -> float:
        return float(problem["vertices"])

    yield from _cost_plots(record, _but(("vertices",)), size, "vertices")


def _against_stiffness(record: Record) -> Iterator[Plot]:
    yield from _cost_plots(record, _but(("E", "rho", "nu")), stiffness, "E / rho [m^2/s^2]")


def _against_slivers(record: Record) -> Iterator[Plot]:
    def angle(problem: Entry) -> float:
        return float(problem.get("dihedral") or 0.0)

    if all(map(angle, record["problems"])):
        yield from _cost_plots(record, _but(("slivers",)), angle, "smallest dihedral angle [degrees]")


def stiffness(problem: Entry) -> float:
    """Largest E / rho of a scene [m^2/s^2]."""
    return float(problem["E"][1] / problem["rho"][0])


def _but(axes: Sequence[str]) -> Callable[[Entry], tuple[Any, ...]]:
    """What scenes have in common that differ in these axes only."""

    def rest(problem: Entry) -> tuple[Any, ...]:
        return (problem["scene"], *((key, value) for key, value in problem["axes"].items() if key not in axes))

    return rest


def _cost_plots(
    record: Record, group: Callable[[Entry], tuple[Any, ...]], x: Callable[[Entry], float], label: str
) -> Iterator[Plot]:
    """For every group of scenes and every target: seconds of the whole motion to it."""
    groups: dict[tuple[Any, ...], list[Entry]] = {}
    for problem in record["problems"]:
        if problem["vertices"]:
            groups.setdefault(group(problem), []).append(problem)
    for key, problems in groups.items():
        if len({x(problem) for problem in problems}) < 2:
            continue
        for target in record["targets"]:
            curves = [_curve(name, _costs(record, problems, name, target, x)) for name in _names(record)]
            if not any(curve["x"] for curve in curves):
                continue
            what = " ".join([key[0], *(f"{axis}={value:g}" for axis, value in key[1:] if value is not None)])
            yield {
                "id": problems[0]["id"],
                "title": f"{what}: to an error of {target:g}",
                "x": label,
                "y": f"{clock_label(record)} for the whole motion",
                "curves": curves,
            }


def _costs(
    record: Record, problems: Sequence[Entry], curve: str, target: float, x: Callable[[Entry], float]
) -> list[tuple[float, float]]:
    seconds = {e["problem"]: e["seconds"] for e in record["summary"] if e["curve"] == curve and e["target"] == target}
    found = [(p, seconds.get(p["id"])) for p in problems]
    return sorted((x(p), s * p["horizon"]["frames"]) for p, s in found if s is not None)


def _names(record: Record) -> list[str]:
    return list(record["curves"])


def _curve(name: str, points: Sequence[tuple[float, float]]) -> dict[str, Any]:
    return {"name": name, "x": [x for x, _ in points], "y": [y for _, y in points]}
