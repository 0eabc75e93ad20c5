# SPDX-License-Identifier: BSD-3-Clause
"""`femgal bench kernels`.

1. It prints the tables and writes --json only; what it writes reads back as the same report and the same tables.
2. --json - prints one JSON object and nothing else on standard output.
3. Bad options are refused with exit code 2 and what is allowed, before anything is measured or written.
4. Loading the command loads no heavy package.
"""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
from click.testing import CliRunner, Result

from femgal.cli import main

TINY = ("--cells", 3, "--stream-mb", 0.1, "--threads", 1, "--precision", "plain")


def run(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["bench", "kernels", *map(str, arguments)], catch_exceptions=False)


def test_tables_and_file(tmp_path):
    from verify.benchmark.kernel_report import KernelReport
    from verify.benchmark.kernel_tables import tables

    out = tmp_path / "kernels.json"
    result = run(*TINY, "--json", out)
    assert result.exit_code == 0
    assert list(tmp_path.iterdir()) == [out]
    report = KernelReport.from_dict(json.loads(out.read_text()))
    assert report.settings == {"threads": [1], "variants": ["plain"], "repeats": 7, "stream_mb": 0.1}
    printed = [tuple(line.split()) for line in result.stdout.splitlines()]
    for table in tables(report):
        assert table.title in result.stdout
        for row in (table.heads, *table.rows):
            assert tuple(" ".join(row).split()) in printed
    for text in ("machine:", "mesh: box", "Python", "load before", "B/tet: bytes", "doubtful bound", f"wrote {out}"):
        assert text in result.stdout
    assert "round 7 of 7" in result.stderr


def test_json_alone():
    result = run(*TINY, "--json", "-")
    content = json.loads(result.stdout)
    assert content["schema"].startswith("femgal-bench-kernels")
    assert content["mesh"]["tets"] == 6 * 3**3
    assert {len(row["timing"]["wall"]) for row in content["passes"]} == {7}


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("--threads", "0"), "1 to"),
        (("--threads", "one"), "whole numbers"),
        (("--threads", ""), "whole numbers"),
        (("--precision", "float16"), "float32, float64, plain"),
        (("--repeats", 6), "7 or more"),
        (("--repeats", "many"), "--repeats"),
        (("--stream-mb", -1), "--stream-mb"),
        (("--stream-mb", 1e8), "would not fit"),
        (("--cells", 1000), "would not fit"),
        (("--cells", 0), "--cells"),
        (("--mesh", "unicorn"), "unicorn"),
        (("--mesh", "beam", "--cells", 5), "--vertices"),
        (("--vertices", 500), "--mesh"),
        (("--json", "missing/folder.json"), "does not exist"),
    ],
)
def test_refusals(arguments, expected, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run(*arguments)
    assert result.exit_code == 2
    assert expected in result.stderr
    assert "measuring" not in result.stderr
    assert result.stdout == ""
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_overwritten(tmp_path):
    out = tmp_path / "kernels.json"
    out.write_text("mine")
    result = run(*TINY, "--json", out)
    assert result.exit_code == 2
    assert "--force" in result.stderr
    assert out.read_text() == "mine"
    assert run(*TINY, "--json", out, "--force").exit_code == 0
    assert json.loads(out.read_text())["mesh"]["name"] == "box"


def test_loading_is_light():
    code = (
        "import sys, femgal.commands.bench as b\n"
        "from click.testing import CliRunner\n"
        "assert CliRunner().invoke(b.command, ['kernels', '--help']).exit_code == 0\n"
        "print(sorted({'numpy', 'numba', 'scipy', 'rich', 'verify'} & set(sys.modules)))"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert loaded.strip() == "[]"
