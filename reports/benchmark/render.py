# SPDX-License-Identifier: BSD-3-Clause
"""All files of a report but its pictures."""

from __future__ import annotations

from reports.benchmark.charts import Record
from reports.benchmark.page import page
from reports.benchmark.pictures import NAMES as PICTURES
from reports.benchmark.sheet import csv_text
from reports.verification.render import json_text

NAMES = ("bench.json", "bench.csv", "bench.html", *PICTURES)


def render(record: Record) -> dict[str, str]:
    """Content of every text file of the report by name."""
    return {"bench.json": json_text(record), "bench.csv": csv_text(record), "bench.html": page(record)}
