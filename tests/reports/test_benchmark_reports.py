# SPDX-License-Identifier: BSD-3-Clause
"""Reports of `femgal bench SCENE...`.

1. The page is one file that loads nothing; every text of the record is escaped, every link leads somewhere, ids are
   unique.
2. Plots hold each solver's front, and the reference's own error where that is known; a flagged reference is named.
3. Cost against size and stiffness join scenes that differ in nothing else, in seconds of the whole motion.
4. The map names the soonest and how far the next one is behind; meshes with slivers have lines of their own.
5. The CSV has a line per row; tables have a cell for every head; failures and what was chosen are told.
6. Pictures are PNG files of the names that the report may hold.
7. More curves than colours are told apart by colour and mark together.
"""

from __future__ import annotations

import csv
import io
import re
from html.parser import HTMLParser

from reports.benchmark.charts import charts, front
from reports.benchmark.pictures import NAMES, draw_pictures
from reports.benchmark.render import render
from reports.benchmark.sheet import csv_text
from reports.benchmark.tables import notes, tables
from reports.benchmark.winners import winner_maps
from reports.verification.plot import COLOURS, shape
from tests.reports.benchmark_samples import record, row


class Page(HTMLParser):
    """Ids, links and the text of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.links: list[str] = []
        self.loads: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        self.ids += [found["id"]] if "id" in found else []
        self.links += [found["href"]] if tag == "a" else []
        self.loads += [found["src"]] if "src" in found else []
        assert tag not in ("script", "link", "iframe")


def test_page():
    text = render(record())["bench.html"]
    page = Page(text)
    assert len(page.ids) == len(set(page.ids))
    targets = [link[1:].replace("%20", " ").replace("%3D", "=") for link in page.links if link.startswith("#")]
    assert targets
    assert set(targets) <= set(page.ids)
    assert all(link.startswith(("#", "data:")) for link in page.links)
    assert page.loads == []
    assert "a &lt;fast&gt; one" in text
    assert "the &lt;energy&gt; is not finite" in text
    assert "<fast>" not in text
    assert "not reached: 0.05 at best" in text
    assert "more than a tenth of the smallest error shown" in text
    assert "CPU seconds per frame" in text


def test_a_record_that_has_just_begun():
    begun = record()
    begun["rows"] = [
        row(p["id"], name, None, None, status="not run", failure=None, failure_kind=None)
        for p in begun["problems"]
        for name in begun["curves"]
    ]
    begun["summary"] = [{**entry, "seconds": None, "passes": None, "why": "not run"} for entry in begun["summary"]]
    for problem in begun["problems"]:
        problem.update(horizon=None, vertices=None, tets=None, E=None, nu=None, rho=None)
        problem["reference"] = {"label": None, "failure": "has not been run", "own_error": None, "flagged": True}
    assert charts(begun) == []
    assert winner_maps(begun) == []
    assert "6 not run yet" in render(begun)["bench.html"]
    assert len(tables(begun)) == 4


def test_fronts():
    assert front([(2.0, 0.1), (1.0, 0.5), (3.0, 0.3)]) == [(1.0, 0.5), (2.0, 0.1)]
    seconds = charts(record())[0].plots
    assert [plot["title"] for plot in seconds] == [problem["id"] for problem in record()["problems"]]
    names = [[curve["name"] for curve in plot["curves"]] for plot in seconds]
    assert names[0] == ["verlet", "fas", "the reference's own error"]
    assert names[1] == ["verlet", "fas"]
    assert seconds[0]["curves"][1] == {"name": "fas", "x": [0.5, 1.0], "y": [0.2, 0.05]}


def test_costs_of_scenes_that_differ_in_one_axis():
    by_name = {chart.name: chart.plots for chart in charts(record())}
    size = by_name["cost-size"]
    assert [plot["title"] for plot in size] == [
        "drape E=10000: to an error of 0.1",
        "drape E=10000: to an error of 0.01",
    ]
    assert size[0]["curves"][0] == {"name": "verlet", "x": [102.0, 902.0], "y": [40.0, 120.0]}
    stiff = by_name["cost-stiffness"]
    assert stiff[0]["curves"][1] == {"name": "fas", "x": [10.0, 1000.0], "y": [14.0, 28.0]}
    assert "solver-error-seconds" not in by_name
    with_errors = record()
    with_errors["rows"][1]["solver_error"] = 0.1
    assert "solver-error-seconds" in {chart.name for chart in charts(with_errors)}


def test_winners():
    loose, tight = winner_maps(record())
    assert loose.heads[1].startswith("E/rho = 10 ")
    assert loose.rows[0] == ("100", "fas, 0.7 s/frame; verlet x 2.9", "fas, 1.4 s/frame; verlet x 2.9")
    assert loose.rows[1] == ("900", "fas, 2.1 s/frame; verlet x 2.9", "-")
    assert tight.rows[0][1] == "verlet, 2 s/frame"
    for found in (loose, tight):
        assert all(len(line) == len(found.heads) for line in found.rows)


def test_mesh_quality():
    bad = record()
    worst = bad["problems"][0]
    for number, (found, angle) in enumerate(zip(bad["problems"], (None, 10.0, 0.1), strict=True)):
        found["axes"] = {**worst["axes"], "slivers": angle}
        found |= {"vertices": 102, "E": worst["E"], "dihedral": (14.0, 10.0, 0.1)[number]}
    loose, _ = winner_maps(bad)
    assert [line[0] for line in loose.rows] == ["100", "100, slivers of 10 degrees", "100, slivers of 0.1 degrees"]
    assert loose.rows[2][1] == "fas, 2.1 s/frame; verlet x 2.9"
    plots = {chart.name: chart.plots for chart in charts(bad)}["cost-slivers"]
    assert plots[0]["curves"][0] == {"name": "verlet", "x": [0.1, 10.0, 14.0], "y": [120.0, 80.0, 40.0]}
    assert "the smallest angle 0.1 degrees" in render(bad)["bench.html"]
    assert "cost-slivers" not in {chart.name for chart in charts(record())}


def test_sheet_and_tables():
    lines = list(csv.DictReader(io.StringIO(csv_text(record()))))
    assert len(lines) == len(record()["rows"])
    assert (lines[0]["E"], lines[0]["vertices"], lines[0]["error"]) == ("10000.0", "102", "0.0001")
    assert lines[-1]["failure_kind"] == "solver"
    summary, *scenes = tables(record())
    assert ("drape 100 E=1e4", "fas", "0.7 *", "not reached: 0.05 at best") in summary.rows
    assert ("drape 100 E=1e4", "verlet", "<= 2", "<= 2 *") in summary.rows
    assert len(scenes) == 3
    for table in (summary, *scenes):
        assert all(len(line) == len(table.heads) for line in table.rows)
    told = notes(record())
    assert any("not finite" in line for line in told)
    assert any("MORE than a tenth" in line for line in told)


def test_what_was_chosen_is_told():
    choice = {"solver": "verlet", "reason": "60 substeps a frame; <newton> costs 80"}
    begun = record()
    id = begun["problems"][0]["id"]
    begun["rows"][0] |= {"label": "auto", "choice": choice, "passes": 71.0, "wasted_passes": 9.0}
    begun["rows"][1] |= {"label": "sure", "choice": choice, "passes": 62.0, "wasted_passes": 0.0}
    text = "auto chose verlet: 60 substeps a frame; <newton> costs 80. It took 71 passes a frame, 9 of them for a pilot"
    found = [line for line in notes(begun) if "chose" in line]
    assert found[0].startswith(f"{id}: {text}")
    assert len(found) == 2
    assert found[1].endswith("It took 62 passes a frame.")
    page = render(begun)["bench.html"]
    assert text.replace("<newton>", "&lt;newton&gt;") in page
    assert "auto (verlet)" in page


def test_pictures(tmp_path):
    written = draw_pictures(record(), tmp_path)
    assert {path.name for path in written} <= set(NAMES)
    assert len(written) == 4
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in written)


def test_marks_of_many_curves():
    looks = {(number % COLOURS, shape(number)) for number in range(20)}
    assert len(looks) == 20
    assert re.match("M", shape(0))
