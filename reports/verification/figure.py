# SPDX-License-Identifier: BSD-3-Clause
"""A plot with its legend, its numbers as a table, and the same as a CSV file that the page carries itself."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping
from typing import Any
from urllib.parse import quote

from reports.verification.groups import Row
from reports.verification.markup import Markup, element, join
from reports.verification.plot import drawable, mark, plot_svg
from reports.verification.words import number

Plot = Mapping[str, Any]


def figure(plot: Plot, row: Row, place: int = 1) -> Markup:
    """One figure.

    Parameters
    ----------
    row : Whose plot it is: its id, and where plots of several kinds belong to it, "file" for the name of this kind.
    place : Which of its plots, from 1.
    """
    origin = element("a", row["id"], href="#" + quote(row["id"]))
    words = " ".join(filter(None, (row.get("file"), row["id"])))
    name = re.sub(r"[^a-z0-9]+", "-", words.lower()).strip("-") + ("" if place == 1 else f"-{place}") + ".csv"
    link = element("a", "download CSV", href="data:text/csv;charset=utf-8," + quote(csv_text(plot)), download=name)
    return element(
        "figure",
        element("figcaption", element("strong", plot["title"]), " ", element("code", origin)),
        plot_svg(plot),
        _legend(plot),
        element("div", element("details", element("summary", "numbers"), _numbers(plot)), link, class_="data"),
        id=figure_id(row, place),
    )


def figure_id(row: Row, place: int = 1) -> str:
    """Where links to a row's figure lead."""
    return "-".join(filter(None, ("plot", str(place), row.get("file"), "of", row["id"])))


def csv_text(plot: Plot) -> str:
    """Columns: curve, and the axes' labels."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("curve", plot["x"], plot["y"]))
    for curve in plot["curves"]:
        writer.writerows((curve["name"], x, y) for x, y in zip(curve["x"], curve["y"], strict=True))
    return text.getvalue()


def _legend(plot: Plot) -> Markup:
    return element("ul", *(_entry(curve, k) for k, curve in enumerate(plot["curves"])), class_="legend")


def _entry(curve: Mapping[str, Any], place: int) -> Markup:
    missing = len(curve["x"]) - len(drawable(curve))
    remark = f" ({missing} of {len(curve['x'])} points not positive: in the numbers only)" if missing else ""
    return element("li", mark(place), curve["name"] + remark)


def _numbers(plot: Plot) -> Markup:
    heads = element("tr", *(element("th", text, scope="col") for text in ("curve", plot["x"], plot["y"])))
    lines = (
        element(
            "tr",
            element("th", curve["name"], scope="row"),
            *(element("td", number(value, 5), class_="number") for value in pair),
        )
        for curve in plot["curves"]
        for pair in zip(curve["x"], curve["y"], strict=True)
    )
    caption = element("caption", plot["title"], class_="unseen")
    return element(
        "div", element("table", caption, element("thead", heads), element("tbody", join(*lines))), class_="scroll"
    )
