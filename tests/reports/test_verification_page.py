# SPDX-License-Identifier: BSD-3-Clause
"""The HTML page of the verification report, as text and in a browser without a display.

1. Every row is there with its numbers, its notes and its reference; failures stand first, and the heading says so.
2. No text of a record becomes markup, and nothing of the page comes from elsewhere.
3. Tables have captions, and heads with a scope; ids are unique and links lead somewhere.
4. Text has a contrast of 4.5 or more with what it stands on, light and dark; curves have 3 or more.
5. In a browser: all rows are read from the document; the filter hides those that do not fit, by text, kind and status;
   nothing is wider than a phone; a picture is drawn in the size asked for, with the heading's colour in it.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from html import unescape
from html.parser import HTMLParser
from importlib.resources import files
from urllib.parse import unquote

import pytest

from reports.verification.markup import Markup, element
from reports.verification.page import page
from tests.reports.verification_samples import HURTS, all_rows, good_rows, row, sample

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
in_browser = pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine")


class Document(HTMLParser):
    """Start tags with their attributes, and the rows of the suite with the text of their cells."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.rows: dict[str, dict[str, str]] = {}
        self._row: dict[str, str] | None = None
        self._cell = ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.tags.append((tag, attributes))
        if tag == "tr":
            self._row = None
            if "data-status" in attributes:
                hidden = {"hidden": "yes"} if "hidden" in attributes else {}
                self._row = self.rows[attributes["id"]] = {"marked": attributes["data-status"], **hidden}
        elif tag in ("td", "th"):
            self._cell = attributes.get("data-label") or ("row" if tag == "th" else "status")

    def handle_data(self, data):
        if self._row is not None:
            self._row[self._cell] = self._row.get(self._cell, "") + data

    def attributes(self, name: str) -> list[str]:
        return [attributes[name] for _, attributes in self.tags if attributes.get(name)]


@pytest.fixture(scope="module")
def text():
    return page(sample(all_rows(), cuda="this version has no CUDA backend"))


def test_every_row_is_there(text):
    check_rows(Document(text), all_rows())


def check_rows(document, rows):
    assert sorted(document.rows) == sorted(one["id"] for one in rows)
    for one in rows:
        shown = document.rows[one["id"]]
        assert shown["marked"] == shown["status"] == one["status"]
        assert one["note"].replace("\x00", "") in shown["row"].replace("\x00", "").replace("\ufffd", "")
        assert ", ".join(one["values"].values()) in shown["row"]
        for name in ("error", "tolerance", "computed"):
            expected = "-" if one[name] is None else one[name] if isinstance(one[name], str) else f"{one[name]:.3g}"
            assert shown[name] == expected


def test_failures_stand_first(text):
    assert "<h1>3 of 8 judged rows FAIL</h1>" in text
    assert 'class="verdict failed"' in text
    first = text[text.index('id="failures"') : text.index("<h2>References")]
    for one in all_rows():
        assert (f">{one['id']}</a>" in first) == (one["status"] == "FAIL")
    good = page(sample(good_rows()))
    assert 'class="verdict passed"' in good
    assert 'id="failures"' not in good


def test_facts(text):
    for fact in ("femgal verify --full --report out", "numpy 2.2.1", "A processor @ 2.5 GHz, 2 processors", "all (2)"):
        assert fact in text
    for fact in ("float64, float32", "20260117", "2026-01-17 09:30:00 UTC", "this version has no CUDA backend"):
        assert fact in text
    assert "pyamg None" not in text


def test_texts_are_escaped(text):
    assert HURTS not in text
    assert [tag for tag, _ in Document(text).tags].count("script") == 1
    hurt = page(sample([row(f"a/b[{HURTS}]", "FAIL", **dict.fromkeys(("title", "kind", "unit", "reason"), HURTS))]))
    assert "<script>alert" not in hurt


def test_nothing_comes_from_elsewhere(text):
    document = Document(text)
    assert document.attributes("src") == []
    assert [link for link in document.attributes("href") if not link.startswith(("#", "data:text/csv"))] == []
    assert not re.search(r"url\(|@import", text)
    assert {tag for tag, _ in document.tags}.isdisjoint({"link", "iframe", "img", "object"})
    assert "default-src 'none'" in text.replace("&#x27;", "'")


def test_tables_and_links(text):
    document = Document(text)
    tags = [tag for tag, _ in document.tags]
    assert tags.count("table") == tags.count("caption") > 4
    assert all("scope" in attributes for tag, attributes in document.tags if tag == "th")
    ids = document.attributes("id")
    assert len(set(ids)) == len(ids)
    assert {unquote(link[1:]) for link in document.attributes("href") if link.startswith("#")} <= set(ids)
    assert tags.count("figure") == 3
    assert len(document.attributes("download")) == len(set(document.attributes("download"))) == 3


def test_elements():
    assert element("td", "a < b", None, Markup("<b>"), class_="x", data_a='"', hidden=True, open=False) == (
        '<td class="x" data-a="&quot;" hidden>a &lt; b<b></td>'
    )


def luminance(colour: str) -> float:
    parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(a: str, b: str) -> float:
    low, high = sorted((luminance(a), luminance(b)))
    return (high + 0.05) / (low + 0.05)


def test_contrast():
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)
    style = files("reports.verification").joinpath("page.css").read_text()
    themes = [
        dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", block)) for block in re.findall(r":root \{(.*?)\}", style, re.S)
    ]
    assert len(themes) == 2
    for theme in themes:
        for name in ("ink", "quiet", "link", "pass", "fail", "skip", "info"):
            assert contrast(theme[name], theme["paper"]) >= 4.5, name
        for name in ("ink", "quiet", "link"):
            assert contrast(theme[name], theme["fail-tint"]) >= 4.5, name
        assert contrast("#ffffff", theme["fail-solid"]) >= 4.5
        assert contrast(theme["ink"], theme["raised"]) >= 4.5
        assert all(contrast(theme[f"c{k}"], theme["paper"]) >= 3.0 for k in range(6))


def browse(tmp_path, text, *options, width=1400, height=1000):
    """Let the browser load a page; its standard output."""
    path = tmp_path / "page.html"
    path.write_text(text, encoding="utf-8")
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
    command += [f"--user-data-dir={tmp_path / 'profile'}", f"--window-size={width},{height}", *options, path.as_uri()]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout


def scripted(text: str, script: str) -> str:
    """The page with a script that runs after its own."""
    return text.replace("</body>", f"<script>{script}</script></body>")


@in_browser
def test_rows_in_the_browser(tmp_path, text):
    document = Document(browse(tmp_path, text, "--dump-dom"))
    check_rows(document, all_rows())
    assert all("hidden" not in shown for shown in document.rows.values())
    assert ("form", "filter") in {
        (tag, attributes.get("id")) for tag, attributes in document.tags if "hidden" not in attributes
    }


FILTERS = {
    "elements.text.value = 'float64 RABBIT'": {"material/dilation[float64,rabbit]"},
    "elements.text.value = 'says dilation'": {"material/dilation[float64,rabbit]"},
    "elements.kind.value = 'IDENTITY'": {"material/markup[float64]", "transfer/nan"},
    "querySelector('[value=PASS]').checked = form.querySelector('[value=FAIL]').checked = false": {
        "transfer/bunny[float64,bunny]",
        "study/substeps",
    },
    "elements.text.value = 'no such row'": set(),
    "reset()": {one["id"] for one in all_rows()},
}
TRIES = """
const form = document.getElementById("filter");
const all = (selector) => [...document.querySelectorAll(selector)];
const seen = (selector) => all(selector).filter((one) => one.checkVisibility()).map((one) => one.id);
document.title = JSON.stringify([CHANGES].map((change) => {
  form.reset();
  change();
  form.dispatchEvent(new Event("input"));
  return [seen("tr[data-status]"), seen(".topic"), form.querySelector("output").textContent];
}));
"""


@in_browser
def test_filter_in_the_browser(tmp_path, text):
    changes = ", ".join(f"() => {{ form.{change}; }}" for change in FILTERS)
    dom = browse(tmp_path, scripted(text, TRIES.replace("CHANGES", changes)), "--dump-dom")
    found = json.loads(unescape(re.search("<title>(.*?)</title>", dom).group(1)))
    for (change, expected), (rows, topics, count) in zip(FILTERS.items(), found, strict=True):
        assert set(rows) == expected, change
        assert set(topics) == {"topic-" + id.split("/")[0] for id in expected}
        assert count == f"{len(expected)} of 10 rows"


OPEN_AND_MEASURE = """
for (const one of document.querySelectorAll("details")) one.open = true;
parent.postMessage(document.documentElement.scrollWidth, "*");
"""
FRAME = """<!doctype html><title></title><iframe src="inside.html" width="{}" height="800" style="border: 0"></iframe>
<script>onmessage = (event) => document.title = event.data;</script>"""


@in_browser
@pytest.mark.parametrize("width", [360, 390, 1000])
def test_nothing_is_wider_than_the_window(tmp_path, text, width):
    # In a frame, since windows have a least width.
    (tmp_path / "inside.html").write_text(scripted(text, OPEN_AND_MEASURE), encoding="utf-8")
    dom = browse(tmp_path, FRAME.format(width), "--dump-dom", "--virtual-time-budget=5000")
    assert f"<title>{width}</title>" in dom


@in_browser
@pytest.mark.parametrize("width", [390, 1400])
def test_picture(tmp_path, text, width):
    pyplot = pytest.importorskip("matplotlib.pyplot")
    browse(tmp_path, text, f"--screenshot={tmp_path / 'page.png'}", width=width)
    picture = (255 * pyplot.imread(tmp_path / "page.png")[:, :, :3]).round().astype(int)
    assert picture.shape == (1000, width, 3)
    red = (picture == [0xB3, 0x16, 0x1B]).all(axis=2).mean()
    assert 0.02 < red < 0.5
    assert (picture == 255).all(axis=2).mean() > 0.2
