# SPDX-License-Identifier: BSD-3-Clause
"""`femgal bench preconditioners`: iterations and time of the preconditioners of Newton's systems, over sizes and E/rho.

The systems are those of an implicit step of one frame: A = M / h^2 + K(x), at rest and bent by a fifth of the body's
thickness. They depend on E h^2 / rho alone, so one body serves for all materials. Conjugate gradients go on until
sqrt(r . M^-1 r) has fallen to the reduction asked for, with M the preconditioner that is measured, and with two
right-hand sides: the weight of the body, which is smooth, and forces at random, which are not.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femgal.scene.load import load_scene
from femgal.simulation import Simulation
from femgal.solvers.newton import Newton
from femgal.solvers.pcg import Solution, solve
from femgal.solvers.preconditioner import Preconditioner
from femgal.timestep.implicit import ImplicitMethod
from femgal.timestep.potential import IncrementalPotential
from meshes.errors import InputError
from verify.benchmark.kernel_tables import TextTable
from verify.benchmark.machine import describe_machine

Floats = NDArray[np.float64]

SCHEMA = "femgal-bench-preconditioners-1"
PRECONDITIONERS = ("blocks", "layers", "cycle", "mas", "v-cycle")
STATES = ("rest", "bent")
MOST_ITERATIONS = 2000

# Amplitude of the bent state over the smallest extent of the body, and its waves over the largest.
_BENT, _WAVES = 0.2, 3.0
_SEED = 20_118

# What takes longer than this [s] is not measured twice.
_LONG = 60.0


@dataclass(frozen=True)
class Settings:
    """What to measure.

    Parameters
    ----------
    scene : Built-in scene or file; of its bodies' materials nu is kept.
    vertices : Numbers of vertices.
    E, rho : Young's moduli [Pa] and densities [kg/m^3]; all pairs.
    preconditioners : Some of `PRECONDITIONERS`.
    reduction : Of the residual.
    threads : CPU threads.
    """

    scene: str
    vertices: tuple[int, ...]
    E: tuple[float, ...] = (1e3, 1e4, 1e6, 1e8)
    rho: tuple[float, ...] = (1.0, 1000.0)
    preconditioners: tuple[str, ...] = PRECONDITIONERS
    reduction: float = 1e-2
    threads: int = 1

    def __post_init__(self) -> None:
        unknown = [name for name in self.preconditioners if name not in PRECONDITIONERS]
        if unknown or not self.preconditioners:
            raise InputError(
                "unknown preconditioner" if unknown else "nothing to measure",
                where="--preconditioners",
                found=", ".join(unknown) or "nothing",
                allowed=", ".join(PRECONDITIONERS),
            )
        for name, values in (("--vertices", self.vertices), ("--E", self.E), ("--rho", self.rho)):
            if not values or not all(value > 0.0 and np.isfinite(value) for value in values):
                raise InputError("not a list of positive numbers", where=name, found=values or "nothing")
        if not 0.0 < self.reduction < 1.0:
            raise InputError("not a reduction", where="--reduction", found=self.reduction, allowed="between 0 and 1")


@dataclass(frozen=True)
class Result:
    """One preconditioner on one system; times are CPU time of all threads.

    Parameters
    ----------
    vertices : Of the mesh.
    E, rho, state, preconditioner : Which system, which preconditioner.
    smooth, rough : Iterations with the weight and with random forces on the right; None: more than `MOST_ITERATIONS`.
    definite : Whether A was indefinite, and its elements' definite parts were taken.
    refresh : Time to make it ready [s].
    seconds : Time to solve with the weight on the right, ready or not [s].
    """

    vertices: int
    E: float
    rho: float
    state: str
    preconditioner: str
    smooth: int | None
    rough: int | None
    definite: bool
    refresh: float
    seconds: float


def bench_preconditioners(
    settings: Settings, on_result: Callable[[Result], None] = lambda result: None
) -> dict[str, Any]:
    """JSON-ready record of all systems; those of one mesh and preconditioner one after the other.

    Raises
    ------
    InputError
        The scene cannot be built.
    """
    results = []
    for result in _results(settings):
        results.append(result)
        on_result(result)
    about = {"machine": describe_machine(), "settings": asdict(settings)}
    return {"schema": SCHEMA, **about, "results": [asdict(result) for result in results]}


def _results(settings: Settings) -> Iterator[Result]:
    for vertices in settings.vertices:
        for name in settings.preconditioners:
            simulation = _simulation(settings, vertices, name)
            for E in settings.E:
                for rho in settings.rho:
                    yield from _measured(simulation, settings, name, E, rho)


def _simulation(settings: Settings, vertices: int, preconditioner: str) -> Simulation:
    solver = {"name": "newton-multigrid", "preconditioner": preconditioner, "threads": settings.threads}
    overrides = {f"solver.{key}": value for key, value in solver.items()}
    simulation = Simulation.prepare(load_scene(settings.scene, vertices=vertices, overrides=overrides))
    if len(np.unique(simulation.world.E)) > 1 or len(np.unique(simulation.world.rho)) > 1:
        raise InputError(
            "bodies of several materials", where=settings.scene, allowed="one E and one rho, which --E and --rho vary"
        )
    return simulation


def _measured(simulation: Simulation, settings: Settings, name: str, E: float, rho: float) -> Iterator[Result]:
    stepper, world, disc = simulation.stepper, simulation.world, simulation.disc
    assert isinstance(stepper, ImplicitMethod)
    assert isinstance(stepper.solver, Newton)
    X = disc.mesh.points
    # (rho M_1 / h^2 + E K_1) is a multiple of the same with the body's own E and rho and this h.
    h = simulation.frame_duration * np.sqrt(E / rho * world.rho[0] / world.E[0])
    potential = IncrementalPotential(stepper.backend, X, float(h))
    weight = disc.mass[disc.free, None] * np.array([0.1, 0.3, -1.0])
    forces = np.random.default_rng(_SEED).standard_normal(weight.shape)
    M = stepper.solver.preconditioner
    for state in STATES:
        x = X if state == "rest" else _bent(X, disc.free)
        refresh, _ = _timed(lambda x=x: M.refresh(potential, x))  # type: ignore[misc]
        seconds, smooth = _timed(lambda x=x: _solved(potential, M, x, weight, settings.reduction))  # type: ignore[misc]
        rough = _solved(potential, M, x, forces, settings.reduction)
        yield Result(
            disc.n_vertices,
            E,
            rho,
            state,
            name,
            _iterations(smooth[0], settings.reduction),
            _iterations(rough[0], settings.reduction),
            smooth[1] or rough[1],
            refresh,
            seconds,
        )


def _solved(
    potential: IncrementalPotential, M: Preconditioner, x: Floats, b: Floats, reduction: float
) -> tuple[Solution, bool]:
    """The solution of A d = b, and whether it needed the definite part of A."""
    backend = potential.backend
    for definite in (False, True):

        def product(p: Floats, definite: bool = definite) -> Floats:
            d = backend.zeros(len(x))
            backend.prolong(backend.vertices, p, d)
            return backend.nodal_product(backend.vertices, x, d, potential.inverse_h2, definite=definite)

        solution = solve(backend, product, M.apply, b, reduction, MOST_ITERATIONS)
        if solution.curvature:
            break
    return solution, definite


def _iterations(solution: Solution, reduction: float) -> int | None:
    return solution.iterations if solution.curvature and solution.reduction <= reduction else None


def _bent(X: Floats, free: NDArray[np.bool_]) -> Floats:
    """A smooth motion that turns and stretches; what is held stays."""
    extent = np.ptp(X, axis=0)
    moved = _BENT * extent.min() * np.sin(_WAVES * (X - X.min(axis=0))[:, [1, 2, 0]] / extent.max())
    return X + moved * free[:, None]


def _timed(call: Callable[[], Any]) -> tuple[float, Any]:
    """CPU time [s] of a call and what it returned; a short call is made twice, as the first one may compile."""
    seconds: list[float] = []
    while not seconds or (len(seconds) == 1 and seconds[0] < _LONG):
        began = time.process_time()
        out = call()
        seconds.append(time.process_time() - began)
    return min(seconds), out


def tables(record: dict[str, Any]) -> list[TextTable]:
    """Iterations and times, a table for each preconditioner."""
    return [_table(record, name) for name in record["settings"]["preconditioners"]]


def _table(record: dict[str, Any], name: str) -> TextTable:
    rows = []
    for row in record["results"]:
        if row["preconditioner"] != name:
            continue
        system = f"{row['vertices']} vertices, E = {row['E']:g} Pa, rho = {row['rho']:g} kg/m^3, {row['state']}"
        counts = [_count(row["smooth"]), _count(row["rough"])]
        times = [f"{1e3 * row[key]:.1f}" for key in ("refresh", "seconds")]
        rows.append((system, *counts, "yes" if row["definite"] else "", *times))
    heads = ("", "smooth", "rough", "indefinite", "refresh [ms]", "solve [ms]")
    most = _most([row for row in record["results"] if row["preconditioner"] == name])
    return TextTable(f"{name}: {most}", heads, tuple(rows))


def _most(rows: Sequence[dict[str, Any]]) -> str:
    counts = [row[key] for row in rows for key in ("smooth", "rough")]
    if None in counts:
        return f"more than {MOST_ITERATIONS} iterations in {counts.count(None)} of {len(counts)} systems"
    return f"at most {max(counts)} iterations"


def _count(iterations: int | None) -> str:
    return f"> {MOST_ITERATIONS}" if iterations is None else str(iterations)
