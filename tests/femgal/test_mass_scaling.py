# SPDX-License-Identifier: BSD-3-Clause
"""Selective mass scaling.

1. The step promised is stable: omega_max of M'^-1 K (dense) is at most 2 / step; free and held, uniform and varied
   bodies, slivers, shares from a thousandth to a doubling.
2. The whole share is spent, never more, and a larger one gives a longer step.
3. As little as can be: only vertices below the bound gain, and all of these end exactly at it; none loses, and
   constrained ones gain nothing.
4. What is reported is what was done: kilograms, shares, vertices, steps; all of them JSON-ready.
5. No connected part gains more than the share, though it is a small one beside a heavy one.
6. A density per element that gives the same step adds more.
7. `share_for` a step gives that step back.
8. More than 5 % is warned of, less is not.
9. Added mass is heavy: a free fall remains the exact parabola and leaves no stress.
10. Linear and angular momentum and the energy of a scaled body are kept.
11. With 1 % of added mass and a third of the steps the motion is that of the true body within 1.5 %.
"""

from __future__ import annotations

import json

import numpy as np
import pytest

from femgal.diagnostics import energies_of
from femgal.discretisation import Discretisation, discretise
from femgal.kernels.cpu.backend import CpuBackend
from femgal.timestep.mass_scaling import added_mass, scale_mass, share_for
from femgal.timestep.stable_step import guaranteed_step
from femgal.timestep.velocity_verlet import VelocityVerlet
from meshes.types import TetMesh
from tests.femgal.slivers import box_with_slivers, largest_frequency, stiffness_matrix, stiffnesses
from verify.problems.bodies import distorted_box, left_end, rng, uniform, varied

BOX, SLIVERS = distorted_box((5, 3, 3)), box_with_slivers(1e-2, 3)
BODIES = {
    "uniform": uniform(BOX),
    "varied": varied(BOX),
    "held": varied(BOX, left_end(BOX, 0.15)),
    "slivers": uniform(SLIVERS),
    "held slivers": varied(SLIVERS, left_end(SLIVERS)),
}
SHARES = (1e-3, 0.03, 1.0)
GRAVITY = np.array([0.5, 0.0, -9.81])


def scaled(disc: Discretisation, share: float):
    return scale_mass(disc, stiffnesses(disc)[1], share)


@pytest.mark.parametrize("name", BODIES)
def test_promised_step_is_stable(name):
    disc, K = BODIES[name], stiffness_matrix(BODIES[name])
    frequencies = [largest_frequency(disc, K)]
    for share in SHARES:
        heavy, scaling = scaled(disc, share)
        frequencies.append(largest_frequency(heavy, K))
        assert frequencies[-1] <= 2.0 / scaling.step * (1.0 + 1e-10)
    assert (np.diff(frequencies) < 0.0).all()


@pytest.mark.parametrize("name", BODIES)
def test_share_is_spent(name):
    found = [scaled(BODIES[name], share)[1] for share in SHARES]
    for share, scaling in zip(SHARES, found, strict=True):
        assert share * (1.0 - 1e-6) <= scaling.largest_share <= share * (1.0 + 1e-12)
    steps = [found[0].step_before, *(scaling.step for scaling in found)]
    assert (np.diff(steps) > 0.0).all()


@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize("name", BODIES)
def test_as_little_as_can_be(name, share):
    disc = BODIES[name]
    heavy, scaling = scaled(disc, share)
    _, k = stiffnesses(disc)
    gained = heavy.mass > disc.mass
    assert (heavy.mass[~gained] == disc.mass[~gained]).all()
    assert (gained <= disc.free).all()
    limit = (2.0 / scaling.step) ** 2
    np.testing.assert_allclose((k / heavy.mass)[gained], limit, rtol=1e-9)
    assert ((k / disc.mass)[gained] > limit * (1.0 - 1e-9)).all()
    assert ((k / disc.mass)[~gained] <= limit * (1.0 + 1e-9)).all()
    for name in ("B", "V", "mu", "lam", "Vmu", "Vlam", "free"):
        assert getattr(heavy, name) is getattr(disc, name)


@pytest.mark.parametrize("name", BODIES)
def test_report(name):
    disc = BODIES[name]
    heavy, scaling = scaled(disc, 0.03)
    _, k = stiffnesses(disc)
    assert scaling.added == pytest.approx(heavy.mass.sum() - disc.mass.sum(), rel=1e-9)
    assert scaling.mass == disc.mass.sum()
    assert scaling.vertices == (heavy.mass > disc.mass).sum()
    assert (scaling.step_before, scaling.step) == (guaranteed_step(k, disc.mass), guaranteed_step(k, heavy.mass))
    read = json.loads(json.dumps(scaling.as_dict()))
    assert read["share"] == pytest.approx(0.03, rel=1e-6)
    assert set(read) == {"added", "mass", "largest_share", "vertices", "step_before", "step", "share"}
    assert f"{scaling.added:.4g} kg (3 %) added at {scaling.vertices} vertices" in str(scaling)


def test_no_part_gains_more():
    second = BOX.points * 0.2 + [2.0, 0.0, 0.0]
    mesh = TetMesh(np.vstack([BOX.points, second]), np.vstack([BOX.cells, BOX.cells + len(BOX.points)]))
    rho = np.repeat([1000.0, 10.0], len(BOX.cells))
    disc = discretise(mesh, 1e5, 0.4, rho)
    heavy, scaling = scaled(disc, 0.02)
    half = len(BOX.points)
    shares = [(heavy.mass[part].sum() / disc.mass[part].sum()) - 1.0 for part in (slice(0, half), slice(half, None))]
    assert shares[0] == 0.0  # the small light part has by far the faster elements
    assert shares[1] == pytest.approx(0.02, rel=1e-6)
    assert scaling.largest_share == pytest.approx(0.02, rel=1e-6)
    assert scaling.as_dict()["share"] < 1e-5


@pytest.mark.parametrize(("name", "longer"), [("uniform", 1.05), ("slivers", 2.0)])
def test_densities_of_elements_would_add_more(name, longer):
    disc = BODIES[name]
    stiffness, k = stiffnesses(disc)
    step = longer * guaranteed_step(k, disc.mass)
    needed = added_mass(k, disc.mass, step).sum()
    # An element's own step is long enough when rho V / 4 >= step^2 lambda_e / 4.
    by_element = np.maximum(step**2 * stiffness - 1000.0 * disc.V, 0.0).sum()
    assert 0.0 < needed <= 0.5 * by_element


@pytest.mark.parametrize("share", SHARES)
def test_share_for_a_step(share):
    disc = BODIES["varied"]
    _, k = stiffnesses(disc)
    step = scaled(disc, share)[1].step
    assert share_for(disc, k, step) == pytest.approx(share, rel=1e-6)


@pytest.mark.parametrize(("share", "warned"), [(0.04, False), (0.06, True)])
def test_large_shares_are_warned_of(share, warned):
    warning = scaled(BODIES["uniform"], share)[1].warning
    assert (warning is not None) == warned
    if warning:
        assert "6 %" in warning
        assert "solver.mass_scaling" in warning


def test_nothing_moves():
    disc = uniform(BOX, np.arange(len(BOX.points)))
    heavy, scaling = scaled(disc, 0.5)
    np.testing.assert_array_equal(heavy.mass, disc.mass)
    assert (scaling.added, scaling.vertices) == (0.0, 0)


def march(disc: Discretisation, v0: np.ndarray, duration: float, gravity=GRAVITY):
    """States of a Verlet run at the step it chooses."""
    stepper = VelocityVerlet(CpuBackend(disc, 1), gravity)
    state = stepper.init(disc.mesh.points, v0)
    state, steps = stepper.begin_frame(state, duration)
    states = [state]
    for _ in range(steps):
        states.append(stepper.step(states[-1], duration / steps))
    return stepper, states


def test_free_fall_is_exact():
    disc = scaled(BODIES["slivers"], 0.3)[0]
    v0, t = np.array([1.0, -2.0, 3.0]), 0.5
    stepper, states = march(disc, np.tile(v0, (disc.n_vertices, 1)), t)
    X = disc.mesh.points
    np.testing.assert_allclose(states[-1].x, X + t * v0 + 0.5 * t**2 * GRAVITY, rtol=0, atol=1e-9)
    assert energies_of(stepper.backend, states[-1], GRAVITY)[0].elastic <= 1e-9


def swirl(disc: Discretisation, speed: float) -> np.ndarray:
    X = disc.mesh.points
    return speed * (X - X.mean(axis=0)) @ rng(320).standard_normal((3, 3)).T


def test_momenta_and_energy_are_kept():
    disc = scaled(BODIES["slivers"], 0.05)[0]
    stepper, states = march(disc, swirl(disc, 1.0), 0.2)
    first, last = states[0], states[-1]
    scale = float(disc.mass @ np.linalg.norm(first.v, axis=1))
    m = disc.mass[:, None]
    fallen = disc.mass.sum() * GRAVITY * 0.2
    assert np.abs((m * (last.v - first.v)).sum(axis=0) - fallen).max() <= 1e-11 * scale

    def spin(state) -> np.ndarray:
        centre = disc.mass @ state.x / disc.mass.sum()
        return (m * np.cross(state.x - centre, state.v)).sum(axis=0)

    assert np.abs(spin(last) - spin(first)).max() <= 1e-11 * scale
    energies = [energies_of(stepper.backend, state, GRAVITY)[0] for state in states]
    totals = np.array([energy.total for energy in energies])
    assert np.abs(totals - totals[0]).max() <= 0.01 * energies[0].kinetic
    assert max(energy.elastic for energy in energies) >= 0.1 * energies[0].kinetic


def test_motion_is_that_of_the_true_body():
    disc = uniform(box_with_slivers(1e-2))
    heavy, scaling = scaled(disc, 0.01)
    assert scaling.step >= 3.0 * scaling.step_before
    ends, steps = [], []
    for body in (disc, heavy):
        _, states = march(body, swirl(body, 1.0), 0.1, np.zeros(3))
        ends.append(states[-1].x)
        steps.append(len(states) - 1)
    assert steps[0] >= 2.5 * steps[1]
    moved = np.linalg.norm(ends[0] - disc.mesh.points)
    assert np.linalg.norm(ends[1] - ends[0]) <= 0.015 * moved
