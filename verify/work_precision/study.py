# SPDX-License-Identifier: BSD-3-Clause
"""A grid, run: what is missing in the folders is run, what is there is put together.

First every scene is surveyed, which finds what cannot be built. Then references and first runs, scene by scene, the
small ones first; then the finalists again, in turns, for the spread of their times.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from meshes.errors import InputError
from verify.work_precision.carry_out import carry_out
from verify.work_precision.executor import Executor
from verify.work_precision.front import finalists
from verify.work_precision.grid import Grid
from verify.work_precision.horizon import Horizon, choose_horizon
from verify.work_precision.measure import Reference as Motion
from verify.work_precision.method import Method
from verify.work_precision.problem import Problem, problems
from verify.work_precision.reference import (
    ReferenceMotion,
    ReferencePair,
    motion_of,
    read_reference,
    reference_pair,
)
from verify.work_precision.request import Request, motion_request, survey_request
from verify.work_precision.row import Clock, Known, make_row
from verify.work_precision.solver_error import converged_method
from verify.work_precision.store import Result, Store

Row = dict[str, Any]


@dataclass(frozen=True)
class Options:
    """How to run a grid.

    Parameters
    ----------
    clock : Which time counts.
    gaps : Substeps whose energy gap is measured.
    refresh_references : Make references anew.
    references : Make references at all; without them nothing is said of errors.
    solver_error : Whether solver errors are wanted: a converged run for each kind and number of steps.
    """

    clock: Clock = "wall"
    gaps: int = 0
    refresh_references: bool = False
    references: bool = True
    solver_error: bool = False


@dataclass(eq=False)
class Study:
    """A grid with its folders.

    Parameters
    ----------
    store, references : Folders of runs and of references.
    executor : Carries out runs.
    announce : Told what begins, and what has ended how.
    """

    grid: Grid
    store: Store
    references: Store
    executor: Executor
    options: Options = field(default_factory=Options)
    announce: Callable[[str], None] = lambda text: None
    problems: list[Problem] = field(init=False)
    methods: list[Method] = field(init=False)
    _known: Known = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        """Refuse whatever can be refused before anything runs.

        Raises
        ------
        InputError
            No such scene or solver, or settings that one does not have.
        """
        self.problems, self.methods = problems(self.grid), self.grid.methods()
        for problem, method in itertools.product(self.problems, self.methods):
            method.scene(problem.scene, self.grid.threads)

    def run(self) -> None:
        """Run what is missing.

        Raises
        ------
        InputError
            A scene that cannot be built.
        KeyboardInterrupt
            The user stops; what has ended is kept.
        """
        self._carry_out((survey_request(p.scene, p.id), self.store) for p in self.problems)
        for problem in self.problems:
            failure = self._survey(problem)["failure"]
            if failure:
                raise InputError("the scene cannot be built", where=problem.id, found=failure)
        if self.options.refresh_references:
            for problem in self.problems:
                for request in self._pair(problem).both:
                    self.references.remove(request)
        self._carry_out(self._first_runs())
        self._carry_out(self._repetitions())
        if self.options.solver_error:
            requests = (self._converged(p, m) for p, m in itertools.product(self.problems, self.methods))
            self._carry_out((request, self.store) for request in requests if request is not None)

    def _first_runs(self) -> Iterator[tuple[Request, Store]]:
        for problem in self.problems:
            if self.options.references:
                yield from ((request, self.references) for request in self._pair(problem).both)
            yield from ((self._request(problem, method), self.store) for method in self.methods)

    def _repetitions(self) -> Iterator[tuple[Request, Store]]:
        """In turns: what disturbs the machine for a while disturbs all finalists of a scene."""
        if self.grid.repeats < 2:
            return
        for problem in self.problems:
            chosen = self.finalists(problem)
            for number in range(1, self.grid.repeats):
                yield from ((self._request(problem, method).repeated(number), self.store) for method in chosen)

    def finalists(self, problem: Problem) -> list[Method]:
        """Methods that decide who is soonest at a target."""
        rows = self.rows(problem, repetitions=False)
        best = [(row["solver"], row["label"]) for row in finalists(rows, self.grid.targets, "seconds")]
        return list({str(m): m for m in self.methods if (m.name, str(m)) in best}.values())

    def rows(self, problem: Problem, *, repetitions: bool = True) -> list[Row]:
        """Numbers of every method on a scene, as far as they have been run."""
        reference = self.reference(problem)
        known = reference if isinstance(reference, ReferenceMotion) else None
        converged = self._converged_motions(problem) if repetitions else {}
        return [
            make_row(
                problem,
                method,
                self._runs(problem, method, repetitions),
                known,
                self.options.clock,
                converged.get(str(method)),
                self._known,
            )
            for method in self.methods
        ]

    def reference(self, problem: Problem) -> ReferenceMotion | str:
        """The reference of a scene, or why there is none."""
        if not self.options.references:
            return "none was asked for"
        if self.store.find(survey_request(problem.scene, problem.id)) is None:
            return "has not been run"
        return read_reference(self._pair(problem), self.references)

    def horizon(self, problem: Problem) -> Horizon:
        """Length of a scene's motion."""
        # Where the way is a matter of chance, the end counts: the scene says when that is.
        period = None if problem.is_chaotic else self._survey(problem)["period"]
        return choose_horizon(problem.scene, period, self.grid.periods, self.grid.frames)

    def survey(self, problem: Problem) -> dict[str, Any] | None:
        """What is known of a scene; None where it has not been looked at."""
        found = self.store.find(survey_request(problem.scene, problem.id))
        return found.numbers if found is not None and found.failure is None else None

    def _survey(self, problem: Problem) -> dict[str, Any]:
        found = self.store.find(survey_request(problem.scene, problem.id))
        assert found is not None
        return found.numbers

    def _pair(self, problem: Problem) -> ReferencePair:
        scene = self.horizon(problem).of(problem.scene)
        physics = self._survey(problem)["physics"]
        return reference_pair(scene, physics, problem.id, self.grid.reference_safety, self.grid.threads)

    def _request(self, problem: Problem, method: Method) -> Request:
        scene = self.horizon(problem).of(problem.scene)
        limit, gaps = self.grid.time_limit, self.options.gaps
        return motion_request(scene, method, self.grid.threads, problem.id, gaps=gaps, time_limit=limit)

    def _converged(self, problem: Problem, method: Method) -> Request | None:
        """The run that a method's solver error is taken from; None where it has none."""
        scene = self.horizon(problem).of(problem.scene)
        settings = method.scene(scene, self.grid.threads).solver
        solved = converged_method(settings, self._survey(problem)["vertices"])
        return None if solved is None else motion_request(scene, solved, self.grid.threads, problem.id)

    def _converged_motions(self, problem: Problem) -> dict[str, Motion]:
        """By method, as far as they are wanted and have been run; methods that take the same steps share one."""
        if not self.options.solver_error or self.survey(problem) is None:
            return {}
        motions: dict[str, Motion] = {}
        found = {}
        for method in self.methods:
            request = self._converged(problem, method)
            result = None if request is None else self.store.find(request)
            if request is None or result is None or result.failure or result.motion is None:
                continue
            if request.name not in motions:
                motions[request.name] = motion_of(result)
            found[str(method)] = motions[request.name]
        return found

    def _runs(self, problem: Problem, method: Method, repetitions: bool) -> list[Result]:
        if self.survey(problem) is None:
            return []
        first = self._request(problem, method)
        wanted = [first, *(first.repeated(n) for n in range(1, self.grid.repeats if repetitions else 1))]
        return [found for found in map(self.store.find, wanted) if found is not None]

    def _carry_out(self, wanted: Iterable[tuple[Request, Store]]) -> None:
        carry_out(self.executor, wanted, self.announce)
