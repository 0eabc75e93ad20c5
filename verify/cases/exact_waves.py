# SPDX-License-Identifier: BSD-3-Clause
"""Time steps of finite-strain waves against the exact solutions of the discrete equations, and their order in time.

The waves move along one direction, which makes them linear at any amplitude (`verify.reference.straight_motion`), so
that each time-stepping method has a closed form. Rollers hold the other two directions.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.backend import Backend, Precision
from femgal.timestep.backward_euler import BackwardEuler
from femgal.timestep.state import MotionState, TimeStepper
from verify.problems.bodies import body
from verify.problems.rollers import on_rollers
from verify.problems.waves import (
    AMPLITUDE,
    SOLVERS,
    STOP,
    WAVES,
    Wave,
    build_solver,
    motion,
    standing_wave,
    straight_line_state,
    verlet,
)
from verify.reference.straight_motion import backward_euler_factor, modes, verlet_angle
from verify.suite.case import PRECISIONS, Kind, Measurement, case
from verify.suite.measure import compare, order
from verify.suite.use import Use

Floats = NDArray[np.float64]

_LINEAR = "motion along one direction is linear at any strain"

# The residual is an error of x in every step and one of h v that stays: forty steps squared, over the amplitude.
_STEPS = 40
_SOLVED = {precision: _STEPS**2 * stop / AMPLITUDE for precision, stop in STOP.items()}
_SOLVED_REASON = "the solver stops at a residual of 1e-13 m (1e-8 m in float32), and 40 steps add up 40^2 of them"


@case(
    "exact/wave-verlet",
    title="Velocity Verlet moves a wave of 38 % strain by its own exact phase per step",
    quantity="largest error of a position over the amplitude, 300 steps, 2.5 periods",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="x_n = x_0 cos(n theta), sin(theta / 2) = omega h / 2",
    source=_LINEAR + "; central differences on a harmonic",
    tolerance={"float64": 1e-11, "float32": 2e-5},
    reason="rounding of the forces, 300 steps long",
    over={"wave": WAVES, "precision": PRECISIONS},
)
def wave_verlet(use: Use, *, wave: str, precision: Precision) -> Measurement:
    """Positions of every vertex at every step."""
    one = standing_wave(wave)
    h = 2.0 * math.pi / one.omega / 120.0
    states = motion(verlet(on_rollers(use.backend(one.disc, precision), 0)), one.start, h, 300)
    factors = np.cos(verlet_angle(one.omega, h) * np.arange(301))
    return _against(one, states, factors)


@case(
    "exact/wave-backward-euler",
    title="Backward Euler moves a wave of 38 % strain with its own exact damping and phase",
    quantity="largest error of a position over the amplitude, 40 steps, one period",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="x_n = x_0 Re (1 - i omega h)^-n",
    source=_LINEAR + "; backward Euler on a harmonic",
    tolerance=_SOLVED,
    reason=_SOLVED_REASON,
    over={"wave": WAVES, "solver": SOLVERS, "precision": PRECISIONS},
    quick={"solver": ("fas",)},
)
def wave_backward_euler(use: Use, *, wave: str, solver: str, precision: Precision) -> Measurement:
    """Positions of every vertex at every step."""
    one = standing_wave(wave)
    h, states = _backward_euler(use, wave, solver, precision)
    return _against(one, states, np.real(backward_euler_factor(one.omega, h) ** np.arange(_STEPS + 1)))


@case(
    "exact/wave-damping",
    title="Backward Euler takes exactly the share 1 - 1 / (1 + omega^2 h^2) of the energy in each step",
    quantity="ratio of the energies after and before a step; its largest error",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="E_{n+1} / E_n = 1 / (1 + omega^2 h^2)",
    source="|1 / (1 - i omega h)|^2; the energy is quadratic: Psi = mu/2 |G|^2 + lam/2 G_1^2",
    tolerance=10.0 * _SOLVED["float64"],
    reason=_SOLVED_REASON + "; energies are squares, and the amplitude falls to six tenths",
    over={"wave": WAVES},
)
def wave_damping(use: Use, *, wave: str) -> Measurement:
    """Energies of production's energy pass and of the velocities."""
    one = standing_wave(wave)
    h, states = _backward_euler(use, wave, "fas", "float64")
    backend = use.backend(one.disc)
    energy = np.array(
        [0.5 * float(one.disc.mass @ (s.v**2).sum(axis=1)) + backend.energies(s.x)[0].sum() for s in states]
    )
    return compare(energy[1:] / energy[:-1], np.full(_STEPS, 1.0 / (1.0 + (one.omega * h) ** 2)), 1.0)


@case(
    "exact/wave-phase",
    title="Backward Euler delays a wave by atan(omega h) in place of omega h per step",
    quantity="phase per step; its largest error over the phase",
    unit="rad",
    kind=Kind.CLOSED_FORM,
    formula="arg z_{n+1} - arg z_n = atan(omega h), z = omega x - i v",
    source="arg 1 / (1 - i omega h)",
    tolerance=100.0 * _SOLVED["float64"],
    reason=_SOLVED_REASON + "; one step's phase is a sixth of a radian, a hundredth of what is added up",
    over={"wave": WAVES},
)
def wave_phase(use: Use, *, wave: str) -> Measurement:
    """Phase of displacement and velocity where the wave is highest."""
    one = standing_wave(wave)
    h, states = _backward_euler(use, wave, "fas", "float64")
    vertex = int(np.argmax(one.shape[:, 0]))
    u = np.array([s.x[vertex, 0] for s in states]) - one.disc.mesh.points[vertex, 0]
    v = np.array([s.v[vertex, 0] for s in states])
    z = one.omega * u - 1j * v
    return compare(np.angle(z[1:] / z[:-1]), np.full(_STEPS, math.atan(one.omega * h)))


@case(
    "exact/any-body-backward-euler",
    title="Backward Euler damps and turns every mode of any body by its own factor, at finite strain",
    quantity="largest error of a position over the largest displacement, ten steps",
    unit="1",
    kind=Kind.IDENTITY,
    formula="x_n = sum over modes of q_k Re (1 - i omega_k h)^-n, omega_k of K q = omega^2 M q",
    source=_LINEAR + "; modes by a dense eigensolver",
    tolerance=1e-9,
    reason="10^2 residuals of 1e-13 m over displacements of 0.03 m, three times",
    over={"mesh": ("box", "rabbit")},
    quick={"mesh": ("box",)},
)
def any_body_backward_euler(use: Use, *, mesh: str) -> Measurement:
    """Sum over modes of a body of varied material."""

    def factors(omega: Floats, h: float) -> Floats:
        return np.real(backward_euler_factor(omega, h)[None] ** np.arange(11)[:, None])

    def stepper(backend: Backend) -> TimeStepper:
        return _euler(backend, "chebyshev", STOP["float64"])

    return _modal(use, mesh, 3.0, stepper, factors)


@case(
    "exact/any-body-verlet",
    title="Velocity Verlet turns every mode of any body by its own phase, at finite strain and 0.95 of the stable step",
    quantity="largest error of a position over the largest displacement, ten steps",
    unit="1",
    kind=Kind.IDENTITY,
    formula="x_n = sum over modes of q_k cos(n theta_k), sin(theta_k / 2) = omega_k h / 2",
    source=_LINEAR + "; modes by a dense eigensolver",
    tolerance=1e-11,
    reason="rounding of forces and of the dense modes, over ten steps near the stability limit",
    over={"mesh": ("box", "rabbit")},
    quick={"mesh": ("box",)},
)
def any_body_verlet(use: Use, *, mesh: str) -> Measurement:
    """Sum over modes of a body of varied material."""

    def factors(omega: Floats, h: float) -> Floats:
        return np.cos(verlet_angle(omega, h)[None] * np.arange(11)[:, None])

    return _modal(use, mesh, 1.9, verlet, factors)


@case(
    "exact/time-order",
    title="Velocity Verlet converges in time with order 2, backward Euler with order 1",
    quantity="order of the largest error over one period of a wave of 38 % strain",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="x = x_0 cos(omega t), omega of the mesh",
    source=_LINEAR,
    tolerance=0.1,
    reason="the next term of the error at 320 steps a period",
    over={"method": ("verlet", "backward-euler")},
)
def time_order(use: Use, *, method: str) -> Measurement:
    """Longitudinal wave; sequences of 80, 160 and 320 steps."""
    one = standing_wave("longitudinal")
    steps = (80, 160, 320)
    period = 2.0 * math.pi / one.omega
    errors = []
    for n in steps:
        backend = on_rollers(use.backend(one.disc), 0)
        stepper = verlet(backend) if method == "verlet" else _euler(backend, "chebyshev", 1e-9)
        factors = np.cos(one.omega * period / n * np.arange(n + 1))
        errors.append(_against(one, motion(stepper, one.start, period / n, n), factors).error)
    h, expected = [period / n for n in steps], 2.0 if method == "verlet" else 1.0
    return order(h, errors, expected, x="step [s]", y="largest error over amplitude", title=f"Order in time: {method}")


def _euler(backend: Backend, solver: str, stop: float) -> BackwardEuler:
    return BackwardEuler(backend, build_solver(solver, backend, stop), 1, np.zeros(3))


def _modal(
    use: Use, mesh: str, omega_h: float, stepper: Callable[[Backend], TimeStepper], factors: Callable[..., Floats]
) -> Measurement:
    """Ten steps with omega_h = omega_max h against the sum over modes."""
    disc = body(mesh)
    omega, shapes = _modes(mesh)
    h = omega_h / float(omega.max())
    start = straight_line_state(disc)
    q = shapes.T @ (disc.mass * (start - disc.mesh.points)[:, 0])
    states = motion(stepper(on_rollers(use.backend(disc), 0)), start, h, 10)
    expected = (factors(omega, h) * q) @ shapes.T
    return compare(np.array([(s.x - disc.mesh.points)[:, 0] for s in states]), expected)


@cache
def _modes(mesh: str) -> tuple[Floats, Floats]:
    return modes(body(mesh))


@cache
def _backward_euler(use: Use, kind: str, solver: str, precision: Precision) -> tuple[float, list[MotionState]]:
    """Step [s] and states over one period, forty steps."""
    one = standing_wave(kind)
    backend = on_rollers(use.backend(one.disc, precision), 0)
    h = 2.0 * math.pi / one.omega / _STEPS
    return h, motion(_euler(backend, solver, STOP[precision]), one.start, h, _STEPS)


def _against(one: Wave, states: list[MotionState], factors: Floats) -> Measurement:
    """All positions over time against shape times factor."""
    computed = np.array([state.x - one.disc.mesh.points for state in states])
    return compare(computed / AMPLITUDE, factors[:, None, None] * one.shape, 1.0)
