# SPDX-License-Identifier: BSD-3-Clause
"""Whole runs, as a user gets them: scene, plan, solver, energy check, output."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from femgal.runner import Progress
from femgal.runner import run as run_scene
from femgal.scene.model import Scene
from femgal.simulation import Simulation
from verify.benchmark.trajectory import trajectory_error
from verify.problems.moving_body import MovingBody
from verify.problems.scenes import as_problem, displacements_of, frames_of, hanging, simulation
from verify.reference.stepping import newton_backward_euler
from verify.suite.case import PRECISIONS, Kind, Measurement, case
from verify.suite.measure import compare, vanishes
from verify.suite.use import Use

Floats = NDArray[np.float64]

SOLVERS: dict[str, dict[str, Any]] = {
    "fas": {"name": "fas", "ratio": 8, "steps": "exact", "substeps": 20},
    "fas-linear": {"name": "fas", "transfer": "linear", "steps": "spectral", "substeps": 20},
    "jacobi": {"name": "jacobi", "steps": "spectral", "substeps": 20},
    "verlet": {"name": "verlet"},
    "fas-bdf2": {"name": "fas", "ratio": 8, "stepping": "bdf2", "substeps": 20},
    "newton-multigrid": {"name": "newton-multigrid", "substeps": 5},
    "mas": {"name": "newton-multigrid", "preconditioner": "mas", "substeps": 5},
    "v-cycle": {"name": "newton-multigrid", "preconditioner": "v-cycle", "substeps": 5},
    "vbd": {"name": "vbd", "iterations": 5, "substeps": 20},
}
IMPLICIT = ("fas", "fas-linear", "jacobi")

# Of the comparison with Newton: steps so long that one pass would be far from enough, solved to the end.
_NEWTON_SUBSTEPS = {"bar": 2, "bunny": 4}
_NEWTON_FRAMES = {"bar": 4, "bunny": 10}
_SOLVED = {"steps": "exact", "iterations": 20_000, "tolerance": 1e-13, "stepping": "backward-euler"}


@case(
    "system/newton",
    title="A run with implicit steps solved to the end is that of Newton's method with scikit-fem's Hessian",
    quantity="trajectory error over all frames: 4 of a small bar, 10 of the bunny",
    unit="1",
    kind=Kind.CROSS_CODE,
    formula="x_{n+1} = argmin |x - x_n - h v_n - h^2 g|^2_M / (2 h^2) + E(x), with 2 or 4 substeps per frame",
    source="verify/reference/newton.py: assembled by scikit-fem, masses too, and solved by a sparse direct solver",
    tolerance=1e-9,
    reason="substeps are solved to eps18 = 1e-13 m, and the body moves by centimetres",
    over={"mesh": ("bar", "bunny"), "solver": (*IMPLICIT, "newton-multigrid", "mas", "vbd")},
    quick={"mesh": ("bar",), "solver": ("fas-linear", "newton-multigrid")},
    requires="scikit-fem; the bunny's surface for its rows",
)
def newton(use: Use, *, mesh: str, solver: str) -> Measurement:
    """Through scene, plan and hierarchy on one side, by scikit-fem on the other; mesh and start are shared."""
    sim = simulation(_newton_scene(mesh, solver, _SOLVED), use)
    expected = _newton_displacements(mesh, use)
    return _distance(sim, displacements_of(sim), expected)


@case(
    "system/one-pass",
    title="How far one pass per substep, the default, is from the solution of the same steps",
    quantity="trajectory error over 10 frames of the bunny, 4 substeps per frame",
    unit="1",
    kind=Kind.CROSS_CODE,
    formula="the solver's own error; the error of the step length comes on top",
    source="verify/reference/newton.py",
    tolerance=None,
    reason="reported, not judged: the default has 50 to 100 substeps",
    over={"mesh": ("bunny",), "solver": IMPLICIT},
    quick=False,
    requires="scikit-fem; the bunny's surface",
)
def one_pass(use: Use, *, mesh: str, solver: str) -> Measurement:
    """With exact line searches, at steps that are longer than they should be."""
    sim = simulation(_newton_scene(mesh, solver, {"steps": "exact"}), use)
    return _distance(sim, displacements_of(sim), _newton_displacements(mesh, use))


@case(
    "system/single-precision",
    title="Element passes in single precision give the motion of double precision",
    quantity="trajectory error over 4 frames",
    unit="1",
    kind=Kind.REGRESSION,
    formula="|x_f32 - x_f64| / |x_f64 - X|, mass-weighted RMS",
    source="the same run with float64 passes, which the other rows verify",
    tolerance=1e-6,
    reason="forces round to 6e-8 of the largest element's; positions, velocities and sums stay in double precision",
    over={"mesh": ("beam", "rabbit", "bunny"), "solver": tuple(SOLVERS)},
    quick={"mesh": ("beam",), "solver": ("fas",)},
)
def single_precision(use: Use, *, mesh: str, solver: str) -> Measurement:
    """Of a body that begins to sag at rest, where displacements are small."""
    sim = simulation(hanging(mesh, 4, precision="float32", **SOLVERS[solver]), use)
    return _distance(sim, displacements_of(sim), _displacements(mesh, solver, "float64", use))


@case(
    "system/threads",
    title="The number of threads does not change a bit, however small their shares",
    quantity="largest difference of a position after 4 frames",
    unit="m",
    kind=Kind.IDENTITY,
    formula="x(2 threads) = x(3 threads) = x(1 thread)",
    source="elements are divided by a constant and sums are formed in order of index; shares of 16 rows",
    tolerance=0.0,
    reason="the same operations in the same order",
    over={"solver": tuple(SOLVERS), "threads": (2, 3), "precision": PRECISIONS},
    quick={"solver": ("fas",), "threads": (2,), "precision": ("float64",)},
)
def threads(use: Use, *, solver: str, threads: int, precision: str) -> Measurement:
    """On a mesh of several blocks of elements; 700 vertices would be one share, so the smallest share is lowered."""
    settings = {"precision": precision, **SOLVERS[solver]}
    with shares_of(16) as most:
        one, many = (displacements_of(simulation(hanging("rabbit", 4, **settings), use, n)) for n in (1, threads))
    if most[0] < threads:
        raise AssertionError(f"no pass was shared by {threads} threads: this scene proves nothing")
    return vanishes(many - one, 1.0)


@contextmanager
def shares_of(rows: int) -> Iterator[list[int]]:
    """Let ranges be shared out from so many rows on; the list holds the most shares of any range so far."""
    from femgal.kernels.cpu import threads

    before, run, most = threads.SMALLEST_SHARE, threads.Workers._run, [0]

    def counted(self: threads.Workers, kernel: Any, bounds: list[int], arguments: Any) -> None:
        if len(bounds) - 1 > most[0]:
            most[0] = len(bounds) - 1
        run(self, kernel, bounds, arguments)

    threads.SMALLEST_SHARE, threads.Workers._run = rows, counted  # type: ignore[method-assign]
    try:
        yield most
    finally:
        threads.SMALLEST_SHARE, threads.Workers._run = before, run  # type: ignore[method-assign]


@case(
    "system/kept-blocks",
    title="Keeping blocks over substeps changes less than a tenth of what the solver leaves undone",
    quantity="distance from the run with fresh blocks over that run's distance from the solved one",
    unit="1",
    kind=Kind.REGRESSION,
    formula="|x_auto - x_fresh| <= 0.1 |x_fresh - x_solved|, mass-weighted RMS over 4 frames",
    source="the promise of solver.blocks = auto; the solved run is the one of system/newton",
    tolerance=0.1,
    reason="the promise itself",
    over={"mesh": ("beam", "rabbit"), "solver": IMPLICIT},
    quick={"mesh": ("beam",), "solver": ("jacobi",)},
)
def kept_blocks(use: Use, *, mesh: str, solver: str) -> Measurement:
    """The note says how many passes with blocks were spared."""
    settings = SOLVERS[solver]
    fresh = simulation(hanging(mesh, 4, blocks="fresh", **settings), use)
    kept = simulation(hanging(mesh, 4, **settings), use)
    solved = simulation(hanging(mesh, 4, blocks="fresh", **{**settings, **_SOLVED}), use)
    made, wanted, right = (displacements_of(one) for one in (kept, fresh, solved))
    moved, left = (trajectory_error(kept.disc.mass, one, wanted) for one in (made, right))
    spared = 1.0 - kept.backend.passes.gradient_and_blocks / fresh.backend.passes.gradient_and_blocks
    return Measurement(moved, left, moved / left, f"{100.0 * spared:.0f} % of the passes with blocks spared")


@case(
    "system/energies",
    title="Energies that a run reports are those of its states",
    quantity="largest difference over the largest energy of any frame",
    unit="J",
    kind=Kind.CROSS_CODE,
    formula="kinetic sum m v^2 / 2, elastic sum of V Psi(F), potential - sum m g . x",
    source="scikit-fem's energy and lumped mass",
    tolerance=1e-12,
    reason="rounding of sums over elements",
    over={"solver": tuple(SOLVERS)},
    quick={"solver": ("fas", "verlet")},
)
def energies(use: Use, *, solver: str) -> Measurement:
    """Of the beam, frame by frame."""
    sim = simulation(hanging("beam", 4, **SOLVERS[solver]), use)
    body, g = MovingBody(*as_problem(sim)), sim.gravity
    found, expected = [], []
    for frame in frames_of(sim):
        x, v = frame.state.x, frame.state.v
        found.append([frame.row[f"{name}_energy"] for name in ("kinetic", "elastic", "potential")])
        expected.append([body.kinetic(v), body.elasticity.energy(x), -float(body.mass @ (x @ g))])
    # The potential energy may be counted from anywhere.
    return compare(np.array(found) - found[0], np.array(expected) - expected[0])


@case(
    "system/free-momentum",
    title="A strained free body keeps its momentum though no substep is solved to the end",
    quantity="largest change of the centre's velocity at any of 4 frames over the largest speed of a vertex",
    unit="m/s",
    kind=Kind.IDENTITY,
    formula="sum m v_n = sum m v_0",
    source="no force from outside; elastic forces of a body sum to zero",
    tolerance=1e-11,
    reason="rounding of positions, divided by h, over 20 to 80 substeps",
    over={"solver": tuple(name for name in SOLVERS if name != "verlet")},
    quick={"solver": ("fas", "newton-multigrid")},
)
def free_momentum(use: Use, *, solver: str) -> Measurement:
    """A beam pressed to three fifths of its height springs back while it flies; a stiff flight proves nothing."""
    scene = hanging("beam", 4, **SOLVERS[solver])
    velocity = [0.3, -0.2, 0.1]
    body = scene.bodies[0].model_dump() | {"velocity": velocity, "initial": {"kind": "flat", "thickness": 0.2}}
    free = scene.model_dump() | {"bodies": [body], "constraints": [], "gravity": [0.0, 0.0, 0.0]}
    sim = simulation(Scene.model_validate(free), use)
    v = np.stack([frame.state.v for frame in frames_of(sim)])
    mass = sim.disc.mass / sim.disc.mass.sum()
    centre = np.einsum("i,fij->fj", mass, v)
    speed = float(np.linalg.norm(v[1:] - centre[1:, None], axis=2).max())
    if not speed > 0.1:
        raise ValueError(f"the body hardly moves within itself ({speed:.3g} m/s): nothing is judged")
    return compare(centre, np.broadcast_to(velocity, centre.shape), speed)


@case(
    "system/damped-fall",
    title="A damped fall has the velocities of damped backward Euler",
    quantity="largest error of the velocity of a vertex at any of 6 frames over the largest velocity",
    unit="m/s",
    kind=Kind.CLOSED_FORM,
    formula="v_n = (g / alpha) (1 - (1 + alpha h)^-n)",
    source="(1 + alpha h) v_{n+1} = v_n + h g",
    tolerance=1e-11,
    reason="rounding of positions, divided by h, over 120 substeps",
    over={"solver": IMPLICIT},
    quick={"solver": ("fas",)},
)
def damped_fall(use: Use, *, solver: str) -> Measurement:
    """A free body under gravity with alpha = 3 1/s."""
    alpha, scene = 3.0, hanging("beam", 6, **SOLVERS[solver])
    sim = simulation(scene.model_copy(update={"constraints": (), "damping": alpha}), use)
    found = np.stack([frame.state.v for frame in frames_of(sim)])
    h = sim.frame_duration / 20
    n = 20 * np.arange(len(found))[:, None, None]
    expected = sim.gravity / alpha * (1.0 - (1.0 + alpha * h) ** -n)
    return compare(found, np.broadcast_to(expected, found.shape))


@case(
    "system/retake",
    title="A frame that was taken again is the one that its substeps give, without a trace of the failed attempts",
    quantity="largest difference of positions [m] and velocities [m/s] at the end of the frame",
    unit="m, m/s",
    kind=Kind.IDENTITY,
    formula="the state before the frame, stepped by hand with as many substeps as the run says it took",
    source="a rejected attempt leaves no state behind",
    tolerance=0.0,
    reason="the same operations on the same numbers",
)
def retake(use: Use) -> Measurement:
    """Long steps with spectral lengths, whose energy grows until they are short enough."""
    settings: dict[str, Any] = {"name": "fas", "ratio": 8, "steps": "spectral", "substeps": 1}
    sim, by_hand = (simulation(hanging("beam", 5, **settings), use) for _ in range(2))
    frames = frames_of(sim)
    taken_again = [frame.index for frame in frames if frame.row["retakes"]]
    if not taken_again:
        raise AssertionError("no frame was taken again: this scene proves nothing")
    differences = []
    for index in taken_again:
        S, state = frames[index].row["substeps"], frames[index - 1].state
        state, _ = by_hand.stepper.begin_frame(state, sim.frame_duration, S)
        for _ in range(S):
            state = by_hand.stepper.step(state, sim.frame_duration / S)
        after = frames[index].state
        differences.append([state.x - after.x, state.v - after.v])
    return vanishes(np.array(differences), 1.0, f"frames {', '.join(map(str, taken_again))} were taken again")


@case(
    "system/resume",
    title="A run that is stopped and resumed ends bit for bit where the uninterrupted one ends",
    quantity="largest difference of positions [m] and velocities [m/s] after 4 frames",
    unit="m, m/s",
    kind=Kind.IDENTITY,
    formula="stopped in frame 3, resumed from its folder = 4 frames at once",
    source="checkpoint.h5 holds all that the next frame depends on",
    tolerance=0.0,
    reason="the same operations on the same numbers",
    over={"solver": tuple(SOLVERS)},
    quick={"solver": ("verlet", "newton-multigrid")},
    requires="h5py",
)
def resume(use: Use, *, solver: str) -> Measurement:
    """Stopped by Ctrl-C in the middle of a frame, as `femgal run --resume` finds it."""
    scene = _of_run(hanging("beam", 4, **SOLVERS[solver]), use)
    with tempfile.TemporaryDirectory() as folder:
        _stopped(scene, Path(folder) / "stopped")
        resumed = run_scene(scene, Path(folder) / "stopped", resume=True).state
        whole = run_scene(scene, Path(folder) / "whole").state
    assert resumed is not None
    assert whole is not None
    return vanishes(np.stack([resumed.x - whole.x, resumed.v - whole.v]), 1.0)


@case(
    "system/written-frames",
    title="The file of a run holds the displacements of its frames",
    quantity="largest difference over the largest displacement",
    unit="m",
    kind=Kind.IDENTITY,
    formula="PointData/displacement at each step = x - X",
    source="VTKHDF 2.2, read with h5py alone",
    tolerance=6e-8,
    reason="the file holds single precision",
    requires="h5py",
)
def written_frames(use: Use) -> Measurement:
    """Four frames and the start of the beam."""
    import h5py

    scene = _of_run(hanging("beam", 4, **SOLVERS["fas"]), use)
    expected = np.concatenate([np.zeros((1, 200, 3)), _displacements("beam", "fas", "float64", use)])
    with tempfile.TemporaryDirectory() as folder:
        run_scene(scene, Path(folder) / "out")
        (path,) = (Path(folder) / "out").glob("*.vtkhdf")
        with h5py.File(path, "r") as file:
            steps = file["VTKHDF/Steps"]
            starts = steps["PointDataOffsets/displacement"][:].ravel()
            data = file["VTKHDF/PointData/displacement"][:]
            times = steps["Values"][:]
    assert np.allclose(times, np.arange(5) / 60.0)
    return compare(np.stack([data[k : k + 200] for k in starts]), expected)


def _distance(sim: Simulation, found: Floats, expected: Floats) -> Measurement:
    error = trajectory_error(sim.disc.mass, found, expected)
    return Measurement(float(np.abs(found).max()), float(np.abs(expected).max()), error)


def _newton_scene(mesh: str, solver: str, more: dict[str, Any]) -> Scene:
    settings = {**SOLVERS[solver], **more, "substeps": _NEWTON_SUBSTEPS[mesh]}
    return hanging(mesh, _NEWTON_FRAMES[mesh], **settings)


@cache
def _newton_displacements(mesh: str, use: Use) -> Floats:
    """Displacements [m] after each frame by the reference Newton, shape [frames, n, 3]."""
    sim = simulation(_newton_scene(mesh, "jacobi", {}), use)
    tets, material, state = as_problem(sim)
    step, S = newton_backward_euler().step, _NEWTON_SUBSTEPS[mesh]
    frames = []
    for _ in range(_NEWTON_FRAMES[mesh]):
        for _ in range(S):
            state = step(tets, material, state, sim.frame_duration / S)
        frames.append(state.x - tets.points)
    return np.stack(frames)


@cache
def _displacements(mesh: str, solver: str, precision: str, use: Use) -> Floats:
    return displacements_of(simulation(hanging(mesh, 4, precision=precision, **SOLVERS[solver]), use))


def _of_run(scene: Scene, use: Use) -> Scene:
    """The scene with the threads of the run, on a device that can run it."""
    return simulation(scene, use).scene


class _Pressed(KeyboardInterrupt):
    """A Ctrl-C of our own, told from the user's."""


class _Interrupt(Progress):
    """Presses Ctrl-C in the middle of a frame."""

    def __init__(self) -> None:
        self.frames = 0

    def frame(self, row: Any) -> None:
        """Count."""
        self.frames += 1

    def substep(self, substep: int, substeps: int) -> None:
        """Stop in the second half of frame 3; frame 0 is the start."""
        if self.frames == 3 and substep > substeps // 2:
            raise _Pressed


def _stopped(scene: Scene, out: Path) -> None:
    try:
        run_scene(scene, out, progress=cast(Progress, _Interrupt()))
    except _Pressed:
        return
    raise AssertionError("the run was not interrupted")
