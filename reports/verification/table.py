# SPDX-License-Identifier: BSD-3-Clause
"""Rows of a topic as an HTML table: a head for each case, with its reference; below it a line for each row."""

from __future__ import annotations

import math
from urllib.parse import quote

from reports.verification.figure import figure_id
from reports.verification.groups import CaseRows, Row, Topic, axis_values
from reports.verification.markup import Markup, element, join
from reports.verification.words import number

# Columns of numbers, as heads of the table and as labels where it is too narrow for them.
COLUMNS = ("computed", "reference", "error", "tolerance", "CPU s")

# The bar beside an error is empty this many decades below the tolerance.
_BAR_DECADES = 8.0


def topic_table(topic: Topic) -> Markup:
    """The table of a topic."""
    heads = [element("th", "status", scope="col", class_="of-status"), element("th", "row", scope="col")]
    heads += [element("th", name, scope="col", class_=f"number of-{name}") for name in COLUMNS]
    return element(
        "table",
        element("caption", f"Rows of {topic.name}", class_="unseen"),
        element("thead", element("tr", *heads)),
        *map(_case, topic.cases),
        class_="rows",
    )


def reference_details(row: Row) -> Markup:
    """What a stranger needs to check the reference by hand."""
    tolerance = "none: the row is reported and judged by nobody" if row["tolerance"] is None else ""
    pairs = (
        ("quantity", f"{row['quantity']} [{row['unit']}]"),
        ("formula", row["formula"]),
        ("source", row["source"]),
        ("tolerance", " ".join(filter(None, (tolerance, row["reason"])))),
        ("requires", row["requires"]),
    )
    terms = (join(element("dt", name), element("dd", text)) for name, text in pairs if text)
    return element("details", element("summary", "reference and tolerance"), element("dl", *terms))


def status_mark(status: str) -> Markup:
    """A status in its colour."""
    return element("span", status, class_=f"status {status}")


def _case(case: CaseRows) -> Markup:
    shared = case.shared
    head = element(
        "th",
        element("span", shared["title"], class_="title"),
        " ",
        element("span", shared["kind"], class_="kind"),
        " ",
        element("code", case.id),
        reference_details(shared),
        scope="rowgroup",
        colspan=2 + len(COLUMNS),
    )
    return element("tbody", element("tr", head, class_="case"), *map(_row, case.rows), data_kind=shared["kind"])


def _row(row: Row) -> Markup:
    numbers = (
        number(row["computed"], 5),
        number(row["reference"], 5),
        join(number(row["error"]), _bar(row)),
        number(row["tolerance"]),
        f"{row['seconds']:.2f}",
    )
    cells = (element("td", text, class_="number", data_label=name) for name, text in zip(COLUMNS, numbers, strict=True))
    name = element("th", element("span", axis_values(row), class_="values"), _plot_link(row), _note(row), scope="row")
    return element(
        "tr", element("td", status_mark(row["status"])), name, *cells, id=row["id"], data_status=row["status"]
    )


def _plot_link(row: Row) -> Markup | None:
    return element("a", "plot", href="#" + quote(figure_id(row)), class_="to-plot") if row.get("plots") else None


def _note(row: Row) -> Markup | None:
    """The note; folded where nobody has to read it."""
    if not row["note"]:
        return None
    if row["status"] == "PASS":
        return element("details", element("summary", "note"), element("p", row["note"]), class_="note")
    return element("p", row["note"], class_="note")


def _bar(row: Row) -> Markup:
    """How near the error is to its tolerance, on a logarithmic scale; full at the tolerance."""
    error, tolerance = row["error"], row["tolerance"]
    if tolerance is None or tolerance <= 0.0 or error is None:
        return element("span", class_="bar none")
    share = 1.0 if isinstance(error, str) else _share(error / tolerance)
    inner = element("span", style=f"width:{100.0 * share:.0f}%")
    return element("span", inner, class_="bar over" if row["status"] == "FAIL" else "bar", aria_hidden="true")


def _share(ratio: float) -> float:
    return 0.0 if ratio <= 0.0 else min(1.0, max(0.0, 1.0 + math.log10(ratio) / _BAR_DECADES))
