# SPDX-License-Identifier: BSD-3-Clause
"""Substeps that follow from an accuracy, with a method and an estimator whose errors are known formulas.

1. The relative error of the whole motion stays below the accuracy, for errors that come at once and for errors that
   grow with time; one that is too coarse at first is taken again, and substeps fall where the error allows it.
2. It is the root mean square over frames of the error over that of the motion; of free bodies the centre of mass is
   taken out of the motion.
3. A frame is not taken again for ever: an error that no number of substeps makes smaller is accepted, and reported.
4. There are never fewer substeps than the method or the estimator asks for, and from frame to frame they at most double
   or halve.
5. All that the next frame depends on is in the state: a control made anew goes on identically.
6. A method that asks for the frame again gets it, without the estimator being asked.
7. What a motion is still gathering is expected: of a body let go at rest, in the first half of its way out, no more
   than it will swing; halfway to as much again where it moves evenly, and nothing where it turns back.
8. Errors whose phases grow steadily are met with nearly equal substeps, and a fifth more of them than the best choice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from femgal.timestep.control import MOST_RETAKES, SWINGING, AccuracyControl, size_ahead
from femgal.timestep.state import MotionState, least_substeps

MASS = np.array([1.0, 3.0])
V = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]])


class Host:
    """What a control asks of a backend."""

    disc = SimpleNamespace(mass=MASS)

    def copy(self, x):
        return x.copy()

    def to_host(self, x):
        return x

    def difference(self, x, y):
        return x - y

    def is_finite(self, x):
        return bool(np.isfinite(x).all())


@dataclass
class Drifting:
    """Moves with constant velocity; asks for `own` substeps, and once for more."""

    own: int = 1
    again: int | None = None

    def init(self, x0, v0):
        return MotionState(0.0, x0, v0)

    def begin_frame(self, state, duration, substeps=None):
        return state, substeps or max(self.own, least_substeps(state))

    def step(self, state, h):
        return replace(state, time=state.time + h, x=state.x + h * state.v)

    def end_frame(self, state, duration, substeps):
        wanted, self.again = self.again, None
        return state, wanted

    def residual(self, state):
        return None


@dataclass
class Known:
    """|e| = at_once / S^2 of the first frame, plus growth * (sum of h^2 so far)."""

    at_once: float = 0.0
    growth: float = 0.0
    floor: float = 0.0
    fewest: int = 1
    calls: list[int] = field(default_factory=list)

    def init(self, state):
        return {"e": np.zeros(1)}

    def begin_frame(self, state, substeps):
        pass

    def observe(self, state):
        pass

    def end_frame(self, memory, state, duration, substeps):
        self.calls.append(substeps)
        first = memory["e"][0] == 0.0
        e = memory["e"] + (self.at_once if first else 0.0) / substeps**2 + self.growth * duration / substeps**2
        return {"e": e}, float(e[0]) + self.floor


def control(estimator, accuracy=0.01, frames=20, stepper=None, **options):
    return AccuracyControl(stepper or Drifting(), estimator, accuracy, frames, Host(), **options)


def run(method, frames=20, state=None):
    """Substeps and state of each frame."""
    state = state or method.init(np.zeros((2, 3)), V)
    out = []
    for _ in range(frames):
        ready, substeps = method.begin_frame(state, 0.1)
        while True:
            after = ready
            for _ in range(substeps):
                after = method.step(after, 0.1 / substeps)
            after, wanted = method.end_frame(after, 0.1, substeps)
            if wanted is None:
                break
            ready, substeps = method.begin_frame(state, 0.1, wanted)
        state = after
        out.append((substeps, state))
    return out


@pytest.mark.parametrize("estimator", [Known(at_once=0.1), Known(growth=5.0), Known(at_once=0.02, growth=1.0)])
@pytest.mark.parametrize("accuracy", [0.1, 0.01, 0.001])
def test_the_promise_is_kept(estimator, accuracy):
    method = control(estimator, accuracy)
    frames = run(method)
    final = method.estimated_error(frames[-1][1])
    # What was lost at once is a hundredth of the motion by its end, and the first frame does not know that.
    assert 0.005 * accuracy < final <= accuracy
    assert all(b <= 2 * a and b >= a // 2 for (a, _), (b, _) in pairwise(frames))
    # An error that comes at once, to a motion that grows, lets the steps grow; one that goes on does not.
    assert estimator.growth or frames[-1][0] == 1


def test_the_error_is_relative_to_the_motion_of_all_frames():
    method = control(Known(floor=1e-3), frames=3)
    states = [state for _, state in run(method, 3)]
    moved = [math.sqrt(1.0 + 3.0 * 4.0) * 0.1 * k for k in (1, 2, 3)]
    expected = math.sqrt(3 * 1e-6 / sum(u**2 for u in moved))
    assert method.estimated_error(states[-1]) == pytest.approx(expected, rel=1e-12)
    centred = V - MASS @ V / MASS.sum()
    shrunk = math.sqrt(MASS @ (centred**2).sum(axis=1)) / math.sqrt(13.0)
    method = control(Known(floor=1e-3), frames=3, free=True)
    assert method.estimated_error(run(method, 3)[-1][1]) == pytest.approx(expected / shrunk, rel=1e-12)


def test_what_no_substeps_cure_is_accepted_and_reported():
    estimator = Known(floor=1.0)
    method = control(estimator, frames=2)
    frames = run(method, 2)
    assert len(estimator.calls) <= 2 * MOST_RETAKES
    assert method.estimated_error(frames[-1][1]) > 1.0


def test_the_method_and_the_estimator_may_ask_for_more():
    assert [substeps for substeps, _ in run(control(Known(fewest=4), stepper=Drifting(own=5)), 3)] == [5, 5, 5]
    assert [substeps for substeps, _ in run(control(Known(fewest=6), stepper=Drifting(own=5)), 3)] == [6, 6, 6]


def test_everything_is_in_the_state():
    whole = run(control(Known(at_once=0.05, growth=1.0)))
    first = run(control(Known(at_once=0.05, growth=1.0)), 7)
    rest = run(control(Known(at_once=0.05, growth=1.0)), 13, first[-1][1])
    assert [s for s, _ in whole] == [s for s, _ in first + rest]
    for name, array in whole[-1][1].memory.items():
        np.testing.assert_array_equal(array, rest[-1][1].memory[name])


def test_the_method_comes_first():
    estimator = Known()
    method = control(estimator, stepper=Drifting(again=7))
    assert run(method, 1)[0][0] == 7
    assert estimator.calls == [7]


@pytest.mark.parametrize("per_period", [8.0, 13.0, 25.0])
def test_what_a_swing_is_still_gathering(per_period):
    k = np.arange(1, 41)
    theta = 2.0 * math.pi * k / per_period
    u, steepness = 1.0 - np.cos(theta), theta / np.tan(0.5 * theta)
    for frame in np.flatnonzero((steepness > SWINGING) & (theta < math.pi)) + 1:
        left = len(k) - frame
        true = float((u[frame:] ** 2).sum()) / u[frame - 1] ** 2
        assert left <= size_ahead(steepness[frame - 1], frame, left) <= max(left, 1.05 * true)


def test_what_other_motions_are_still_gathering():
    # |u|^2 like t where |u| grows like t: halfway between that and staying as it is.
    assert size_ahead(1.0, 1, 19) == pytest.approx(sum(range(2, 21)))
    assert size_ahead(1.0, 10, 20) == pytest.approx(sum(k / 10 for k in range(11, 31)))
    # No step where one rule takes over from the other.
    assert size_ahead(SWINGING - 1e-6, 2, 19) == pytest.approx(size_ahead(SWINGING + 1e-6, 2, 19), rel=0.01)
    for steepness in (0.0, -3.0, 5.0, math.inf, math.nan):
        assert size_ahead(steepness, 2, 19) == 19.0


def test_steady_growth_is_met_with_nearly_equal_substeps():
    taken = [substeps for substeps, _ in run(control(Known(growth=5.0), frames=40), 40)]
    # |e_k| = 5 (0.1 k) / S^2 and |u_k| = sqrt(13) (0.1 k): R = 5 / (sqrt(13) S^2)
    best = math.sqrt(5.0 / math.sqrt(13.0) / 0.01)
    assert best < np.mean(taken) < 1.2 * best
    assert max(taken) < 2.0 * best
    # Nothing is left for the end: an error that was thought to grow more slowly would have to be made good there.
    assert all(b <= a for a, b in pairwise(taken[4:]))


def test_an_estimate_that_is_no_number_changes_no_substeps():
    method = control(Known(floor=math.nan), substeps=8)
    frames = run(method, 4)
    assert [substeps for substeps, _ in frames] == [8, 8, 8, 8]
    assert math.isnan(method.estimated_error(frames[-1][1]))
