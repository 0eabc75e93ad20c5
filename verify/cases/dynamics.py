# SPDX-License-Identifier: BSD-3-Clause
"""Laws that the motion of any solver has to obey, and the discrete laws of the methods that femgal has."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from femgal.output.checkpoint import load_checkpoint, save_checkpoint
from verify.integrators.under_test import OWN_SOLVER, Method, SolverUnderTest, State, solver_under_test
from verify.problems.moving_body import (
    GRAVITY,
    MovingBody,
    falling,
    held_and_loaded,
    resting,
    rotation,
    tumbling,
    turned,
)
from verify.suite.case import Kind, Measurement, case
from verify.suite.measure import at_most, compare, vanishes
from verify.suite.use import Use

Floats = NDArray[np.float64]

# For each law: what everybody is held to, and the references that cost seconds.
SOLVERS = (
    *("verlet", "fas", "fas-linear", "fas-bdf2", "newton-multigrid", "newton-multigrid-euler"),
    *("vbd", "vbd-explicit", "jacobi", "jacobi-explicit", "scalar-jacobi"),
)
WITH_REFERENCES = (*SOLVERS, "newton", "newton-bdf2", "newton-tr-bdf2")
QUICK = {"solver": ("verlet", "fas", "fas-linear", "fas-bdf2", "newton-multigrid", "vbd", OWN_SOLVER)}
BACKWARD_EULER = ("fas", "fas-linear", "newton-multigrid-euler", "vbd", "jacobi", "newton")
QUICK_EULER = {"solver": ("fas", "newton-multigrid-euler", "vbd", OWN_SOLVER)}

# Below the stable step of the bodies here, so that explicit solvers can be judged too; 20 ms turn the body by 11
# degrees and let its fastest vibration swing four times.
_H, _STEPS = 1e-3, 20
_SOLVED = "implicit steps are solved to 1e-13 of the size, and the velocities divide that by h"


@case(
    "dynamics/free-fall",
    title="A body that falls freely follows the method's own parabola",
    quantity="largest distance of a vertex from it at any of 50 steps, over the length of the fall",
    unit="m",
    kind=Kind.CLOSED_FORM,
    formula=(
        "x_n = x_0 + n h v_0 + h^2 g (n^2/2 + c_n); c_n = 0 for Verlet, n/2 for backward Euler, "
        "(3/4)(1 - 3^-n) for BDF2 started by backward Euler, d^2/2 with d = 1 - 1/sqrt(2) for TR-BDF2 after d h of it"
    ),
    source="the recursions of the methods with a constant force, solved by hand",
    tolerance=1e-10,
    reason="rounding of positions of 1 m in 50 steps, against a fall of 12 mm; TR-BDF2 divides it by h^2 / 12 in each",
    over={"solver": WITH_REFERENCES},
    quick=QUICK,
    own_solver=True,
)
def free_fall(use: Use, *, solver: str) -> Measurement:
    """Thrown under gravity, at rest in its own frame."""
    sut, body, h, steps = solver_under_test(solver, use), falling(), _H, 50
    more = _FALLS[sut.promises(*_FALLS)]
    found = np.stack([state.x for state in body.states(sut, h, steps)])
    n = np.arange(steps + 1)[:, None, None]
    c = np.array([more(k) for k in range(steps + 1)])[:, None, None]
    expected = body.start.x + n * h * body.start.v + h * h * (n * n / 2.0 + c) * GRAVITY
    return compare(found, expected, 0.5 * (steps * h) ** 2 * 9.81)


@case(
    "dynamics/rest",
    title="A body at rest without load stays where it is, held or free, however it is turned",
    quantity="largest displacement of a vertex after 20 steps over the size of the body",
    unit="m",
    kind=Kind.IDENTITY,
    formula="grad E(Q X + d) = 0, so x_n = Q X + d",
    source="P(F) = mu F + (lam (J - 1) - mu) cof F vanishes at every rotation F = Q (Smith et al. 2018, Eq. 13)",
    tolerance=1e-13,
    reason="rounding of forces that cancel, over 20 steps",
    over={"solver": SOLVERS, "held": ("held", "free")},
    quick=QUICK,
    own_solver=True,
)
def rest(use: Use, *, solver: str, held: str) -> Measurement:
    """Twenty steps of doing nothing, by a solver that does move what should move."""
    tumbling().states(solver_under_test(solver, use), _H, _STEPS)
    body = turned(resting(held == "held"), rotation(), np.array([0.3, -0.7, 0.2]))
    end = body.end(solver_under_test(solver, use), _H, _STEPS)
    return vanishes(end.x - body.start.x, body.size)


@case(
    "dynamics/constrained",
    title="Constrained vertices of a body that shakes and sags do not move at all",
    quantity="largest change of a position [m] or velocity [m/s] of a constrained vertex in 20 steps",
    unit="m, m/s",
    kind=Kind.IDENTITY,
    formula="x_i(t) = x_i(0), v_i = 0",
    source="the constraint itself",
    tolerance=0.0,
    reason="nothing is computed for these vertices",
    over={"solver": WITH_REFERENCES},
    quick=QUICK,
    own_solver=True,
)
def constrained(use: Use, *, solver: str) -> Measurement:
    """Twenty steps under gravity."""
    body = held_and_loaded()
    fixed, start = body.start.constrained, body.start
    states = body.states(solver_under_test(solver, use), _H, _STEPS)
    moved = [np.stack([state.x[fixed] - start.x[fixed], state.v[fixed]]) for state in states]
    return vanishes(np.stack(moved), 1.0)


@case(
    "dynamics/linear-momentum",
    title="Without force from outside the linear momentum stays the same",
    quantity="largest change of sum m v at any of 20 steps over sum m |v|",
    unit="kg m/s",
    kind=Kind.IDENTITY,
    formula="sum m v_n = sum m v_0",
    source="the elastic energy does not change under translations, so its forces sum to zero (Noether)",
    tolerance=1e-11,
    reason=_SOLVED,
    over={"solver": WITH_REFERENCES},
    quick=QUICK,
    own_solver=True,
)
def linear_momentum(use: Use, *, solver: str) -> Measurement:
    """Of a body that tumbles."""
    body = tumbling()
    found = [body.momentum(state) for state in body.states(solver_under_test(solver, use), _H, _STEPS)]
    scale = float(body.mass @ np.linalg.norm(body.start.v, axis=1))
    return compare(np.stack(found), np.broadcast_to(found[0], (len(found), 3)), scale)


@case(
    "dynamics/centre-of-mass",
    title="Without force from outside the centre of mass moves on a straight line at its first speed",
    quantity="largest distance from it at any of 20 steps over the size of the body",
    unit="m",
    kind=Kind.IDENTITY,
    formula="sum m x_n / sum m = sum m (x_0 + n h v_0) / sum m",
    source="the sum of the method's equations over the vertices",
    tolerance=1e-13,
    reason="rounding of positions, and the tolerance of implicit steps",
    over={"solver": WITH_REFERENCES},
    quick=QUICK,
    own_solver=True,
)
def centre_of_mass(use: Use, *, solver: str) -> Measurement:
    """Of a body that tumbles."""
    body = tumbling()
    found = np.stack([body.centre(state) for state in body.states(solver_under_test(solver, use), _H, _STEPS)])
    v = body.momentum(body.start) / body.mass.sum()
    return compare(found, found[0] + np.arange(_STEPS + 1)[:, None] * _H * v, body.size)


@case(
    "dynamics/angular-momentum-loss",
    title="Backward Euler loses exactly the angular momentum that its identity says",
    quantity="largest departure from the identity in any of 20 steps over the largest sum m |x| |v|",
    unit="kg m^2/s",
    kind=Kind.IDENTITY,
    formula="L_{n+1} - L_n = h sum m v_{n+1} x v_n",
    source="x_n = x_{n+1} - h v_{n+1}, and internal forces have no moment about any point",
    tolerance=1e-11,
    reason=_SOLVED,
    over={"solver": BACKWARD_EULER},
    quick=QUICK_EULER,
    own_solver=True,
)
def angular_momentum_loss(use: Use, *, solver: str) -> Measurement:
    """Of a body that tumbles."""
    sut, body = solver_under_test(solver, use), tumbling()
    sut.promises("backward-euler")
    states = body.states(sut, _H, _STEPS)
    L = np.stack([body.angular_momentum(state) for state in states])
    loss = np.stack([_H * body.mass @ np.cross(b.v, a.v) for a, b in pairwise(states)])
    lost = np.linalg.norm(L[-1] - L[0]) / np.linalg.norm(L[0])
    return compare(np.diff(L, axis=0), loss, _moments(body), f"{lost:.2g} of it is lost in {_STEPS} steps")


@case(
    "dynamics/angular-momentum",
    title="Velocity Verlet keeps the angular momentum",
    quantity="largest change at any of 20 steps over sum m |x| |v|",
    unit="kg m^2/s",
    kind=Kind.IDENTITY,
    formula="sum m x_n x v_n = sum m x_0 x v_0",
    source="kicks have no moment, and drifts move each vertex along its velocity",
    tolerance=1e-13,
    reason="rounding of 20 steps",
    over={"solver": ("verlet",)},
    quick={"solver": ("verlet", OWN_SOLVER)},
    own_solver=True,
)
def angular_momentum(use: Use, *, solver: str) -> Measurement:
    """Of a body that tumbles."""
    sut, body = solver_under_test(solver, use), tumbling()
    sut.promises("verlet")
    L = np.stack([body.angular_momentum(state) for state in body.states(sut, _H, _STEPS)])
    return compare(L, np.broadcast_to(L[0], L.shape), _moments(body))


@case(
    "dynamics/reversible",
    title="Velocity Verlet goes back to where it came from when the velocities are turned round",
    quantity="largest distance from the start after 20 steps there and 20 back, over the size",
    unit="m",
    kind=Kind.IDENTITY,
    formula="x(-v, -v) = start: the method is symmetric in time",
    source="Hairer, Lubich & Wanner 2006, section I.3.1",
    tolerance=1e-12,
    reason="rounding of 40 steps, which the motion itself magnifies",
    over={"solver": ("verlet",)},
    quick={"solver": ("verlet", OWN_SOLVER)},
    own_solver=True,
)
def reversible(use: Use, *, solver: str) -> Measurement:
    """Of a body that tumbles."""
    sut, body = solver_under_test(solver, use), tumbling()
    sut.promises("verlet")
    there = body.states(sut, _H, _STEPS)[-1]
    back = replace(body.start, x=there.x, v=-there.v)
    end = MovingBody(body.mesh, body.material, back).end(sut, _H, _STEPS)
    return compare(end.x, body.start.x, body.size)


@case(
    "dynamics/turned-start",
    title="Turning and moving the whole start turns and moves the whole motion, and nothing else",
    quantity="largest distance of a vertex from the turned motion after 20 steps over the size",
    unit="m",
    kind=Kind.IDENTITY,
    formula="x_n(Q x_0 + d, Q v_0, Q g) = Q x_n + d",
    source="frame indifference of the energy, Psi(Q F) = Psi(F)",
    tolerance=1e-11,
    reason="both motions are solved to 1e-13 of the size in each step; errors add up and swing",
    over={"solver": SOLVERS},
    quick=QUICK,
    own_solver=True,
)
def turned_start(use: Use, *, solver: str) -> Measurement:
    """Under gravity, which turns too; the rest shape does not turn, so every F is another one."""
    sut, body, d, Q = solver_under_test(solver, use), held_and_loaded(), np.array([0.3, -0.7, 0.2]), rotation()
    found = turned(body, Q, d).end(sut, _H, _STEPS)
    return compare(found.x, body.states(sut, _H, _STEPS)[-1].x @ Q.T + d, body.size)


@case(
    "dynamics/energy-inequality",
    title="In every step backward Euler loses at least the kinetic energy of the change of velocity",
    quantity="largest excess in any of 20 steps over the first energy",
    unit="J",
    kind=Kind.IDENTITY,
    formula="E(x_{n+1}) + |v_{n+1} - v_n|^2_M / 2 <= E(x_n) + |v_n|^2_M / 2",
    source="phi(x_{n+1}) <= phi(x_n) for the incremental potential, written with velocities; no load",
    tolerance=1e-12,
    reason="rounding of energies summed over 600 elements",
    over={"solver": BACKWARD_EULER, "step": ("short", "long")},
    quick={**QUICK_EULER, "step": ("short",)},
    own_solver=True,
)
def energy_inequality(use: Use, *, solver: str, step: str) -> Measurement:
    """Of a twisted body that tumbles, with energies by scikit-fem; the long step is the sixtieth of a second."""
    sut, body = solver_under_test(solver, use), tumbling()
    sut.promises("backward-euler")
    h, steps = {"short": (_H, _STEPS), "long": (1.0 / 60.0, 5)}[step]
    states = body.states(sut, h, steps)
    before = [body.energy(state) for state in states[:-1]]
    after = [body.elasticity.energy(b.x) + body.kinetic(b.v - a.v) for a, b in pairwise(states)]
    return _worst_excess(after, before)


@case(
    "dynamics/energy-decay",
    title="Without load the energy of a backward Euler motion falls in every step, by no less than theory says",
    quantity="largest excess in any of 20 steps over the first energy",
    unit="J",
    kind=Kind.IDENTITY,
    formula="T_{n+1} + E_{n+1} + |v_{n+1} - v_n|^2_M / 2 <= T_n + E_n where E is convex between the two states",
    source="E(x_n) >= E(x_{n+1}) + grad E(x_{n+1}) . (x_n - x_{n+1}) and M (v_{n+1} - v_n) = -h grad E(x_{n+1})",
    tolerance=1e-12,
    reason="rounding of energies summed over 600 elements",
    over={"solver": BACKWARD_EULER},
    quick=QUICK_EULER,
    own_solver=True,
)
def energy_decay(use: Use, *, solver: str) -> Measurement:
    """The body trembles with strains of a few per cent, where its energy is convex but for rotations."""
    sut, body = solver_under_test(solver, use), trembling()
    sut.promises("backward-euler")
    states = body.states(sut, _H, _STEPS)
    E = [body.energy(state) for state in states]
    lost = [body.kinetic(b.v - a.v) for a, b in pairwise(states)]
    note = f"{E[-1] / E[0]:.3f} of the energy is left after {_STEPS} steps"
    return _worst_excess([e + d for e, d in zip(E[1:], lost, strict=True)], E[:-1], note)


@case(
    "dynamics/restart",
    title="A motion that goes on from a checkpoint is bit for bit the one that did not stop",
    quantity="largest difference of positions [m] and velocities [m/s] after 20 steps",
    unit="m, m/s",
    kind=Kind.IDENTITY,
    formula="ten steps, checkpoint.h5, ten steps = twenty steps",
    source="the state is everything that the next step depends on",
    tolerance=0.0,
    reason="the checkpoint holds every bit",
    over={"solver": SOLVERS},
    quick=QUICK,
    requires="h5py",
    own_solver=True,
)
def restart(use: Use, *, solver: str) -> Measurement:
    """The second half is taken by a solver that was built anew."""
    body = held_and_loaded()
    whole = body.states(solver_under_test(solver, use), _H, _STEPS)
    loaded = _through_checkpoint(whole[_STEPS // 2])
    fresh = _built_anew(solver, use)
    end = MovingBody(body.mesh, body.material, loaded).end(fresh, _H, _STEPS - _STEPS // 2)
    return vanishes(np.stack([end.x - whole[-1].x, end.v - whole[-1].v]), 1.0)


# How far each method falls beyond g t^2 / 2 in n steps, over h^2 g.
_FALLS: dict[Method, Callable[[int], float]] = {
    "verlet": lambda n: 0.0,
    "backward-euler": lambda n: n / 2,
    "bdf2": lambda n: 0.75 * (1.0 - 3.0**-n),
    "tr-bdf2": lambda n: 0.5 * (1.0 - np.sqrt(0.5)) ** 2 if n else 0.0,
}


def trembling() -> MovingBody:
    """Held at one end, near its rest shape, without load."""
    body = held_and_loaded()
    return MovingBody(body.mesh, body.material, replace(body.start, x=body.mesh.points.copy(), gravity=np.zeros(3)))


def _through_checkpoint(state: State) -> State:
    arrays = {"x": state.x, "v": state.v, **{f"memory/{name}": array for name, array in state.memory.items()}}
    with tempfile.TemporaryDirectory() as folder:
        save_checkpoint(Path(folder), arrays, {"fingerprint": "dynamics/restart"})
        loaded, _ = load_checkpoint(Path(folder))
    memory = {name.removeprefix("memory/"): array for name, array in loaded.items() if name.startswith("memory/")}
    return replace(state, x=loaded["x"], v=loaded["v"], memory=memory)


def _built_anew(solver: str, use: Use) -> SolverUnderTest:
    """One that has seen no step yet; a user's function is what it is."""
    return solver_under_test.__wrapped__(solver, use)


def _moments(body: MovingBody) -> float:
    x, v = body.start.x, body.start.v
    return float(body.mass @ (np.linalg.norm(x, axis=1) * np.linalg.norm(v, axis=1)))


def _worst_excess(after: list[float], before: list[float], note: str = "") -> Measurement:
    """Of one list over the other, relative to the first entry."""
    worst = int(np.argmax(np.subtract(after, before)))
    found = at_most(after[worst], before[worst], note)
    return replace(found, error=found.error * abs(before[worst]) / abs(before[0]))
