# SPDX-License-Identifier: BSD-3-Clause
"""A part of a study that solves one substep with every solver, iteration by iteration."""

from __future__ import annotations

import itertools
from dataclasses import asdict, fields
from typing import Any

from pydantic import TypeAdapter, ValidationError

from meshes.errors import InputError
from verify.studies.definition import Part
from verify.studies.entries import substep_entries
from verify.studies.motion import Bench
from verify.work_precision.carry_out import carry_out
from verify.work_precision.method import Method
from verify.work_precision.problem import Problem, problems
from verify.work_precision.request import Request, substep_request
from verify.work_precision.run_substep import SubstepOptions
from verify.work_precision.store import Result

Trace = dict[str, Any]


class SubstepPart:
    """One substep of each scene, with every solver from the same prediction.

    Raises
    ------
    InputError
        No such scene or solver, or settings that one does not have.
    """

    def __init__(self, part: Part, bench: Bench) -> None:
        self.part, self._bench = part, bench
        self.grid = part.make_grid()
        self.problems, self.methods = problems(self.grid), self.grid.methods()
        self._options = asdict(_options(part))
        for problem, method in itertools.product(self.problems, self.methods):
            self._request(problem, method)

    def run(self) -> None:
        """Run what is missing."""
        wanted = (self._request(p, m) for p, m in itertools.product(self.problems, self.methods))
        carry_out(self._bench.executor, ((request, self._bench.store) for request in wanted), self._bench.announce)

    def record(self) -> dict[str, Any]:
        """Problems, traces and entries, JSON-ready."""
        traces = [self._trace(p, m) for p, m in itertools.product(self.problems, self.methods)]
        return {
            "problems": [_problem(problem, traces) for problem in self.problems],
            "traces": traces,
            "entries": substep_entries(traces, self.part.levels, self.part.targets, self._bench.options.clock),
        }

    def _request(self, problem: Problem, method: Method) -> Request:
        return substep_request(
            problem.scene, method, self.grid.threads, problem.id, self._options, self.grid.time_limit
        )

    def _trace(self, problem: Problem, method: Method) -> Trace:
        found = self._bench.store.find(self._request(problem, method))
        about = {
            "problem": problem.id,
            "curve": method.curve,
            "label": str(method),
            "settings": dict(method.settings),
        }
        return about | (_nothing() if found is None else _numbers(found))


def _options(part: Part) -> SubstepOptions:
    """The options of a single substep, checked.

    Raises
    ------
    InputError
        Keys or values that it cannot have.
    """
    known = [field.name for field in fields(SubstepOptions)]
    unknown = next((key for key in part.options if key not in known), None)
    if unknown is not None:
        raise InputError("no such option", where=f"options of {part.id}", found=unknown, allowed=", ".join(known))
    try:
        return TypeAdapter(SubstepOptions).validate_python(part.options)
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(str(first["msg"]), where=f"options of {part.id}", found=first["input"]) from None


def _nothing() -> Trace:
    return {"status": "not run", "failure": None, "iterates": []}


def _numbers(found: Result) -> Trace:
    if found.failure:
        kind = found.numbers.get("failure_kind")
        return {"status": "failed", "failure": found.failure, "failure_kind": kind, "iterates": []}
    keys = ("vertices", "tets", "h", "prediction", "minimiser", "peak_mb", "load")
    return {
        "status": "done",
        "failure": None,
        "older": found.older,
        **{key: found.numbers[key] for key in keys},
        "iterates": found.numbers["rows"],
    }


def _problem(problem: Problem, traces: list[Trace]) -> dict[str, Any]:
    done = next((trace for trace in traces if trace["problem"] == problem.id and trace["iterates"]), {})
    keys = ("vertices", "tets", "h", "prediction", "minimiser")
    return {"id": problem.id, "axes": dict(problem.axes), **{key: done.get(key) for key in keys}}
