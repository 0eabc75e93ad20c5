# SPDX-License-Identifier: BSD-3-Clause
"""What the levels cost, and speedups beside those that the paper prints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from reports.verification.markup import Markup, element
from reports.verification.words import number

Numbers = Mapping[str, Any]

_TITLES = {
    ("motion", "eps18"): "Seconds per frame (iterations, substeps) until eps18 is below a level [m]",
    ("motion", "error"): "Seconds per frame (iterations, substeps) until the trajectory error is below a level",
    ("substep", "eps18"): "Seconds (iterations) until eps18 is below a share of the prediction's",
    ("substep", "error"): "Seconds (iterations) until the distance from the minimiser is below a share",
}


def cost_table(part: Numbers, measure: str) -> Markup | None:
    """Costs of every curve on every scene; where a level is not reached, the best that was."""
    entries = [entry for entry in part["entries"] if entry["measure"] == measure]
    if all(entry["best"] is None for entry in entries):
        return None
    levels = part["levels"] if measure == "eps18" else part["targets"]
    found = {(entry["problem"], entry["curve"], entry["level"]): entry for entry in entries}
    lines = []
    for problem in part["problems"]:
        lines.append(_scene_line(problem["id"], len(levels) + 1))
        for curve in part["curves"]:
            cells = (_cost(found.get((problem["id"], curve, level))) for level in levels)
            lines.append(element("tr", element("th", curve, scope="row"), *cells))
    title = _TITLES[part["kind"], measure]
    return _titled(title, ("solver", *(f"to {level:g}" for level in levels)), lines)


def _cost(entry: Numbers | None) -> Markup:
    if entry is None or entry["seconds"] is None:
        best = None if entry is None else entry["best"]
        return element("td", "-" if best is None else f"not reached: {number(best, 2)}", class_="number zero")
    counts = [f"{entry[key]:.0f}" for key in ("iterations", "substeps") if entry[key] is not None]
    mark = "\u2264 " if entry.get("at_most") else ""
    return element("td", f"{mark}{number(entry['seconds'])} ({', '.join(counts)})", class_="number")


def speedup_tables(part: Numbers) -> Iterator[Markup]:
    """Speedups over the baseline at each level of eps18 and of our error, the paper's beside."""
    if not part["speedups"]:
        return
    published = part["published"]
    for measure, what in (("eps18", "eps18"), ("error", "trajectory error")):
        mine = [entry for entry in part["speedups"] if entry["measure"] == measure]
        if not any(entry["speedup"] for entry in mine):
            continue
        levels = part["levels"] if measure == "eps18" else part["targets"]
        heads = ["solver", *(f"at {level:g}" for level in levels)]
        heads += [published["source"]] if published and measure == "eps18" else []
        lines = list(_speedup_lines(part, mine, levels, with_paper=len(heads) > len(levels) + 1))
        yield _titled(f"Times as fast as {part['baseline']}, at equal {what}", heads, lines)


def _speedup_lines(
    part: Numbers, entries: Sequence[Numbers], levels: Sequence[float], *, with_paper: bool
) -> Iterator[Markup]:
    found = {(entry["problem"], entry["curve"], entry["level"]): entry for entry in entries}
    for problem in part["problems"]:
        yield _scene_line(problem["id"], len(levels) + 1 + with_paper)
        for curve in part["curves"]:
            mine = [found.get((problem["id"], curve, level)) for level in levels]
            cells = [_speedup(None if entry is None else entry["speedup"]) for entry in mine]
            if with_paper:
                cells.append(_speedup(mine[0]["published"] if mine[0] else None, "paper"))
            yield element("tr", element("th", curve, scope="row"), *cells)


def _speedup(value: float | None, kind: str = "") -> Markup:
    return element("td", "-" if value is None else f"{value:.2f}", class_=f"number {kind}".strip())


def _scene_line(name: str, columns: int) -> Markup:
    return element("tr", element("th", name, scope="colgroup", colspan=columns), class_="scene")


def _titled(title: str, heads: Sequence[str], lines: Sequence[Markup]) -> Markup:
    cells = (element("th", head, scope="col", class_="number" if place else None) for place, head in enumerate(heads))
    table = element(
        "table",
        element("caption", title, class_="unseen"),
        element("thead", element("tr", *cells)),
        element("tbody", *lines),
        class_="kinds study",
    )
    return element("article", element("h3", title), element("div", table, class_="scroll"))
