# SPDX-License-Identifier: BSD-3-Clause
"""Claims with their verdicts, and every comparison that a verdict rests on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from reports.verification.markup import Markup, element

Numbers = Mapping[str, Any]


def claims_in_short(claims: Sequence[Numbers]) -> str:
    """How many of the claims hold."""
    if not claims:
        return "nothing is judged"
    kinds = [_kind(claim) for claim in claims]
    words = (
        ("holds", "hold"),
        ("partly", "hold in part"),
        ("fails", "do not hold"),
        ("unknown", "cannot be judged here"),
    )
    found = (f"{kinds.count(kind)} {text}" for kind, text in words if kind in kinds)
    return f"of {len(claims)} claims of the paper " + ", ".join(found)


def claim_article(claim: Numbers) -> Markup:
    """The claim, the verdict, the rule, and the comparisons folded away."""
    word = claim["verdict"]
    return element(
        "article",
        element("p", element("strong", claim["text"]), " ", element("span", claim["source"], class_="meaning")),
        element("p", "Here: ", element("span", word, class_="verdict-word"), f". Compared: {claim['rule']}."),
        element("details", element("summary", f"{len(claim['cases'])} comparisons"), _cases(claim["cases"])),
        class_=f"claim {_kind(claim)}",
    )


def _kind(claim: Numbers) -> str:
    if not claim["judged"]:
        return "unknown"
    if claim["good"] == claim["judged"]:
        return "holds"
    return "partly" if claim["good"] else "fails"


_MARKS = {True: "yes", False: "no", None: "not judged"}


def _cases(cases: Sequence[Numbers]) -> Markup:
    heads = (element("th", head, scope="col") for head in ("where", "found", "supports it"))
    lines = (
        element(
            "tr",
            element("th", case["where"], scope="row"),
            element("td", case["found"]),
            element("td", _MARKS[case["holds"]]),
        )
        for case in cases
    )
    table = element("table", element("thead", element("tr", *heads)), element("tbody", *lines), class_="kinds study")
    return element("div", table, class_="scroll")
