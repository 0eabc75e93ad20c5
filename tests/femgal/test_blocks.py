# SPDX-License-Identifier: BSD-3-Clause
"""Blocks kept over several substeps.

1. Schedule: where blocks are made at every substep, one substep in PROBE_EVERY keeps them and the next one compares;
   the interval doubles while old blocks change little, stays while they change just little enough, halves beyond, and
   falls back to every substep.
2. With fixed step lengths a large change of any block shortens the interval whatever it does to the corrections.
3. Stale terms and largest change equal a direct evaluation with dense inverses.
4. A soft body keeps its blocks for many substeps, and most passes are gradients alone; its motion differs from
   that with fresh blocks by less than a tenth of the solver's own error.
5. A body that deforms strongly refreshes often, with exact and spectral steps, and stays within the same bound.
6. What is remembered is all that counts: a motion cut in two, its memory copied, has the same bits.
7. Substeps that meet a tolerance before anything is smoothed neither stop the schedule nor break it.
8. Another length of the step forgets the blocks.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from femgal.hierarchy.hierarchy import build_constant_hierarchy
from femgal.kernels.cpu.backend import CpuBackend
from femgal.solvers.blocks import LONGEST_INTERVAL, MOST_CHANGE, PROBE_EVERY, SHARE, KeptBlocks
from femgal.solvers.fas import FAS
from femgal.solvers.solver import Budget
from femgal.timestep.backward_euler import BackwardEuler
from femgal.timestep.state import MotionState
from verify.problems.bodies import Moving, distorted_box, left_end, march, rng, uniform
from verify.reference.newton import ReferenceNewton
from verify.reference.transfer import unpacked

MESH = distorted_box((6, 3, 3))
HELD = left_end(MESH)
GRAVITY = np.array([0.0, 0.0, -9.81])
H0, G0 = np.array([[2.0, 0, 0, 2, 0, 2]]), np.ones((1, 3))


class Judged:
    """A backend whose comparison says what a test wants."""

    def __init__(self, stale: float, change: float = 0.0) -> None:
        self.verdict = (stale, change)

    def compare_blocks(self, g, old, H, *, scalar):
        return self.verdict


def substep(memory: dict, stale: float, change: float = 0.0, fixed: bool = False) -> tuple[dict, KeptBlocks]:
    """One substep of a one-layer solver with 1 J left to gain."""
    kept = KeptBlocks.remembered(memory, fixed)
    if kept.holds and kept.get(0) is None:
        kept.put(Judged(stale, change), 0, G0, H0, scalar=False)
    if kept.compares:
        kept.judge(1.0)
    refreshed = kept.refreshes
    kept.finish()
    kept.refreshed = refreshed
    return kept.into(memory), kept


def intervals(n: int, stale: float, change: float = 0.0, fixed: bool = False) -> list[int]:
    memory, seen = {}, []
    for _ in range(n):
        memory, kept = substep(memory, stale, change, fixed)
        seen.append(kept.interval)
    return seen


def test_unchanged_blocks_are_kept_longest():
    assert set(intervals(2 * LONGEST_INTERVAL + 200, 0.0)) == {2**k for k in range(LONGEST_INTERVAL.bit_length())}
    assert intervals(2 * LONGEST_INTERVAL + 200, 0.0)[-1] == LONGEST_INTERVAL


def test_changing_blocks_are_made_at_every_substep():
    memory, held = {}, []
    for _ in range(5 * PROBE_EVERY):
        memory, kept = substep(memory, 2.0 * SHARE**2)
        assert kept.interval == 1
        held.append("blocks_of_layer_0" in memory)
    # Kept after one substep in PROBE_EVERY, for the comparison in the next.
    assert sum(held) == 5
    assert np.diff(np.flatnonzero(held)).tolist() == [PROBE_EVERY] * 4


@pytest.mark.parametrize(
    ("stale", "change", "fixed", "then"),
    [
        (0.2, 0.0, False, 16),
        (0.3, 0.0, False, 8),
        (1.0, 0.0, False, 8),
        (1.1, 0.0, False, 4),
        (0.2, 10.0, False, 16),
        (0.2, 0.4, True, 16),
        (0.2, 0.9, True, 8),
        (0.2, 1.1, True, 4),
    ],
)
def test_verdicts(stale, change, fixed, then):
    kept = KeptBlocks(fixed, {0: H0}, age=8, interval=8)
    kept.put(Judged(stale * SHARE**2, change * MOST_CHANGE), 0, G0, H0, scalar=False)
    kept.judge(1.0)
    assert kept.interval == then
    kept.finish()
    assert kept.age == 1


def test_age_and_use():
    memory = {}
    refreshed = []
    for _ in range(12):
        memory, kept = substep(memory, 0.5 * SHARE**2)
        refreshed.append(kept.refreshed)
    assert refreshed == [True] * 12
    kept = KeptBlocks(False, {0: H0}, age=1, interval=4)
    memory, refreshed = kept.into({}), []
    for _ in range(9):
        memory, kept = substep(memory, 0.5 * SHARE**2)
        refreshed.append(kept.refreshed)
    assert refreshed == [False, False, False, True] * 2 + [False]


@pytest.mark.parametrize("scalar", [False, True])
def test_comparison(scalar):
    backend = CpuBackend(uniform(MESH), 1)
    A = rng(400).standard_normal((50, 3, 3))
    new = A @ A.transpose(0, 2, 1) + np.eye(3)
    old = new + 0.1 * np.eye(3) * rng(401).random((50, 1, 1))
    packed = [(m[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]).copy() for m in (old, new)]
    g = rng(402).standard_normal((50, 3))
    stale, change = backend.compare_blocks(g, *packed, scalar=scalar)
    used = [np.einsum("kij,ij->kij", m, np.eye(3)) if scalar else m for m in (old, new)]
    d = np.linalg.solve(used[0], g[..., None]) - np.linalg.solve(used[1], g[..., None])
    np.testing.assert_array_equal(unpacked(packed[1]), new)
    assert stale == pytest.approx(float((d * (new @ d)).sum()), rel=1e-10)
    size = np.trace(new, axis1=1, axis2=2) / 3.0
    assert change == pytest.approx(float((np.linalg.norm(old - new, axis=(1, 2)) / size).max()), rel=1e-10)


def stepper(E: float, steps: str, keep: bool, motions: tuple = ()) -> BackwardEuler:
    disc = uniform(MESH, HELD, E)
    layers = build_constant_hierarchy(disc, 8).layers
    backend = CpuBackend(disc, 1, layers[0])
    held = Moving(HELD, MESH.points[HELD])
    return BackwardEuler(backend, FAS(backend, layers, steps, keep_blocks=keep), 1, GRAVITY, motions=(held, *motions))


def start(method: BackwardEuler, h: float, speed: float) -> MotionState:
    v = np.zeros_like(MESH.points)
    v[:, 2] = -speed * (MESH.points[:, 0] - MESH.points[:, 0].min())
    return method.begin_frame(method.init(MESH.points.copy(), v), h)[0]


# E [Pa], speed [1/s], steps of 1 ms.
MOTIONS = {"soft": (1e4, 0.2, 200), "whipped": (2e4, 25.0, 100)}


@cache
def motion(name: str, steps: str, keep: bool) -> tuple[list[MotionState], dict]:
    E, speed, n = MOTIONS[name]
    method = stepper(E, steps, keep)
    states = march(method, start(method, 1e-3, speed), 1e-3, n)
    return states, method.backend.passes.as_dict()


@cache
def converged(name: str) -> np.ndarray:
    """The same steps, each solved to the end."""
    E, speed, _ = MOTIONS[name]
    method = stepper(E, "exact", False)
    method.solver = ReferenceNewton(method.backend.disc, tolerance=1e-9)
    return march(method, method.init(MESH.points.copy(), start(method, 1e-3, speed).v), 1e-3, 40)[-1].x


def distance(x: np.ndarray, y: np.ndarray) -> float:
    return float(np.sqrt(((x - y) ** 2).sum(axis=1).mean()))


@pytest.mark.parametrize("name", MOTIONS)
@pytest.mark.parametrize("steps", ["exact", "spectral"])
def test_motion_changes_less_than_the_solver_errs(name, steps):
    kept, fresh = motion(name, steps, True)[0], motion(name, steps, False)[0]
    own = distance(fresh[40].x, converged(name))
    changed = distance(kept[40].x, fresh[40].x)
    assert 0.0 < changed <= SHARE * own


def test_soft_body_keeps_its_blocks():
    states, passes = motion("soft", "exact", True)
    assert states[-1].memory["blocks_schedule"][1] >= 16
    assert passes["gradient"] >= 3.0 * passes["gradient_and_blocks"]
    assert motion("soft", "exact", False)[1]["gradient"] == 0.0


@pytest.mark.parametrize("steps", ["exact", "spectral"])
def test_whipped_body_refreshes_often(steps):
    states, _ = motion("whipped", steps, True)
    assert min(int(s.memory["blocks_schedule"][1]) for s in states[20:]) <= LONGEST_INTERVAL // 8
    assert np.isfinite(states[-1].x).all()


def test_memory_is_all_that_counts():
    whole, _ = motion("whipped", "spectral", True)
    method = stepper(MOTIONS["whipped"][0], "spectral", True)
    cut = whole[47]
    memory = {name: array.copy() for name, array in cut.memory.items()}
    again = march(method, MotionState(cut.time, cut.x.copy(), cut.v.copy(), memory), 1e-3, 40)
    assert again[-1].x.tobytes() == whole[87].x.tobytes()
    assert again[-1].v.tobytes() == whole[87].v.tobytes()


def test_substeps_that_need_no_smoothing():
    method = stepper(1e4, "exact", True)
    method.gravity = 0.0 * GRAVITY
    method.solver.budget = Budget(iterations=5, tolerance=1e-7)
    state = start(method, 1e-3, 0.0)
    for _ in range(2 * PROBE_EVERY):
        # A body at rest meets any tolerance before the first sweep.
        state = method.step(state, 1e-3)
    age, _ = state.memory["blocks_schedule"]
    assert 0 <= age <= PROBE_EVERY
    method.gravity = GRAVITY
    method.solver.budget = Budget(iterations=2)
    held = []
    for _ in range(PROBE_EVERY + 4):
        state = method.step(state, 1e-3)
        held.append("blocks_of_layer_0" in state.memory)
    assert any(held)
    method.gravity, method.solver.budget = 0.0 * GRAVITY, Budget(iterations=2, tolerance=1.0)
    for _ in range(2 * LONGEST_INTERVAL):
        state = method.step(state, 1e-3)
    assert np.isfinite(state.x).all()


def test_another_step_forgets():
    method = stepper(1e4, "exact", True)
    state = motion("soft", "exact", True)[0][-1]
    assert "blocks_of_layer_0" in state.memory
    same, _ = method.begin_frame(state, 1e-3)
    assert "blocks_of_layer_0" in same.memory
    other, _ = method.begin_frame(state, 0.5e-3)
    assert not any(name.startswith("blocks") for name in other.memory)
