# SPDX-License-Identifier: BSD-3-Clause
"""The tables as text.

1. One table for STREAM, one per variant, one of ratios, one of first calls; every row has a cell per head.
2. The cells hold the numbers of the report: times, rates, bounds, shares, speed-ups, ratios.
3. Threads of one pass stand under one another.
4. The preamble names machine, versions, mesh and settings.
5. Notes warn of a triad that fits into the cache and of a disturbed machine, and only then.
"""

from __future__ import annotations

from dataclasses import replace

from tests.verify.kernel_report_sample import MACHINE, same, sample_report
from verify.benchmark.kernel_report import StreamResult
from verify.benchmark.kernel_tables import notes, preamble, tables
from verify.benchmark.passes import BLOCKS, GRADIENT, SUBSTEPS

REPORT = sample_report()
SUBSTEP = next(iter(SUBSTEPS))
STREAM, FLOAT32, PLAIN, RATIOS, FIRST = tables(REPORT)


def test_shape():
    for table in (STREAM, FLOAT32, PLAIN, RATIOS, FIRST):
        assert table.title
        assert table.rows
        assert {len(row) for row in table.rows} == {len(table.heads)}


def test_stream():
    assert STREAM.rows == (
        ("triad", "1", "8", "12.0", "8.0", "16.0"),
        ("triad", "2", "8", "24.0", "24.0", "24.0"),
    )


def test_passes():
    assert FLOAT32.rows == (
        (GRADIENT, "1", "0.5", "0.5..0.5", "0.5 (0.5)", "2 / 2", "60", "200", "1 / 1", ""),
        (BLOCKS, "1", "2", "1..4", "1 (1)", "0.5 / 1", "80", "150", "0 / 0", ""),
        (BLOCKS, "2", "1", "1..1", "2 (2)", "1 / 1", "80", "300", "0 / 0", "2.00 / 1.00"),
        (SUBSTEP, "1", "6", "3..12", "3 (3)", "0.167 / 0.333", "", "", "", ""),
    )
    assert PLAIN.rows == ((BLOCKS, "2", "8", "8..8", "16 (16)", "0.125 / 0.125", "150", "160", "0 / 0", ""),)
    assert "reference" in PLAIN.title


def test_threads_stand_together():
    scattered = replace(REPORT, passes=tuple(sorted(REPORT.passes, key=lambda result: result.threads)))
    assert tables(scattered)[1].rows == FLOAT32.rows


def test_ratios():
    assert RATIOS.rows == (
        (f"{BLOCKS} over {GRADIENT}", "float32", "1", "4.00", "2.00..8.00", "2.00"),
        (f"{SUBSTEP} over {BLOCKS}", "float32", "1", "3.00", "3.00..3.00", "3.00"),
    )


def test_first_calls():
    assert FIRST.rows == ((GRADIENT, "float32", "1.250 / 0.750", "15", "15..15"),)


def test_preamble():
    text = "\n".join(preamble(REPORT))
    for part in (
        "Abacus",
        "beads",
        "1 MiB",
        "Numba 0.6",
        "200 vertices",
        "1000 tetrahedra",
        "clusters of 32 700",
        "3 rounds",
    ):
        assert part in text
    silent = replace(REPORT, machine=MACHINE | {"last_level_cache": None})
    assert "cache unknown" in "\n".join(preamble(silent))


def test_notes():
    text = "\n".join(notes(REPORT))
    assert "wall / CPU" in text
    assert "78 or 149" in text
    assert "doubtful" not in text
    assert "differ by a factor of 2.00" in text
    quiet = replace(REPORT, stream=(StreamResult(1, 24_000_000, same(2e-3, 2e-3)),))
    assert "disturbed machine" not in "\n".join(notes(quiet))
    large_cache = replace(REPORT, machine=MACHINE | {"last_level_cache": 2**22})
    assert "doubtful bound: arrays of STREAM of 8 MB" in "\n".join(notes(large_cache))
