# SPDX-License-Identifier: BSD-3-Clause
"""`femgal study`.

1. Without a name it lists the studies.
2. Bad requests are refused with exit code 2 and what is allowed, before anything runs.
3. Loading the command loads no heavy package.
4. Every study runs in its quick version on a tiny mesh, and writes its page (slow).
"""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
from click.testing import CliRunner, Result

from femgal.cli import main
from verify.studies.definition import NAMES


def run(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["study", *map(str, arguments)], catch_exceptions=False)


def test_list():
    result = run()
    assert result.exit_code == 0
    assert [line.split()[0] for line in result.output.splitlines()] == list(NAMES)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("smoother",), "did you mean smoothers?"),
        (("sizes", "--sizes", "small"), "numbers separated by commas"),
        (("sizes", "--sizes", "3"), "vertices"),
        (("sizes", "--rho", "-1"), "rho"),
        (("sizes", "--levels", "0"), "positive numbers"),
        (("sizes", "--scene", "no-such-scene"), "no such scene"),
        (("sizes", "--json", "missing/folder.json"), "does not exist"),
    ],
)
def test_bad_requests(arguments, expected, tmp_path):
    result = run(*arguments, "--work", tmp_path / "runs", "--references", tmp_path / "references")
    assert result.exit_code == 2
    assert expected in result.output
    assert not list(tmp_path.glob("runs/*.json"))


def test_loads_nothing_heavy():
    code = "import sys, femgal.commands.study; print({'numpy', 'numba'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "set()"


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_quick_studies(name, tmp_path):
    folders = ["--work", tmp_path / "runs", "--references", tmp_path / "references", "--report", tmp_path / "out"]
    tiny = ["--quick", "--scene", "rabbit-drape", "--sizes", "300", "--frames", "1", "--time-limit", "20"]
    result = run(name, *tiny, *folders)
    assert result.exit_code == 0
    record = json.loads((tmp_path / "out" / "study.json").read_text())
    assert record["name"] == name
    for part in record["parts"]:
        rows = part.get("rows", part.get("traces"))
        assert {row["status"] for row in rows} <= {"done", "failed"}
        assert sum(row["status"] == "done" for row in rows) > 0.7 * len(rows)
    assert all(claim["cases"] for claim in record["claims"])
    assert "<script" not in (tmp_path / "out" / "study.html").read_text()
