# SPDX-License-Identifier: BSD-3-Clause
"""A user's own solver goes through the cases that femgal's solvers go through.

From Python:

    from verify import check_solver
    for result in check_solver(my_step, method="backward-euler"):
        print(result.row, result.status.value, result.note)

What the function is given and what it has to promise stands in `verify.integrators.under_test`.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any, cast

from meshes.errors import InputError
from verify.integrators.under_test import METHODS, ORDERS, OWN_SOLVER, Method, SolverUnderTest, Step, use_own_solver
from verify.suite.case import Row
from verify.suite.run import Result, choose, run
from verify.suite.use import Use

_WHERE = "--solver"
_TOPICS = "stepping, dynamics"
_ALLOWED = "module:function, or path/to/file.py:function"


def check_solver(
    step: Step,
    *,
    method: str | None = None,
    order: int | None = None,
    pattern: str | None = None,
    quick: bool = False,
    use: Use | None = None,
) -> list[Result]:
    """Run all cases about solvers with a function of one's own.

    Parameters
    ----------
    step : (mesh, material, state, h) -> state.
    method, order : What it promises; when left out, its attributes of these names, where it has them.
    pattern, quick : Which rows, as in `verify.suite.run.choose`.
    use : Device, threads and seed of the run.

    Raises
    ------
    InputError
        Not a function of four arguments, or a promise that nobody can keep.
    """
    rows = own_solver_rows(as_solver(step, method, order), pattern, quick=quick)
    return list(run(rows, use or Use()))


def own_solver_rows(solver: SolverUnderTest, pattern: str | None = None, *, quick: bool = False) -> list[Row]:
    """The rows of a solver that is plugged in.

    Raises
    ------
    InputError
        No row about solvers fits the pattern.
    """
    use_own_solver(solver)
    rows = choose(pattern, quick=quick, axes={"solver": (OWN_SOLVER,)})
    # Other cases have solvers of femgal's own as an axis, down to their layers.
    rows = [row for row in rows if row.case.own_solver]
    if not rows:
        raise InputError("no case about a solver of one's own fits", where="-k", found=repr(pattern), allowed=_TOPICS)
    return rows


def as_solver(step: Callable[..., object], method: str | None = None, order: int | None = None) -> SolverUnderTest:
    """A function with its promises, checked; see `check_solver`."""
    if not callable(step):
        raise InputError("the solver cannot be called", where=_WHERE, found=repr(step), allowed="a function")
    name = getattr(step, "__name__", type(step).__name__)
    try:
        inspect.signature(step).bind("mesh", "material", "state", "h")
    except TypeError as error:
        found = f"{name}{inspect.signature(step)}: {error}"
        raise InputError("wrong arguments", where=_WHERE, found=found, allowed="(mesh, material, state, h)") from None
    except ValueError:
        pass  # Compiled functions may not tell.
    method = getattr(step, "method", None) if method is None else method
    if method is not None and method not in METHODS:
        raise InputError("unknown method", where=name, found=repr(method), allowed=", ".join(METHODS) + ", or None")
    order = getattr(step, "order", None) if order is None else order
    if order not in (None, 1, 2, 3, 4):
        raise InputError("the order in time cannot be judged", where=name, found=repr(order), allowed="1 to 4, or None")
    if method is not None and order not in (None, ORDERS[cast(Method, method)]):
        raise InputError(f"{method} has another order", where=name, found=order, allowed=ORDERS[cast(Method, method)])
    promised = cast(Method | None, method)
    return SolverUnderTest(name, cast(Step, step), promised, ORDERS[promised] if promised else order)


def load_solver(text: str) -> SolverUnderTest:
    """A solver by the name of its function.

    Parameters
    ----------
    text : "module:function", or "path/to/file.py:function"; the working folder is searched for modules too.

    Raises
    ------
    InputError
        No such module, file or function, or one that cannot be imported.
    """
    place, _, name = text.rpartition(":")
    if not place or not name:
        raise InputError("not the name of a function", where=_WHERE, found=repr(text), allowed=_ALLOWED)
    module = _from_file(Path(place)) if place.endswith(".py") else _from_name(place)
    if not hasattr(module, name):
        raise InputError("no such function", where=place, found=name, allowed=_functions(module))
    return as_solver(getattr(module, name))


def _from_file(path: Path) -> ModuleType:
    path = path.expanduser()
    if not path.is_file():
        raise InputError("no such file", where=_WHERE, found=str(path), allowed=_ALLOWED)
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module, loader = importlib.util.module_from_spec(spec), spec.loader
    # What the file imports from its own folder is found as it is when Python runs the file.
    _imported(lambda: loader.exec_module(module), str(path), path.parent)
    return module


def _from_name(name: str) -> ModuleType:
    return _imported(lambda: importlib.import_module(name), name, Path.cwd())


def _imported(load: Callable[[], Any], where: str, folder: Path) -> Any:
    """What `load` returns, with a folder at the head of the module search path."""
    sys.path.insert(0, str(folder.resolve()))
    try:
        return load()
    except (Exception, SystemExit) as error:
        raise InputError(
            "the module cannot be imported",
            where=where,
            found=f"{type(error).__name__}: {error}",
            allowed=_ALLOWED,
            advice="import it in Python to see where it goes wrong",
        ) from error
    finally:
        sys.path.remove(str(folder.resolve()))


def _functions(module: ModuleType) -> str:
    names = [name for name, value in vars(module).items() if inspect.isfunction(value)]
    return ", ".join(names) or "the module has no functions"
