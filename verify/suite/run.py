# SPDX-License-Identifier: BSD-3-Clause
"""Finding, choosing and running the rows of the verification suite."""

from __future__ import annotations

import enum
import fnmatch
import importlib
import pkgutil
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import verify.cases
from meshes.errors import InputError
from verify.suite.case import Case, Measurement, Row, Skip, registered
from verify.suite.use import Use


class Status(enum.Enum):
    """Verdict on a row; INFO rows have no tolerance and judge nothing."""

    PASS = "PASS"
    FAIL = "FAIL"
    SKIP = "SKIP"
    INFO = "INFO"


@dataclass(frozen=True)
class Result:
    """A row that has been run.

    Parameters
    ----------
    row : What was asked.
    status : The verdict.
    measurement : The numbers; None where there are none.
    note : Why there are none, or what the case says about them.
    device : Where it ran.
    seconds : CPU time, all threads, compilation included.
    """

    row: Row
    status: Status
    measurement: Measurement | None
    note: str
    device: str
    seconds: float


# From the parts to the whole: the first red row is where to begin.
TOPICS = (
    *("material", "eigenvalues", "derivatives", "invariance", "collapse"),
    *("transfer", "blocks", "assembly", "smoothers", "cycles", "preconditioners", "newton", "descent"),
    *("patch", "manufactured", "exact", "bending"),
    *("stepping", "dynamics", "consistency", "system"),
)


def cases() -> tuple[Case, ...]:
    """All cases of `verify.cases`, topic by topic; those that nobody has put in order last."""
    for module in pkgutil.iter_modules(verify.cases.__path__):
        importlib.import_module(f"verify.cases.{module.name}")
    return tuple(sorted(registered(), key=_place))


def _place(one: Case) -> tuple[int, str]:
    topic = one.id.split("/")[0]
    return (TOPICS.index(topic) if topic in TOPICS else len(TOPICS), topic)


def choose(
    pattern: str | None = None, *, quick: bool = False, axes: Mapping[str, Sequence[Any]] | None = None
) -> list[Row]:
    """Rows to run.

    Parameters
    ----------
    pattern : Part of a row's id, or of its title; with * or ? a pattern of the whole id. Several are separated by
        spaces, and a row must fit one of them.
    quick : Leave out what takes long.
    axes : Values in place of the cases' own, by axis; only cases that have all of these axes are chosen.

    Raises
    ------
    InputError
        No row fits.
    """
    chosen = [
        row
        for one in cases()
        if set(axes or {}) <= set(one.over)
        for row in one.rows(axes)
        if (not quick or row.is_quick) and _fits(row, pattern)
    ]
    if not chosen:
        raise InputError(
            "no case fits",
            where="-k" if pattern else "axes",
            found=repr(pattern) if pattern else sorted(axes or {}),
            allowed="part of an id or title; topics: " + ", ".join(sorted({one.id.split("/")[0] for one in cases()})),
            advice="`femgal verify --list` prints them all; --full adds what --quick leaves out",
        )
    return chosen


def run(rows: Iterable[Row], use: Use) -> Iterator[Result]:
    """Run rows one after the other; whatever a case raises is a failure of that row only."""
    for row in rows:
        yield run_row(row, use)


def run_row(row: Row, use: Use) -> Result:
    """Run one row."""
    began = time.process_time()

    def result(status: Status, measurement: Measurement | None, note: str) -> Result:
        return Result(row, status, measurement, note, use.device, time.process_time() - began)

    try:
        measured = row.case.function(use, **row.values)
        if not isinstance(measured, Measurement):
            raise TypeError(f"a case returns a Measurement, not {type(measured).__name__}")
    except Skip as reason:
        return result(Status.SKIP, None, str(reason))
    except (Exception, SystemExit) as error:  # a user's solver that exits is a failure, not the end of the suite
        where = traceback.extract_tb(error.__traceback__)[-1]
        return result(Status.FAIL, None, f"{type(error).__name__}: {error} ({where.name}, line {where.lineno})")
    if row.tolerance is None:
        return result(Status.INFO, measured, measured.note)
    return result(Status.PASS if row.passes(measured.error) else Status.FAIL, measured, measured.note)


def run_all(
    rows: Sequence[Row], use: Use, on_start: Callable[[Row], None], on_result: Callable[[Result], None]
) -> list[Result]:
    """Run rows and tell of each before and after."""
    results = []
    for row in rows:
        on_start(row)
        results.append(run_row(row, use))
        on_result(results[-1])
    return results


def _fits(row: Row, pattern: str | None) -> bool:
    if not pattern:
        return True
    name, title = str(row).lower(), row.case.title.lower()
    # The brackets of an id are no character class.
    return any(
        fnmatch.fnmatchcase(name, word.replace("[", "[[]")) if set(word) & set("*?") else word in name or word in title
        for word in pattern.lower().split()
    )
