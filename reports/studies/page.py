# SPDX-License-Identifier: BSD-3-Clause
"""The record of a study as one HTML page that needs no network and no JavaScript."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib.resources import files
from typing import Any

from reports.studies.charts import axis_plots, row_plots
from reports.studies.claims import claim_article, claims_in_short
from reports.studies.costs import cost_table, speedup_tables
from reports.verification.figure import figure
from reports.verification.markup import Markup, element, join
from reports.verification.words import number, plural

Numbers = Mapping[str, Any]

# The page says itself that it loads nothing.
_POLICY = "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
_STYLES = ("reports.verification", "reports.studies")
_VERSIONS = ("python", "numpy", "scipy", "numba")


def page(record: Numbers) -> str:
    """The whole page."""
    parts = (_part(part, record["clock"]) for part in record["parts"])
    body = element("body", _header(record), element("main", _claims(record), *parts, _run(record)))
    return f"<!doctype html>\n{element('html', _head(record), body, lang='en')}\n"


def _head(record: Numbers) -> Markup:
    styles = (files(room).joinpath("page.css").read_text(encoding="utf-8") for room in _STYLES)
    return element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=_POLICY),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", name="color-scheme", content="light dark"),
        element("title", f"{record['title']} - femgal study"),
        element("style", Markup("".join(styles))),
    )


def _header(record: Numbers) -> Markup:
    kind = "quick version: small sizes, short motions; " if record["quick"] else ""
    return element(
        "header",
        element("p", "femgal ", str(record["version"]), " study ", str(record["name"]), class_="over-title"),
        element("h1", str(record["title"])),
        element("p", str(record["question"])),
        element("p", kind + claims_in_short(record["claims"]) + ".", class_="meaning"),
        class_="verdict unjudged",
    )


def _claims(record: Numbers) -> Markup | None:
    """What the paper says, and what the figures here say of it."""
    if not record["claims"]:
        return None
    text = "Verdicts are computed from the figures below by the rule that stands beside each."
    return element(
        "section",
        element("h2", "What the paper says, and what is found here"),
        element("p", text, class_="meaning"),
        *map(claim_article, record["claims"]),
        id="claims",
    )


def _part(part: Numbers, clock: str) -> Markup:
    plots = [*axis_plots(part), *row_plots(part, clock)]
    drawn = (figure(plot, {"id": part["id"]}, place) for place, plot in enumerate(plots, start=1))
    return element(
        "section",
        element("h2", part["title"]),
        element("p", f"{part['source']}. {part['about']}", class_="meaning"),
        *speedup_tables(part),
        *(cost_table(part, measure) for measure in ("eps18", "error")),
        element("div", *drawn, class_="figures") if plots else None,
        *_remarks(part),
        id=part["id"],
    )


def _remarks(part: Numbers) -> Iterable[Markup]:
    """Sizes, references, and what failed."""
    yield element("h3", "Scenes")
    yield element("ul", *(element("li", _scene(problem)) for problem in part["problems"]), class_="not-run")
    rows = part.get("rows", part.get("traces", ()))
    failed = [row for row in rows if row["failure"]]
    missing = sum(row["status"] == "not run" for row in rows)
    if missing:
        yield element("p", f"{plural(missing, 'run')} of {len(rows)} not made yet.", class_="note")
    if failed:
        yield element("h3", "Failed runs")
        lines = (f"{row['problem']}: {row['label']}: {row['failure'].splitlines()[0]}" for row in failed)
        yield element("ul", *(element("li", line) for line in lines), class_="not-run")


def _scene(problem: Numbers) -> str:
    if not problem.get("vertices"):
        return f"{problem['id']}: not run yet"
    text = f"{problem['id']}: {problem['vertices']} vertices, {problem['tets']} tetrahedra"
    reference = problem.get("reference")
    if reference is None:
        return f"{text}; eps18 of the prediction {number(problem['prediction']['eps18'])} m"
    if reference["failure"]:
        return f"{text}; no reference: {reference['failure']}"
    return f"{text}; reference: {reference['label']}, its own error {number(reference['own_error'], 2)}"


def _run(record: Numbers) -> Markup:
    machine = record["machine"]
    pairs = [
        ("command", record["command"]),
        ("date", record["date"].replace("T", " ").replace("+00:00", " UTC")),
        ("versions", ", ".join(f"{name} {machine[name]}" for name in _VERSIONS if machine.get(name))),
        ("CPU", f"{machine.get('cpu')}, {machine.get('processors')} processors"),
        ("threads", ", ".join(dict.fromkeys(str(part["threads"]) for part in record["parts"]))),
        ("time", "CPU time of all threads" if record["clock"] == "cpu" else "wall time"),
    ]
    facts = (join(element("dt", name), element("dd", text)) for name, text in pairs)
    return element("section", element("h2", "Run"), element("dl", *facts, class_="facts"), id="run")
