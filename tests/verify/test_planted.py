# SPDX-License-Identifier: BSD-3-Clause
"""Planted bugs.

1. Every bug is an edit that applies to the sources as they are: its old text is there once, and its new text differs.
2. The rows that a bug names exist, pass on the sound sources, and at least one turns red with the bug planted: a few
   bugs always, all of them with ``pytest -m planted``.
3. A bug leaves the copy as it was; a copy that is not the one that ran is noticed, as are a crash and a stale text.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import femgal
from verify.planted.bugs import BUGS, Bug
from verify.planted.plant import copy_sources, planted, run_cases, run_planted
from verify.suite.run import choose

ROOT = Path(femgal.__file__).resolve().parents[1]

# Cheap ones from different parts: of these no element kernel is compiled anew.
ALWAYS = ("h in place of h^2", "coarsest layer left out", "velocity from the prediction")


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    return copy_sources(tmp_path_factory.mktemp("planted") / "sources")


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("planted-cache")


def test_at_least_25_bugs_with_names_of_their_own():
    assert len({bug.name for bug in BUGS}) == len(BUGS) >= 25


@pytest.mark.parametrize("bug", BUGS, ids=lambda bug: bug.name)
def test_bug_applies_to_the_sources(bug):
    assert (ROOT / bug.file).read_text(encoding="utf-8").count(bug.old) == 1
    assert bug.old != bug.new
    assert choose(bug.cases, quick=True)


def _marked(bug: Bug):
    return pytest.param(bug, id=bug.name, marks=() if bug.name in ALWAYS else (pytest.mark.slow,))


@pytest.mark.planted
@pytest.mark.parametrize("bug", [_marked(bug) for bug in BUGS])
def test_a_case_turns_red(bug, tree, cache):
    catch = run_planted(bug, tree, cache)
    assert catch.caught, catch


@pytest.mark.planted
def test_sound_sources_are_green(tree, cache):
    cases = " ".join(sorted({bug.cases for bug in BUGS if bug.name in ALWAYS}))
    catch = run_cases(Bug("no bug", "", "", "", cases), tree, cache)
    assert catch.green
    assert (catch.red, catch.trouble) == ((), "")


@pytest.mark.planted
@pytest.mark.slow
def test_all_sound_sources_are_green(tree, cache):
    catch = run_cases(Bug("no bug", "", "", "", " ".join(sorted({bug.cases for bug in BUGS}))), tree, cache)
    assert (catch.red, catch.trouble) == ((), "")


def test_the_copy_is_as_before(tmp_path):
    bug = BUGS[0]
    file = tmp_path / bug.file
    file.parent.mkdir(parents=True)
    file.write_text(f"a\n{bug.old}\nb\n")
    before = file.stat().st_mtime_ns
    with planted(bug, tmp_path):
        assert file.read_text() == f"a\n{bug.new}\nb\n"
    assert (file.read_text(), file.stat().st_mtime_ns) == (f"a\n{bug.old}\nb\n", before)
    with pytest.raises(ValueError, match="0 times"), planted(replace(bug, old="not there"), tmp_path):
        pass


def test_a_crash_is_trouble_and_not_a_catch(tree, cache):
    catch = run_planted(
        Bug("crash", "verify/planted/rows.py", "import json\n", "raise SystemExit(7)\n", "x"), tree, cache
    )
    assert not catch.caught
    assert catch.trouble.startswith("exit code 7")
