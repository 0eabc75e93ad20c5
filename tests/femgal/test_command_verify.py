# SPDX-License-Identifier: BSD-3-Clause
"""`femgal verify`.

1. Rows that pass: a line for each with its number of how many, a summary, exit code 0; --quick is the default.
2. Exit code 1 when a row fails, with its numbers and note, and the row once more at the end; 2 when nothing was judged.
3. --list runs nothing and loads no scikit-fem.
4. Bad input is exit code 2 with what is allowed, before anything runs or is written: a pattern that fits nothing, a
   device that is not there, a missing package, a file or folder that would be overwritten.
5. --json - prints the record alone; --json FILE and --report write what they say, and nothing else.
6. Ctrl-C: what ran is summed up and written, exit code 130.
7. On a terminal lines are coloured and the row that runs is shown.
8. The command in the record is what was typed, without folders.
"""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
import time

import pytest
from click.testing import CliRunner

import verify.suite.case
from femgal.cli import main
from verify.suite.case import Kind, Measurement, Skip

FAST = "material/uniform-energy*float64,confined*"
FASTEST = "material/von-mises*shear* material/von-mises*dilation*"


def run(*arguments):
    return CliRunner().invoke(main, ["verify", *map(str, arguments)], catch_exceptions=False)


@pytest.fixture
def made_up(monkeypatch):
    """Adds a case called made-up/<name> to the suite, for the test only."""

    def add(name, function, tolerance=1e-6, **more):
        monkeypatch.setattr(verify.suite.case, "_CASES", dict(verify.suite.case._CASES))
        what = {"quantity": "length", "unit": "m", "kind": Kind.IDENTITY, "formula": "1 = 1", "source": "logic"}
        verify.suite.case.case(
            f"made-up/{name}", title="One is one", tolerance=tolerance, reason="none", **what, **more
        )(function)

    return add


def fails(use):
    return Measurement(2.0, 1.0, 1.0, "two is not one")


def skips(use):
    raise Skip("not on this machine")


def test_rows_that_pass():
    result = run("-k", f"{FAST} {FASTEST}")
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert lines[0].startswith("1/3  PASS  material/uniform-energy[float64,confined]")
    assert lines[0].endswith("<= 2.22e-16")
    assert [line.split()[0] for line in lines[:3]] == ["1/3", "2/3", "3/3"]
    assert "All 3 judged rows pass: 3 PASS of 2 cases" in lines
    assert any(line.startswith("references: 3 CLOSED-FORM") for line in lines)
    assert any(line.startswith("time: ") and " CPU, " in line for line in lines)


def test_quick_is_the_default(made_up):
    made_up("slow", lambda use: Measurement(1.0, 1.0, 0.0), quick=False)
    made_up("fast", lambda use: Measurement(1.0, 1.0, 0.0))
    quick, full = run("-k", "made-up"), run("-k", "made-up", "--full")
    assert "1/1  PASS  made-up/fast  0 <= 1e-06" in quick.stdout
    assert "not run: 1 row (they take longer; --full runs them)" in quick.stdout
    assert "2/2  PASS" in full.stdout
    assert "they take longer" not in full.stdout
    assert run("-k", "made-up", "--quick").stdout.splitlines()[0] == quick.stdout.splitlines()[0]


def test_a_failure_is_exit_code_1(made_up):
    made_up("wrong", fails)
    result = run("-k", f"made-up {FASTEST}")
    assert result.exit_code == 1
    lines = result.stdout.splitlines()
    at = next(i for i, line in enumerate(lines) if "FAIL  made-up/wrong  1 > 1e-06" in line)
    assert lines[at + 1].strip() == "length [m]: computed 2, reference 1"
    assert lines[at + 2].strip() == "two is not one"
    assert "FAIL  made-up/wrong  1 > 1e-06" in lines[at + 3 :]
    assert "1 of 3 judged rows FAIL: 2 PASS, 1 FAIL of 2 cases" in lines


def test_an_exception_is_a_failure(made_up):
    def breaks(use):
        raise RuntimeError("first line\nsecond line")

    made_up("broken", breaks)
    result = run("-k", "made-up")
    assert result.exit_code == 1
    assert "FAIL  made-up/broken  no result\n        RuntimeError: first line\n        second line" in result.stdout


def test_nothing_judged_is_exit_code_2(made_up):
    made_up("elsewhere", skips)
    result = run("-k", "made-up")
    assert result.exit_code == 2
    assert "SKIP  made-up/elsewhere  no result\n        not on this machine" in result.stdout
    assert "No row was judged" in result.stdout


def test_reports_without_a_verdict_are_exit_code_0(made_up):
    made_up("locking", fails, tolerance=None)
    result = run("-k", "made-up")
    assert result.exit_code == 0
    assert "INFO  made-up/locking  1, not judged\n        two is not one" in result.stdout


def test_list_runs_nothing(made_up):
    made_up("wrong", fails)
    made_up("slow", fails, quick=False)
    result = run("--list")
    assert result.exit_code == 0
    assert "FAIL" not in result.stdout
    assert "material/von-mises" in result.stdout
    lines = run("--list", "-k", "made-up").stdout.splitlines()
    assert lines[:3] == ["made-up/wrong  IDENTITY      1e-06", "    One is one", "    1 row"]
    assert lines[-1] == "2 rows of 2 cases, 1 of them quick"
    assert run("--list", "-k", "made-up", "--quick").stdout.splitlines() == [
        *lines[:3],
        "1 row of 1 case, 1 of them quick",
    ]


def test_list_is_light():
    script = (
        "import sys; from femgal.cli import main; main(['verify', '--list'], standalone_mode=False); "
        "sys.exit(sorted({'skfem', 'pyamg', 'matplotlib', 'meshio'} & set(sys.modules)) or 0)"
    )
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120)
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("-k", "no-such-case"), ("-k", "no-such-case", "material", "--list")),
        (("--device", "quantum"), ("quantum", "cpu")),
    ],
)
def test_bad_options(tmp_path, arguments, expected):
    result = run(*arguments, "--report", tmp_path / "out")
    assert result.exit_code == 2
    for text in expected:
        assert text in result.output
    assert not (tmp_path / "out").exists()


def test_a_device_that_is_not_there(monkeypatch, tmp_path):
    monkeypatch.setattr("verify.suite.use.unavailable", lambda name: "no driver" if name == "cuda" else None)
    result = run("--device", "cuda", "--report", tmp_path / "out")
    assert result.exit_code == 2
    assert "cuda: no driver" in result.stderr
    assert "allowed: cpu" in result.stderr
    assert "not run: cuda (no driver)" in run("-k", FASTEST).stdout


def test_missing_package(monkeypatch, tmp_path):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == "skfem" else "there")
    result = run("-k", FASTEST)
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 3
    assert "scikit-fem" in result.stderr
    assert "pyamg" not in result.stderr
    assert 'pip install "femgal[verify]"' in result.stderr


def test_files_are_not_overwritten(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    (tmp_path / "record.json").write_text("mine")
    for option, where in (
        ("--report", tmp_path),
        ("--json", tmp_path / "record.json"),
        ("--report", tmp_path / "mine.txt"),
    ):
        result = run("-k", FASTEST, option, where)
        assert result.exit_code == 2, result.output
        assert "PASS" not in result.output
    assert run("-k", FASTEST, "--report", tmp_path, "--json", tmp_path / "record.json", "--force").exit_code == 0
    assert (tmp_path / "mine.txt").read_text() == "mine"
    assert json.loads((tmp_path / "record.json").read_text())["summary"]["rows"] == 2


def test_json_alone(made_up):
    made_up("wrong", fails)
    result = run("-k", "made-up", "--json", "-")
    assert result.exit_code == 1
    content = json.loads(result.stdout)
    assert content["rows"][0]["id"] == "made-up/wrong"
    assert content["header"]["command"] == "femgal verify -k made-up --json -"
    assert "FAIL  made-up/wrong" in result.stderr


def test_report(tmp_path, made_up):
    made_up("wrong", fails)
    out = tmp_path / "deep" / "out"
    assert run("-k", "made-up", "--report", out, "--full").exit_code == 1
    assert {path.name for path in out.iterdir()} == {"verify.json", "verify.xml", "verify.md", "verify.html"}
    assert [path.name for path in tmp_path.iterdir()] == ["deep"]
    content = json.loads((out / "verify.json").read_text())
    assert content["header"]["command"] == "femgal verify -k made-up --full --report out"
    for path in out.iterdir():
        assert "made-up/wrong" in path.read_text()
        assert str(tmp_path) not in path.read_text()
    # An older report is replaced.
    result = run("-k", FASTEST, "--report", out)
    assert result.exit_code == 0
    assert f"wrote {out}" in result.stdout
    assert json.loads((out / "verify.json").read_text())["summary"]["status"]["FAIL"] == 0


SLEEPY = """
import sys, time
from femgal.cli import main
from verify.suite.case import Kind, Measurement, case

def sleeps(use):
    print("asleep", flush=True, file=sys.stderr)
    time.sleep(60)

what = dict(title="t", quantity="q", unit="1", kind=Kind.IDENTITY, formula="f", source="s", tolerance=1.0, reason="r")
case("zz/first", **what)(lambda use: Measurement(1.0, 1.0, 0.0))
case("zz/second", **what)(sleeps)
case("zz/third", **what)(lambda use: Measurement(1.0, 1.0, 0.0))
main(["verify", "-k", "zz/", *sys.argv[1:]])
"""


def test_interrupted(tmp_path):
    command = [sys.executable, "-c", SLEEPY, "--report", str(tmp_path / "out")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stderr.readline() == "asleep\n"
    process.send_signal(signal.SIGINT)
    stdout, stderr = process.communicate(timeout=300)
    assert process.returncode == 130, stderr
    assert "Traceback" not in stderr
    assert "not run: 2 rows (interrupted)" in stdout
    content = json.loads((tmp_path / "out" / "verify.json").read_text())
    assert [row["id"] for row in content["rows"]] == ["zz/first"]
    assert content["summary"]["not_run"]["2 rows"] == "interrupted"


def test_terminal():
    """Colours, and the row that runs, in a terminal of our own."""
    command = [sys.executable, "-m", "femgal.cli", "verify", "-k", FASTEST]
    ours, theirs = pty.openpty()
    environment = {k: v for k, v in os.environ.items() if k != "NO_COLOR"} | {"TERM": "xterm", "COLUMNS": "200"}
    process = subprocess.Popen(command, stdout=theirs, stderr=theirs, env=environment)
    os.close(theirs)
    shown, deadline = b"", time.monotonic() + 120
    while time.monotonic() < deadline:
        try:
            part = os.read(ours, 4096)
        except OSError:  # Linux: the other end is closed
            break
        if not part:
            break
        shown += part
    os.close(ours)
    assert process.wait(timeout=300) == 0
    text = shown.decode()
    assert "\x1b[32mPASS\x1b[0m  material/von-mises[shear]" in text
    assert "1 of 2  material/von-mises[shear]" in text
