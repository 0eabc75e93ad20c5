# SPDX-License-Identifier: BSD-3-Clause
"""A folder that holds a report and nothing else.

1. A new folder is made with its parents; an empty one, and one with an older report, are taken.
2. A file, a folder that holds anything else, and one that cannot be made are refused; with force other files stay.
3. Files are replaced whole, and nothing else is left behind.
"""

from __future__ import annotations

import pytest

from femgal.output.report import prepare_report, write_report
from meshes.errors import InputError

NAMES = ("a.json", "a.html")


def test_new_and_older(tmp_path):
    folder = prepare_report(tmp_path / "new" / "out", NAMES, force=False)
    assert folder == tmp_path / "new" / "out"
    write_report(folder, {"a.json": "1", "a.html": "old"})
    write_report(prepare_report(folder, NAMES, force=False), {"a.html": "new"})
    assert {path.name: path.read_text() for path in folder.iterdir()} == {"a.json": "1", "a.html": "new"}


def test_other_files(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(InputError, match=r"(?s)other files.*thesis\.tex.*--force"):
        prepare_report(tmp_path, NAMES, force=False)
    write_report(prepare_report(tmp_path, NAMES, force=True), {"a.json": "1"})
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


@pytest.mark.parametrize("force", [False, True])
def test_no_folder(tmp_path, force):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is a file"):
        prepare_report(tmp_path / "file", NAMES, force=force)
    with pytest.raises(InputError, match="cannot be written"):
        prepare_report(tmp_path / "file" / "out", NAMES, force=force)
