# SPDX-License-Identifier: BSD-3-Clause
"""How exactly solvers step: single steps, small vibrations, and the order in time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from meshes.generators import box
from meshes.ordering import reorder
from verify.integrators.under_test import OWN_SOLVER, Material, Method, State, solver_under_test
from verify.problems import bodies
from verify.problems.moving_body import GRAVITY, MovingBody, twisted, uneven
from verify.reference.semidiscrete import exact_motion, modes
from verify.reference.stepping import newton_backward_euler
from verify.suite.case import Kind, Measurement, case
from verify.suite.measure import compare, order
from verify.suite.use import SEED, Use

Floats = NDArray[np.float64]

SOLVERS = (
    *("verlet", "fas", "fas-linear", "fas-bdf2", "newton-multigrid", "newton-multigrid-euler", "newton-multigrid-bdf2"),
    *("vbd", "vbd-explicit", "jacobi", "jacobi-explicit", "scalar-jacobi"),
    *("newton", "newton-bdf2", "newton-tr-bdf2"),
)
QUICK = {"solver": ("verlet", "fas", "fas-bdf2", "newton-multigrid", OWN_SOLVER)}

# Production's solvers of backward Euler's steps.
_EULER = (
    *("fas", "fas-linear", "newton-multigrid-euler"),
    *("vbd", "vbd-explicit", "jacobi", "jacobi-explicit", "scalar-jacobi"),
)

# Of the step over the period of the lowest mode: the highest one of the little bar is 26 times as fast, and explicit
# steps of it are stable.
_H = 5e-3
_VIBRATION_STEPS = 40

# Duration [s] and steps of the strained bar.
_PULL, _PULL_STEPS = 1e-2, 64

# Edges that sound goes along in a step, and sqrt(E / rho) [m/s] of a middling element of the uneven material.
_EDGES = {"short": 0.2, "long": 2.0}
_SPEED = 10.0


@case(
    "stepping/one-step",
    title="One step of backward Euler ends where Newton's method with scikit-fem's Hessian ends",
    quantity="largest distance of a vertex over the largest distance that elasticity moves one from the prediction",
    unit="m",
    kind=Kind.CROSS_CODE,
    formula="argmin |x - x_n - h v_n - h^2 g|^2_M / (2 h^2) + E(x)",
    source="verify/reference/newton.py: energy, gradient, Hessian and masses by scikit-fem; only the mesh is shared",
    tolerance=1e-8,
    reason="eps18 of 1e-13 of the size bounds the distance in the norm of the masses, which differ by a factor of 100",
    over={
        "solver": _EULER,
        "mesh": ("box", "rabbit", "bunny"),
        "step": ("short", "long"),
    },
    quick={
        "solver": tuple(name for name in (*_EULER, OWN_SOLVER) if name != "scalar-jacobi"),
        "mesh": ("box",),
        "step": ("long",),
    },
    requires="scikit-fem; the bunny's surface for its rows",
    own_solver=True,
)
def one_step(use: Use, *, solver: str, mesh: str, step: str) -> Measurement:
    """From a twisted, trembling state."""
    sut, body = solver_under_test(solver, use), launched(mesh)
    sut.promises("backward-euler")
    h = _EDGES[step] * bodies.mean_edge(body.mesh) / _SPEED
    expected = newton_step(mesh, h)
    start = body.start
    moved = expected.x - (start.x + h * start.v + h * h * start.gravity)
    moved[start.constrained] = 0.0
    found = sut.step(body.mesh, body.material, start, h)
    return compare(found.x, expected.x, float(np.abs(moved).max()))


@case(
    "stepping/frequency",
    title="A small vibration in the lowest mode has the frequency of the eigenvalue problem",
    quantity="relative error of the frequency over 40 steps of h omega = 0.07, in units of the method's own error",
    unit="1/s",
    kind=Kind.CROSS_CODE,
    formula=(
        "K phi = omega^2 M phi; own errors: (h omega)^2 / 24 of Verlet, (h omega)^2 / 3 of backward Euler and BDF2, "
        "(1/sqrt(2) - 2/3) (h omega)^2 of TR-BDF2"
    ),
    source="scikit-fem's Hessian at rest and lumped mass, dense symmetric eigenvalues (LAPACK); orders of the methods",
    tolerance=1.05,
    reason="the method's own error and terms of the next order; (h omega)^2 / 3 for a solver that names no method",
    over={"solver": SOLVERS},
    quick=QUICK,
    own_solver=True,
)
def frequency(use: Use, *, solver: str) -> Measurement:
    """By the recursion q_{n+1} = a q_n - b q_{n-1} that fits the amplitudes best: its roots turn by the phase."""
    omega, _ = lowest_mode()
    share = {"verlet": 1.0 / 24.0, "tr-bdf2": np.sqrt(0.5) - 2.0 / 3.0}
    own_error = (_H * omega) ** 2 * share.get(solver_under_test(solver, use).method or "", 1.0 / 3.0)
    # The parasitic root of a multistep method has died out after ten steps.
    q = amplitudes(solver, use)[10:]
    (a, b), *_ = np.linalg.lstsq(np.stack([q[1:-1], -q[:-2]], axis=1), q[2:], rcond=None)
    found = abs(np.angle(np.roots([1.0, -a, b])[0])) / _H
    return compare(found, omega, own_error * omega, f"relative error {found / omega - 1.0:.2g}")


@case(
    "stepping/strained",
    title="A strongly strained, struck body ends close to the exact motion after a short time",
    quantity="mass-weighted distance from the exact positions over the distance that elasticity moved them",
    unit="m",
    kind=Kind.ODE,
    formula="|x_64 - x(T)|_M / |x(T) - (x_0 + T v_0 + T^2 g / 2)|_M, T = 10 ms",
    source="x(T) of M x'' = M g - grad E by DOP853 at a relative tolerance of 1e-11",
    tolerance=0.05,
    reason="methods of first order err by some 1/64 to 3/64; another energy or material by tens of per cent",
    over={"solver": SOLVERS},
    quick=QUICK,
    own_solver=True,
)
def strained(use: Use, *, solver: str) -> Measurement:
    """Asked of every solver: small vibrations see the moduli alone, and laws of conservation no material at all."""
    sut, body, (exact, carried) = solver_under_test(solver, use), pulled(), after_a_pull()
    found = body.end(sut, _PULL / _PULL_STEPS, _PULL_STEPS)
    distance, moved = (np.sqrt(2.0 * body.kinetic(found.x - x)) for x in (exact, carried))
    scale = float(np.sqrt(2.0 * body.kinetic(exact - carried)))
    return Measurement(float(moved), scale, float(distance) / scale)


@case(
    "stepping/vibration",
    title="A small vibration loses amplitude and phase as the method's closed form says",
    quantity="largest error of the amplitude of the mode at any of 40 steps over the first amplitude",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula=(
        "q_n / q_0 = Re (1 - i h omega)^-n for backward Euler; cos n theta, sin(theta/2) = h omega / 2, for Verlet; "
        "BDF2: Re z_n, (1 - 2/3 i h omega) z_{n+1} = (4 z_n - z_{n-1}) / 3, z_1 = 1 / (1 - i h omega); TR-BDF2: "
        "z_{n+1} = R(i h omega) z_n, R(z) = (1 + (1 - 2d) z) / (1 - d z)^2, d = 1 - 1/sqrt(2), "
        "z_1 = R((1 - d) i h omega) / (1 - i d h omega)"
    ),
    source="the methods applied to q'' = -omega^2 q (Hairer & Wanner 1996, section IV.3)",
    tolerance=1e-5,
    reason="amplitudes of 1e-5 of the size: what is not linear is of that share",
    over={"solver": SOLVERS},
    quick=QUICK,
    own_solver=True,
)
def vibration(use: Use, *, solver: str) -> Measurement:
    """Started at rest in the shape of the lowest mode."""
    sut = solver_under_test(solver, use)
    expected = _CLOSED_FORMS[sut.promises(*_CLOSED_FORMS)](_H * lowest_mode()[0])
    return compare(amplitudes(solver, use), expected, 1.0)


@case(
    "stepping/order",
    title="The error at a fixed time falls with the power of h that the method has",
    quantity="observed order of the mass-weighted distance from the exact motion after a quarter of a period",
    unit="1",
    kind=Kind.ODE,
    formula="|x_N - x(T)|_M / |x(T) - x(0)|_M = C h^p with p = 1 for backward Euler, 2 for all others here",
    source="x(T) of M x'' = -grad E by DOP853 at a relative tolerance of 1e-11",
    tolerance=0.08,
    reason="terms of the next order at the steps here",
    over={"solver": tuple(name for name in SOLVERS if name != "newton")},
    quick=QUICK,
    own_solver=True,
)
def order_in_time(use: Use, *, solver: str) -> Measurement:
    """Of a bar that is struck so that its tip moves by a tenth of its length."""
    sut, body = solver_under_test(solver, use), struck()
    expected_order = sut.promised_order()
    exact, T = after_a_quarter()
    steps = (32, 64, 128) if expected_order == 1 or sut.method == "verlet" else (16, 32, 64)
    scale = np.sqrt(body.kinetic(exact.x - body.start.x))
    errors = [np.sqrt(body.kinetic(body.end(sut, T / n, n).x - exact.x)) / scale for n in steps]
    h = [T / n for n in steps]
    return order(h, errors, expected_order, x="step [s]", y="relative error", title=f"Order in time of {sut.name}")


@case(
    "stepping/energy-of-verlet",
    title="The energy of velocity Verlet errs with the square of the step and does not drift",
    quantity="observed order of the largest error of the energy over 0.2 s",
    unit="1",
    kind=Kind.IDENTITY,
    formula="max |T + E - (T_0 + E_0)| = O(h^2), for times that do not depend on h",
    source="Hairer, Lubich & Wanner 2006, section IX.3: the method keeps a nearby energy",
    tolerance=0.08,
    reason="terms of the next order at the steps here",
    over={"solver": ("verlet",)},
    quick={"solver": ("verlet", OWN_SOLVER)},
    own_solver=True,
)
def energy_of_verlet(use: Use, *, solver: str) -> Measurement:
    """Of the struck bar, with energies by scikit-fem."""
    sut, body, T, every = solver_under_test(solver, use), struck(), 0.2, 8
    sut.promises("verlet")
    errors = []
    for n in (80, 160, 320):
        states = body.states(sut, T / n, n)[:: every * n // 80]
        E = np.array([body.energy(state) for state in states])
        errors.append(float(np.abs(E / E[0] - 1.0).max()))
    h = [T / n for n in (80, 160, 320)]
    return order(h, errors, 2.0, x="step [s]", y="relative error of the energy", title="Energy of velocity Verlet")


@cache
def launched(mesh: str) -> MovingBody:
    """Held at the low end of x, twisted by half a radian, trembling, under gravity."""
    tets = bodies.mesh(mesh)
    constrained = bodies.left_end(tets, 0.1 * float(np.ptp(tets.points[:, 0])))
    v = 0.3 * bodies.rng(55).standard_normal(tets.points.shape)
    v[constrained] = 0.0
    return MovingBody(tets, uneven(tets), State(twisted(tets.points, 0.5), v, constrained, GRAVITY))


@cache
def newton_step(mesh: str, h: float) -> State:
    """Where the reference ends after one step."""
    body = launched(mesh)
    return newton_backward_euler().step(body.mesh, body.material, body.start, h)


@cache
def bar() -> MovingBody:
    """A little bar of 45 vertices at rest, held at one end."""
    mesh = reorder(box((0.4, 0.2, 0.2), (4, 2, 2), jitter=0.1, seed=SEED))[0]
    start = State(mesh.points.copy(), np.zeros_like(mesh.points), bodies.left_end(mesh))
    return MovingBody(mesh, Material.of(mesh, 1e5, 0.3, 1000.0), start)


@cache
def lowest_mode() -> tuple[float, Floats]:
    """omega [1/s] and phi, shape [n, 3], phi^T M phi = 1, of the bar."""
    body = bar()
    omega, phi = modes(body.mesh, body.material, body.start.constrained)
    return float(omega[0]), phi[0]


def shaped(a: float) -> Floats:
    """The lowest mode with a largest displacement of `a` times the size [m], shape [n, 3]."""
    _, phi = lowest_mode()
    return np.asarray(a * bar().size / float(np.abs(phi).max()) * phi, np.float64)


def amplitudes(solver: str, use: Use) -> Floats:
    """q_n / q_0 of a small vibration, shape [steps + 1]."""
    body, displacement = bar(), shaped(1e-5)
    vibrating = replace(body.start, x=body.start.x + displacement)
    sut = solver_under_test(solver, use)
    states = MovingBody(body.mesh, body.material, vibrating).states(sut, _H, _VIBRATION_STEPS)
    weight = body.mass[:, None] * displacement
    q = np.array([float((weight * (state.x - body.mesh.points)).sum()) for state in states])
    return q / q[0]


@cache
def struck() -> MovingBody:
    """The bar at rest in shape, moving in its lowest mode, so fast that its tip goes a tenth of its length."""
    body, (omega, _) = bar(), lowest_mode()
    return MovingBody(body.mesh, body.material, replace(body.start, v=omega * shaped(0.1)))


@cache
def after_a_quarter() -> tuple[State, float]:
    """The exact state of the struck bar after a quarter of a period, and that time [s]."""
    body, T = struck(), 0.5 * np.pi / lowest_mode()[0]
    return exact_motion(body.mesh, body.material, body.start, T), T


@cache
def pulled() -> MovingBody:
    """The bar of uneven material, longer by two fifths, twisted and struck, under gravity."""
    mesh, held = bar().mesh, bar().start.constrained
    X = mesh.points
    share = ((X[:, 0] - X[:, 0].min()) / np.ptp(X[:, 0]))[:, None]
    x = twisted(X, 0.6) + 0.4 * np.ptp(X[:, 0]) * share * [1.0, 0.0, 0.0]
    return MovingBody(mesh, uneven(mesh), State(x, share**2 * [0.0, 2.0, 0.0], held, GRAVITY))


@cache
def after_a_pull() -> tuple[Floats, Floats]:
    """Positions of the pulled bar at the end: exact ones, and those without elasticity, each of shape [n, 3]."""
    body = pulled()
    start = body.start
    exact = exact_motion(body.mesh, body.material, start, _PULL)
    carried = start.x + _PULL * start.v + 0.5 * _PULL**2 * start.gravity
    carried[start.constrained] = start.x[start.constrained]
    return exact.x, carried


def _of_verlet(z: float) -> Floats:
    return np.cos(2.0 * np.arcsin(0.5 * z) * np.arange(_VIBRATION_STEPS + 1))


def _of_backward_euler(z: float) -> Floats:
    return np.asarray(((1.0 - 1j * z) ** -np.arange(_VIBRATION_STEPS + 1.0)).real, np.float64)


def _of_bdf2(z: float) -> Floats:
    q = [1.0, 1.0 / (1.0 - 1j * z)]
    while len(q) <= _VIBRATION_STEPS:
        q.append((4.0 * q[-1] - q[-2]) / 3.0 / (1.0 - 2.0j * z / 3.0))
    return np.array(q).real


def _of_tr_bdf2(z: float) -> Floats:
    """By the stability function of its Runge-Kutta tableau."""
    d = 1.0 - np.sqrt(0.5)

    def factor(z: complex) -> complex:
        return (1.0 + (1.0 - 2.0 * d) * z) / (1.0 - d * z) ** 2

    first = factor((1.0 - d) * 1j * z) / (1.0 - d * 1j * z)
    return np.array([1.0, *(first * factor(1j * z) ** np.arange(_VIBRATION_STEPS)).real])


_CLOSED_FORMS: dict[Method, Callable[[float], Floats]] = {
    "verlet": _of_verlet,
    "backward-euler": _of_backward_euler,
    "bdf2": _of_bdf2,
    "tr-bdf2": _of_tr_bdf2,
}
