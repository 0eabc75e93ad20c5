# SPDX-License-Identifier: BSD-3-Clause
"""The verification suite on the terminal: a line for each row, and on a terminal the row that runs now."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.text import Text

COLOURS = {"PASS": "green", "FAIL": "bold red", "SKIP": "yellow", "INFO": "blue"}
_INDENT = " " * 8


class SuiteProgress:
    """Says which row runs and how it ended; use as a context manager.

    Parameters
    ----------
    total : Number of rows.
    on_stderr : Whether standard output belongs to somebody else.
    """

    def __init__(self, total: int, *, on_stderr: bool = False) -> None:
        self._console = Console(stderr=on_stderr, highlight=False, soft_wrap=True)
        self._total, self._done = total, 0
        self._now = self._console.status("", refresh_per_second=4) if self._console.is_terminal else None

    def __enter__(self) -> SuiteProgress:
        if self._now is not None:
            self._now.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._now is not None:
            self._now.stop()

    def start(self, row: object) -> None:
        """Show the row that runs now, where a line can be taken back."""
        if self._now is not None:
            self._now.update(Text(f"{self._done + 1} of {self._total}  {row}"))

    def finish(self, row: dict[str, Any]) -> None:
        """Print how a row ended, with its note when it did not pass."""
        from reports.verification.words import judgement

        self._done += 1
        width = len(str(self._total))
        line = Text(f"{self._done:{width}d}/{self._total}  ")
        line.append(row["status"], COLOURS[row["status"]])
        line.append(f"  {row['id']}  {judgement(row)}")
        self._console.print(line)
        for text in _remarks(row):
            self._console.print(Text(_INDENT + text, "red" if row["status"] == "FAIL" else "dim"))

    def summary(self, record: dict[str, Any]) -> None:
        """Print what failed once more, and the whole in a few lines."""
        from reports.verification.words import judgement, summary_lines

        self.print("")
        for row in record["rows"]:
            if row["status"] == "FAIL":
                self.print(f"FAIL  {row['id']}  {judgement(row)}", COLOURS["FAIL"])
        first, *rest = summary_lines(record)
        status = record["summary"]["status"]
        self.print(first, COLOURS["FAIL" if status["FAIL"] else "PASS" if status["PASS"] else "SKIP"])
        for line in rest:
            self.print(line)

    def print(self, text: str, style: str = "") -> None:
        """Print a line."""
        self._console.print(Text(text, style))


def _remarks(row: dict[str, Any]) -> list[str]:
    """What a reader of a row that did not simply pass should know."""
    from reports.verification.words import numbers

    if row["status"] == "PASS":
        return []
    remarks = row["note"].splitlines()
    if row["status"] == "FAIL" and row["error"] is not None:
        return [numbers(row), *remarks]
    return remarks
