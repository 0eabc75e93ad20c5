# SPDX-License-Identifier: BSD-3-Clause
"""Memory that is left.

1. What the system says, or less where a control group of either version allows less; file caches that are given back
   on demand count as left.
2. "max", numbers beyond any memory, and missing or broken files set no limit.
3. On this machine something is left, and no more than there is.
4. What does not fit is refused with both numbers; what fits is not.
"""

from __future__ import annotations

import os

import pytest

from meshes.errors import InputError
from verify.benchmark.memory import available_memory, require_memory

MEMINFO = "MemTotal: 2000 kB\nMemAvailable:    1000 kB\nHugePages_Total: 0\n"


@pytest.fixture
def accounts(tmp_path):
    """Write the files of a kernel and return what is left by them."""

    def left(files: dict[str, str]) -> int | None:
        for name, text in files.items():
            path = tmp_path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        return available_memory(tmp_path / "proc", tmp_path / "groups")

    return left


def version_2(limit: str, use: int, stat: str = "inactive_file 0\n") -> dict[str, str]:
    files = {"max": limit, "current": f"{use}\n", "stat": stat}
    return {f"groups/memory.{key}": text for key, text in files.items()}


def version_1(limit: int, use: int, cached: int) -> dict[str, str]:
    files = {"limit_in_bytes": limit, "usage_in_bytes": use, "stat": f"cache 7\ntotal_inactive_file {cached}\n"}
    return {f"groups/memory/memory.{key}": f"{text}" for key, text in files.items()}


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        ({}, 1000 * 1024),
        (version_2("500000\n", 200_000), 300_000),
        (version_2("500000\n", 200_000, "anon 5\ninactive_file 50000\n"), 350_000),
        (version_2("500000\n", 600_000), 0),
        (version_2("max\n", 200_000), 1000 * 1024),
        (version_2("500000\n", 200_000, "broken"), 300_000),
        (version_1(600_000, 500_000, 100_000), 200_000),
        (version_1(2**63 - 4096, 500_000, 0), 1000 * 1024),
    ],
)
def test_the_least_counts(accounts, files, expected):
    assert accounts({"proc/meminfo": MEMINFO} | files) == expected


def test_nobody_knows(accounts):
    assert accounts({}) is None
    assert accounts({"proc/meminfo": "nothing: at all\n"}) is None


def test_here():
    left = available_memory()
    assert left is not None
    assert 0 < left <= os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def test_refusal():
    require_memory(1.0, "one byte", where="here", advice="none")
    with pytest.raises(InputError) as caught:
        require_memory(1e18, "everything", where="--much", advice="ask for less")
    for text in ("--much", "everything", "1000000000000 MB", "available", "ask for less"):
        assert text in str(caught.value)
