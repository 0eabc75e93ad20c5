# SPDX-License-Identifier: BSD-3-Clause
"""Replacing files.

1. The new content appears as a whole, and no temporary file stays.
2. After an exception the old content is untouched, and no temporary file stays.
"""

from __future__ import annotations

import pytest

from femgal.output.atomic import replacing, write_text


def test_replaces(tmp_path):
    path = tmp_path / "run.json"
    write_text(path, "old")
    write_text(path, "new µ")
    assert path.read_text(encoding="utf-8") == "new µ"
    assert list(tmp_path.iterdir()) == [path]


def fail_while_replacing(path):
    with replacing(path) as part:
        part.write_text("half of the n")
        assert path.read_text() == "old"
        raise OSError("disk full")


def test_exception_keeps_the_old_file(tmp_path):
    path = tmp_path / "run.json"
    write_text(path, "old")
    with pytest.raises(OSError, match="disk full"):
        fail_while_replacing(path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
