# SPDX-License-Identifier: BSD-3-Clause
"""The page of a study.

1. It loads nothing, runs nothing, and escapes what it shows; ids are there once.
2. Every claim stands there with verdict, rule, source and comparisons, and the header counts them.
3. Speedups stand beside the paper's; a level that is not reached says what was.
4. Plots: along the axis where there is one, rows and iterates else; long traces are thinned, first and last stay.
5. What failed or has not been run is told.
"""

from __future__ import annotations

import json
import re

from reports.studies.charts import axis_plots, row_plots
from reports.studies.render import NAMES, render
from tests.reports.study_sample import motion_part, study_record, substep_part


def page() -> str:
    return render(study_record())["study.html"]


def test_files():
    files = render(study_record())
    assert tuple(files) == NAMES
    assert json.loads(files["study.json"]) == json.loads(json.dumps(study_record()))


def test_self_contained():
    html = page()
    assert "<script" not in html
    assert not re.search(r"(src|href)=\"(?!#|data:)", html)
    assert "A &amp; B" in html
    assert "femgal study small &lt;quick&gt;" in html
    ids = re.findall(r' id="([^"]+)"', html)
    assert len(ids) == len(set(ids))


def test_claims():
    html = page()
    assert "of 4 claims of the paper 1 hold, 1 hold in part, 1 do not hold, 1 cannot be judged here" in html
    for kind in ("holds", "partly", "fails", "unknown"):
        assert f'class="claim {kind}"' in html
    assert html.count("Compared: seconds: a at most b.") == 4
    assert html.count("not judged") == 4
    assert "quick version" in html


def test_tables():
    html = page()
    assert "Table 2 of the paper" in html
    assert '<td class="number paper">4.30</td>' in html
    assert '<td class="number">2.00</td>' in html
    assert "not reached: 0.005" in html
    assert "(40, 10)" in html


def test_plots():
    along = axis_plots(motion_part())
    assert [plot["y"] for plot in along[:3]] == ["seconds per frame", "substeps per frame", "iterations per frame"]
    assert along[0]["curves"][1] == {"name": "fas-constant", "x": [100.0, 1000.0], "y": [100.0, 1000.0]}
    assert along[3]["curves"][1]["x"] == [100.0]
    rows = row_plots(motion_part(), "cpu")
    # The larger scene has no reference: no plot of errors.
    assert [plot["title"] for plot in rows] == ["drape 100", "drape 100", "drape 1000"]
    by_iteration, by_second = row_plots(substep_part(), "cpu")
    curve = by_iteration["curves"][0]
    assert 20 < len(curve["x"]) <= 42
    assert (curve["x"][0], curve["x"][-1]) == (0.0, 199.0)
    assert by_second["curves"][0]["x"][-1] == 199.0
    assert row_plots(substep_part(), "wall")[1]["curves"][0]["x"][-1] == 398.0
    assert axis_plots(substep_part()) == []


def test_what_is_missing():
    html = page()
    assert "drape 1000: fas-constant substeps=4: ran away" in html
    assert "1 run of 3 not made yet" in html
    assert "drape 9: not run yet" in html
    assert "no reference: none asked" in html
