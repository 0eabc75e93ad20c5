# SPDX-License-Identifier: BSD-3-Clause
"""Figures of papers, each with its source, to stand beside ours. They are data: `published.toml`."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any


@dataclass(frozen=True)
class PublishedTable:
    """Speedups over a baseline, as a paper prints them.

    Parameters
    ----------
    source : Paper and table.
    axis : What the columns differ in: "vertices" or "E".
    values : Of each column.
    rows : Speedups [1] by the name of the curve that stands for it here.
    """

    source: str
    axis: str
    values: tuple[float, ...]
    rows: dict[str, tuple[float, ...]]

    def at(self, curve: str, value: float | None) -> float | None:
        """The figure of a curve at a value of the axis; None where the paper has none."""
        found = dict(zip(self.values, self.rows.get(curve, ()), strict=False))
        return None if value is None else found.get(value)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {"source": self.source, "axis": self.axis, "values": self.values, "rows": self.rows}


@cache
def published_tables() -> dict[str, PublishedTable]:
    """All tables by name."""
    data = tomllib.loads(files("verify.studies").joinpath("published.toml").read_text(encoding="utf-8"))
    return {
        name: PublishedTable(
            table["source"],
            table["axis"],
            tuple(map(float, table["values"])),
            {curve: tuple(map(float, figures)) for curve, figures in table["rows"].items()},
        )
        for name, table in data.items()
    }
