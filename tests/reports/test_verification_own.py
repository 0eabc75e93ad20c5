# SPDX-License-Identifier: BSD-3-Clause
"""A user's own mesh or result in the report.

1. Findings are shown in HTML and Markdown, the worst first, with what to do; text is escaped.
2. Of a comparison the frames are shown, at most so many and always the last; what is no number is a word.
3. Without either there is no such section.
"""

from __future__ import annotations

from reports.verification.markdown import markdown
from reports.verification.own import MOST_FRAMES, sections
from reports.verification.page import page
from tests.reports.verification_samples import good_rows, sample

FINDINGS = [
    {"topic": "size", "severity": "ok", "what": "1 x 2 m", "advice": "", "numbers": {}},
    {"topic": "bending", "severity": "problem", "what": "a < b", "advice": "more | elements", "numbers": {}},
]
DIAGNOSIS = {
    "name": "body",
    "counts": {"ok": 1, "note": 0, "warning": 0, "problem": 1},
    "findings": FINDINGS,
}


def frame(number, error=0.1):
    return {
        "frame": number,
        "time_s": number / 60.0,
        "error": error,
        "largest_m": 0.01,
        "total_J": 2.0,
        "reference_total_J": "nan",
        "linear_momentum": [3.0, 4.0, 0.0],
        "reference_linear_momentum": ["nan", 0.0, 0.0],
    }


def comparison(frames):
    return {
        "result": "out",
        "matching": "vertices in the same order",
        "frames": frames,
        "frames_of_scene": frames - 1,
        "velocities": "from the result",
        "error": "inf",
        "reference": {"own_error": 1e-5},
        "rows": [frame(k) for k in range(frames)],
    }


def test_findings():
    (found,) = sections({"diagnosis": DIAGNOSIS})
    assert [row[1] for row in found.rows] == ["bending", "size"]
    record = sample(good_rows()) | {"diagnosis": DIAGNOSIS}
    shown = page(record)
    assert "Diagnosis of body" in shown
    assert "a &lt; b" in shown
    assert 'class="status FAIL">problem' in shown
    assert "more \\| elements" in markdown(record)


def test_frames():
    (found,) = sections({"comparison": comparison(4)})
    assert [row[0] for row in found.rows] == ["0", "1", "2", "3"]
    assert found.rows[0][-2:] == ("5", "nan")
    (long,) = sections({"comparison": comparison(1000)})
    assert len(long.rows) <= MOST_FRAMES + 1
    assert long.rows[-1][0] == "999"
    record = sample(good_rows()) | {"comparison": comparison(4)}
    assert "out, frame by frame" in page(record)
    assert "out, frame by frame" in markdown(record)


def test_neither():
    assert sections({}) == []
