# SPDX-License-Identifier: BSD-3-Clause
"""The record as one HTML page that needs no network and no JavaScript."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from typing import Any
from urllib.parse import quote

from reports.benchmark.charts import Chart, Record, charts, clock_label
from reports.benchmark.rows import HEADS, cells, choice_text
from reports.benchmark.tables import Table
from reports.benchmark.winners import winner_maps
from reports.verification.figure import figure
from reports.verification.markup import Markup, element, join
from reports.verification.words import number, plural

# The page says itself that it loads nothing.
_POLICY = "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"

_VERSIONS = ("python", "numpy", "scipy", "numba")


def page(record: Record) -> str:
    """The whole page."""
    drawn = charts(record)
    body = element(
        "body",
        _header(record),
        element(
            "main",
            _section("times", "Time to an error", _meaning(record), _times(record)),
            _section("winners", "Who is soonest where", *map(_winners, winner_maps(record))),
            *(_figures(chart) for chart in drawn),
            _section("rows", "All rows", *(_problem(record, problem) for problem in record["problems"])),
            _section("run", "Run", _facts(record)),
        ),
    )
    return f"<!doctype html>\n{element('html', _head(record), body, lang='en')}\n"


def _head(record: Record) -> Markup:
    style = Markup("".join(files(room).joinpath("page.css").read_text(encoding="utf-8") for room in _STYLES))
    return element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=_POLICY),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", name="color-scheme", content="light dark"),
        element("title", f"{_scenes(record)} - femgal bench"),
        element("style", style),
    )


_STYLES = ("reports.verification", "reports.benchmark")


def _header(record: Record) -> Markup:
    rows = record["rows"]
    done = sum(row["status"] == "done" for row in rows)
    failed = sum(row["status"] == "failed" for row in rows)
    missing = len(rows) - done - failed
    text = f"{plural(done, 'row')} done, {failed} failed" + (f", {missing} not run yet" if missing else "")
    return element(
        "header",
        element("p", "femgal ", str(record["version"]), " bench", class_="over-title"),
        element("h1", "Error against time: ", _scenes(record)),
        element("p", f"{text}; {plural(len(record['curves']), 'solver')}, {plural(len(record['problems']), 'scene')}."),
        class_="verdict unjudged",
    )


def _scenes(record: Record) -> str:
    return ", ".join(dict.fromkeys(problem["scene"] for problem in record["problems"]))


def _section(id: str, title: str, *content: Markup | None) -> Markup:
    return element("section", element("h2", title), *content, id=id)


def _meaning(record: Record) -> Markup:
    label = clock_label(record)
    return element(
        "p",
        f"{label[0].upper()}{label[1:]} per frame on {plural(record['threads'], 'thread')}, without compilation, "
        "interpolated on each solver's own front of error against time; the soonest is bold. The error is the distance "
        "from a converged reference, as a share of the reference's own motion (of chaotic scenes, of the shape at the "
        "end). \u2264: the cheapest setting that was tried has a smaller error already.",
        class_="meaning",
    )


def _times(record: Record) -> Markup:
    targets = record["targets"]
    entries = {(e["problem"], e["curve"], e["target"]): e for e in record["summary"]}
    lines = []
    for problem in record["problems"]:
        best = {target: _least(record, problem["id"], target) for target in targets}
        link = element("a", problem["id"], href="#" + quote(problem["id"]))
        for curve in record["curves"]:
            found = (entries[problem["id"], curve, target] for target in targets)
            cells = (_time(entry, best[entry["target"]]) for entry in found)
            lines.append(element("tr", element("th", link, scope="row"), element("td", curve), *cells))
    heads = ("scene", "solver", *(f"to {target:g}" for target in targets))
    return _table("Time to an error", heads, lines, numbers_from=2)


def _least(record: Record, problem: str, target: float) -> float | None:
    found = (
        entry["seconds"]
        for entry in record["summary"]
        if entry["problem"] == problem and entry["target"] == target and entry["seconds"] is not None
    )
    return min(found, default=None)


def _time(entry: Mapping[str, Any], best: float | None) -> Markup:
    if entry["seconds"] is None:
        return element("td", str(entry["why"]), class_="number zero")
    text = ("\u2264 " if entry["at_most"] else "") + number(entry["seconds"])
    shown = element("strong", text) if entry["seconds"] == best else text
    return element("td", shown, class_="number", title=entry["row"])


def _winners(found: Table) -> Markup:
    lines = (
        element("tr", element("th", row[0], scope="row"), *(element("td", cell) for cell in row[1:]))
        for row in found.rows
    )
    title = element("h3", found.title)
    return join(title, _table(found.title, found.heads, list(lines), numbers_from=None))


def _figures(chart: Chart) -> Markup:
    drawn = (
        figure(plot, {"id": plot["id"], "file": chart.name}, place) for place, plot in enumerate(chart.plots, start=1)
    )
    return _section(chart.name, chart.title, element("div", *drawn, class_="figures"))


def _problem(record: Record, problem: Mapping[str, Any]) -> Markup:
    rows = [row for row in record["rows"] if row["problem"] == problem["id"]]
    lines = [_row(row) for row in rows]
    choices = [element("p", text, class_="meaning") for row in rows if (text := choice_text(row)) is not None]
    table = element("div", _table(problem["id"], HEADS, lines, numbers_from=1), class_="scroll")
    return element("article", element("h3", problem["id"]), *_about(problem), table, *choices, id=problem["id"])


def _row(row: Mapping[str, Any]) -> Markup:
    texts = cells(row)
    name = element("th", texts[0], scope="row", class_="values")
    note = element("p", row["failure"], class_="note") if row["failure"] else None
    if note is not None:
        return element(
            "tr", name, element("td", texts[1]), element("td", note, colspan=len(HEADS) - 2), class_="failed"
        )
    return element("tr", name, *(element("td", text, class_="number") for text in texts[1:]))


def _about(problem: Mapping[str, Any]) -> Iterable[Markup]:
    horizon, reference = problem["horizon"], problem["reference"]
    if horizon is None:
        yield element("p", "not run yet", class_="meaning")
        return
    length = f"{plural(horizon['frames'], 'frame')} of {1e3 / horizon['frames_per_second']:.4g} ms"
    length += f", {horizon['periods']:.2g} periods of the lowest mode that is excited" if horizon["periods"] else ""
    size = f"{problem['vertices']} vertices, {problem['tets']} tetrahedra"
    size += f", the smallest angle {problem['dihedral']:.3g} degrees" if problem.get("dihedral") else ""
    yield element("p", f"{size}; {length}.", class_="meaning")
    if reference["failure"]:
        yield element("p", f"No reference: {reference['failure']}", class_="warning")
        return
    own = "unknown" if reference["own_error"] is None else number(reference["own_error"], 2)
    text = f"Reference: {reference['label']}; its own error is {own}"
    if reference["flagged"]:
        yield element("p", text + ", more than a tenth of the smallest error shown.", class_="warning")
    else:
        yield element("p", text + ".", class_="meaning")


def _facts(record: Record) -> Markup:
    machine = record["machine"]
    pairs = [
        ("command", record["command"]),
        ("date", record["date"].replace("T", " ").replace("+00:00", " UTC")),
        ("versions", ", ".join(f"{name} {machine[name]}" for name in _VERSIONS if machine.get(name))),
        ("CPU", f"{machine.get('cpu')}, {machine.get('processors')} processors"),
        ("threads", str(record["threads"])),
        ("time", clock_label(record)),
    ]
    return element("dl", *(join(element("dt", name), element("dd", text)) for name, text in pairs), class_="facts")


def _table(caption: str, heads: Sequence[str], lines: Sequence[Markup], *, numbers_from: int | None) -> Markup:
    first = len(heads) if numbers_from is None else numbers_from
    cells = (
        element("th", head, scope="col", class_="number" if place >= first else None)
        for place, head in enumerate(heads)
    )
    return element(
        "table",
        element("caption", caption, class_="unseen"),
        element("thead", element("tr", *cells)),
        element("tbody", *lines),
        class_="kinds bench",
    )
