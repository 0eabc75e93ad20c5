# SPDX-License-Identifier: BSD-3-Clause
"""All files of a study's report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from reports.studies.page import page
from reports.verification.render import json_text

NAMES = ("study.json", "study.html")


def render(record: Mapping[str, Any]) -> dict[str, str]:
    """Content of every file of the report by name."""
    return {"study.json": json_text(record), "study.html": page(record)}
