# SPDX-License-Identifier: BSD-3-Clause
"""The record as one HTML page that needs no network and, but for its filter, no JavaScript."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib.resources import files
from typing import Any
from urllib.parse import quote

from reports.verification.facts import facts
from reports.verification.figure import figure
from reports.verification.groups import CaseRows, Row, Topic, failures, topics
from reports.verification.markup import Markup, element, join
from reports.verification.own import TONES, Section, sections
from reports.verification.table import reference_details, status_mark, topic_table
from reports.verification.words import (
    KINDS,
    STATUSES,
    count_of_kinds,
    counts,
    duration,
    judgement,
    numbers,
    plural,
    verdict,
)

# The page says itself that it loads nothing.
_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
)


def page(record: Mapping[str, Any]) -> str:
    """The whole page."""
    parts = topics(record["rows"])
    body = element(
        "body",
        _header(record),
        element(
            "main",
            _failures(failures(record["rows"])),
            *map(_own, sections(record)),
            _summary(record),
            _contents(parts),
            _filter(),
            *map(_topic, parts),
        ),
        element("script", _asset("page.js")),
    )
    return f"<!doctype html>\n{element('html', _head(record), body, lang='en')}\n"


def _asset(name: str) -> Markup:
    return Markup(files("reports.verification").joinpath(name).read_text(encoding="utf-8"))


def _head(record: Mapping[str, Any]) -> Markup:
    return element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=_POLICY),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", name="color-scheme", content="light dark"),
        element("title", f"{verdict(record)} - femgal verify"),
        element("style", _asset("page.css")),
    )


def _header(record: Mapping[str, Any]) -> Markup:
    summary, header = record["summary"], record["header"]
    status = summary["status"]
    tone = "failed" if status["FAIL"] else "passed" if status["PASS"] else "unjudged"
    times = f"{duration(summary['cpu_seconds'])} CPU, {duration(summary.get('wall_seconds'))} wall"
    return element(
        "header",
        element("p", "femgal ", str(header.get("femgal") or ""), " verification", class_="over-title"),
        element("h1", verdict(record)),
        element(
            "p", f"{counts(status)}. {plural(summary['rows'], 'row')} of {plural(summary['cases'], 'case')}; {times}."
        ),
        class_=f"verdict {tone}",
    )


def _own(section: Section) -> Markup:
    """A table about the user's own mesh or result."""
    heads = (element("th", head, scope="col") for head in section.heads)
    return element(
        "section",
        element("h2", section.title),
        element("p", section.text, class_="meaning"),
        element(
            "table",
            element("caption", section.title, class_="unseen"),
            element("thead", element("tr", *heads)),
            element("tbody", *(element("tr", *map(_cell, row)) for row in section.rows)),
            class_="kinds",
        ),
        class_="own",
    )


def _cell(text: str) -> Markup:
    return element("td", text, class_=f"status {TONES[text]}" if text in TONES else None)


def _failures(rows: list[Row]) -> Markup | None:
    """Failed rows, case by case."""
    if not rows:
        return None
    cases = (case for topic in topics(rows) for case in topic.cases)
    return element("section", element("h2", "Failures"), *map(_failed_case, cases), id="failures")


def _failed_case(case: CaseRows) -> Markup:
    return element(
        "article",
        element("h3", "Not true here: ", element("em", case.shared["title"])),
        *map(_failed_row, case.rows),
        reference_details(case.shared),
        class_="failure",
    )


def _failed_row(row: Row) -> Markup:
    link = element("a", row["id"], href="#" + quote(row["id"]))
    return element(
        "div",
        element("p", status_mark("FAIL"), " ", element("code", link), " ", element("strong", judgement(row))),
        element("p", numbers(row)),
        element("p", row["note"], class_="note") if row["note"] else None,
    )


def _summary(record: Mapping[str, Any]) -> Markup:
    not_run = record["summary"].get("not_run", {})
    missing = element(
        "ul", *(element("li", element("strong", what), f": {why}") for what, why in not_run.items()), class_="not-run"
    )
    left = element("div", element("h2", "References"), _kinds(record), _legend())
    right = element(
        "div",
        element("h2", "Run"),
        _pairs(facts(record)),
        join(element("h2", "Not run"), missing) if not_run else None,
    )
    return element("section", left, right, class_="summary")


def _kinds(record: Mapping[str, Any]) -> Markup:
    heads = [element("th", "kind", scope="col")]
    heads += [element("th", name, scope="col", class_="number") for name in (*STATUSES, "rows")]
    return element(
        "table",
        element("caption", "Rows by kind of reference and by status", class_="unseen"),
        element("thead", element("tr", *heads)),
        element("tbody", *(_kind(name, numbers) for name, numbers in count_of_kinds(record["rows"]))),
        class_="kinds",
    )


def _kind(name: str, numbers: Iterable[int]) -> Markup:
    meaning = element("span", KINDS.get(name, ""), class_="meaning")
    cells = (
        element("td", str(count) if count else "-", class_=f"number {status if count else 'zero'}")
        for status, count in zip((*STATUSES, "sum"), numbers, strict=True)
    )
    return element(
        "tr", element("th", name, " ", meaning, scope="row"), *cells, class_="all" if name == "all" else None
    )


def _legend() -> Markup:
    return element(
        "p",
        "A row passes when its error is at most its tolerance. INFO rows have no tolerance: they report what nobody ",
        "judges. The bar beside an error is full at the tolerance and empty eight decades below.",
        class_="meaning",
    )


def _pairs(pairs: Iterable[tuple[str, str]]) -> Markup:
    return element("dl", *(join(element("dt", name), element("dd", text)) for name, text in pairs), class_="facts")


def _contents(parts: list[Topic]) -> Markup:
    links = (
        element("li", element("a", part.name, href=f"#topic-{quote(part.name)}"), f" {_of(part)}") for part in parts
    )
    return element("nav", element("h2", "Topics"), element("ul", *links), aria_label="Topics")


def _of(part: Topic) -> str:
    return counts({name: sum(row["status"] == name for row in part.rows) for name in STATUSES})


def _filter() -> Markup:
    boxes = (
        element("label", element("input", type="checkbox", value=name, checked=True), status_mark(name))
        for name in STATUSES
    )
    kinds = (element("option", name, value=name) for name in KINDS)
    return element(
        "form",
        element("label", "Find ", element("input", type="search", name="text", placeholder="id, title, formula")),
        element("label", "Kind ", element("select", element("option", "all", value=""), *kinds, name="kind")),
        element("span", *boxes, class_="boxes", role="group", aria_label="Status"),
        element("output", ""),
        id="filter",
        hidden=True,
    )


def _topic(part: Topic) -> Markup:
    figures = [
        figure(plot, row, place) for row in part.rows for place, plot in enumerate(row.get("plots", ()), start=1)
    ]
    return element(
        "section",
        element("h2", part.name, " ", element("span", _of(part), class_="meaning")),
        topic_table(part),
        element("div", *figures, class_="figures") if figures else None,
        id=f"topic-{part.name}",
        class_="topic",
    )
