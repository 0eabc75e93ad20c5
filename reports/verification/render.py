# SPDX-License-Identifier: BSD-3-Clause
"""All files of a report."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from reports.verification.junit import junit_xml
from reports.verification.markdown import markdown
from reports.verification.page import page

_RENDERERS = {
    "verify.xml": junit_xml,
    "verify.md": markdown,
    "verify.html": page,
}

NAMES = ("verify.json", *_RENDERERS)


def render(record: Mapping[str, Any]) -> dict[str, str]:
    """Content of every file of the report by name."""
    return {"verify.json": json_text(record)} | {name: renderer(record) for name, renderer in _RENDERERS.items()}


def json_text(record: Mapping[str, Any]) -> str:
    """The record itself; a NaN or an infinity in it is a mistake, since JSON knows neither."""
    return json.dumps(record, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
