# SPDX-License-Identifier: BSD-3-Clause
"""Description of the machine.

1. It is JSON, and names CPU, versions, processors, cache, huge pages and what Numba compiles for.
2. The largest cache is the last one; the setting of huge pages is the word in brackets.
3. What the system does not tell is None.
"""

from __future__ import annotations

import json
import os

from verify.benchmark.machine import describe_machine

ENABLED = "always [madvise] never\n"


def test_description_is_json(tmp_path):
    machine = describe_machine()
    assert json.loads(json.dumps(machine)) == machine
    assert machine["processors"] == len(os.sched_getaffinity(0))
    for key in ("cpu", "python", "numpy", "numba", "femgal", "compiled_for"):
        assert machine[key]


def test_system_files(tmp_path):
    for index, size in enumerate(["48K", "32K", "2048K", "107520K"]):
        (tmp_path / f"index{index}").mkdir()
        (tmp_path / f"index{index}" / "size").write_text(f"{size}\n")
    (tmp_path / "enabled").write_text(ENABLED)
    machine = describe_machine(tmp_path, tmp_path / "enabled")
    assert machine["last_level_cache"] == 107520 * 1024
    assert machine["transparent_huge_pages"] == "madvise"


def test_silent_system(tmp_path):
    machine = describe_machine(tmp_path / "none", tmp_path / "none")
    assert machine["last_level_cache"] is None
    assert machine["transparent_huge_pages"] is None
