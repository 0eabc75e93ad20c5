# SPDX-License-Identifier: BSD-3-Clause
"""Runs a scene and keeps what comes out of it: series, run log, checkpoints."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from femgal.failure import SolverFailure
from femgal.frame import Frame, Stopped
from femgal.output.checkpoint import load_checkpoint, save_checkpoint
from femgal.output.fields import find_field
from femgal.output.folder import SCENE_FILE, has_checkpoint, locked, prepare_output
from femgal.output.runlog import RunLog
from femgal.output.series import SeriesWriter, open_series
from femgal.scene.load import load_scene
from femgal.scene.model import Scene
from femgal.scene.write import scene_to_toml
from femgal.simulation import Simulation
from femgal.timestep.state import MotionState
from meshes.errors import InputError

Floats = NDArray[np.float64]
Status = Literal["finished", "interrupted", "failed"]


class Progress:
    """Told what a run is doing; this one keeps quiet."""

    def announce(self, text: str) -> None:
        """Something is being built or compiled."""

    def start(self, simulation: Simulation, first_frame: int) -> None:
        """The first frame is about to be solved."""

    def substep(self, substep: int, substeps: int) -> None:
        """One substep of the present frame is done."""

    def frame(self, row: Mapping[str, Any]) -> None:
        """A frame is done."""


class _Careful(Progress):
    """Passes everything on until that fails: a closed terminal ends the telling, not the run."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def _tell(self, what: str, *arguments: Any) -> None:
        try:
            getattr(self._progress, what)(*arguments)
        except OSError:
            self._progress = Progress()

    def announce(self, text: str) -> None:
        self._tell("announce", text)

    def start(self, simulation: Simulation, first_frame: int) -> None:
        self._tell("start", simulation, first_frame)

    def substep(self, substep: int, substeps: int) -> None:
        self._tell("substep", substep, substeps)

    def frame(self, row: Mapping[str, Any]) -> None:
        self._tell("frame", row)


@dataclass(eq=False)
class RunResult:
    """How a run ended.

    Parameters
    ----------
    status : "finished", "interrupted" (by the user, with a checkpoint), or "failed" (good frames kept).
    simulation : The scene as it was run.
    state : State at the last good frame; None when there was none.
    rows : One dict per frame computed in this call, as in run.json.
    displacements : x - X [m] per frame computed in this call, each of shape [n, 3]; only kept when nothing is written.
    out : Output folder, None when nothing was written.
    failure : What went wrong, None unless failed.
    """

    status: Status
    simulation: Simulation
    state: MotionState | None = None
    rows: list[dict[str, Any]] = field(default_factory=list)
    displacements: list[Floats] = field(default_factory=list)
    out: Path | None = None
    failure: SolverFailure | OSError | None = None

    @property
    def estimated_error(self) -> float | None:
        """Estimated relative trajectory error of all frames; None where no accuracy was asked for."""
        return self.rows[-1].get("estimated_error") if self.rows else None


def run(
    scene: Scene | str | Path,
    out: Path | str | None = None,
    *,
    resume: bool = False,
    progress: Progress | None = None,
    signals: bool = False,
) -> RunResult:
    """Solve a scene.

    Parameters
    ----------
    scene : A scene, the name of a built-in one, or the path of a scene file.
    out : Folder for the series, run.json and checkpoints; None keeps the displacements in the result instead.
    resume : Go on with the run in `out` from its last checkpoint, bit for bit as if it had not stopped.
    progress : Told what is being done.
    signals : Take Ctrl-C and SIGTERM as the wish to stop after a checkpoint, and return. By default they do what they
        always do; KeyboardInterrupt passes through after the checkpoint.

    Raises
    ------
    InputError
        The scene or the folder cannot be used. Nothing has been lost or overwritten.
    """
    scene = scene if isinstance(scene, Scene) else load_scene(scene)
    progress = _Careful(progress or Progress())
    if out is None:
        return _Run(Simulation.prepare(scene, progress.announce), progress, None, signals).go(None)
    with _folder(Path(out), resume) as folder:
        simulation = Simulation.prepare(scene, progress.announce)
        point = _Point.load(folder, simulation) if resume and has_checkpoint(folder) else None
        try:
            recorder = _Recorder(folder, simulation, point)
        except OSError as error:
            advice = "free some space, or choose another --out"
            raise InputError("the run cannot be begun", where=str(folder), found=error, advice=advice) from error
        return _Run(simulation, progress, recorder, signals).go(point)


@contextlib.contextmanager
def _folder(out: Path, resume: bool) -> Iterator[Path]:
    """The output folder, locked; one that was made for nothing is removed again."""
    existed = out.exists()
    folder = prepare_output(out, resume=resume)
    try:
        with locked(folder):
            yield folder
    except BaseException:
        if not existed:
            with contextlib.suppress(OSError):
                folder.rmdir()
        raise


@dataclass(frozen=True)
class _Point:
    """A checkpoint: frame, state, and the energy guard's memory."""

    frame: int
    state: MotionState
    guard: dict[str, Any]

    @classmethod
    def load(cls, folder: Path, simulation: Simulation) -> _Point:
        arrays, meta = load_checkpoint(folder, fingerprint=simulation.fingerprint)
        wanted = _series_settings(simulation)
        if meta["series"] != wanted:
            raise InputError(
                "the series was begun with other output settings",
                where=str(folder),
                found=", ".join(f"{key} = {value}" for key, value in wanted.items() if meta["series"][key] != value),
                allowed=", ".join(f"{key} = {value}" for key, value in meta["series"].items()),
                advice="resume with the settings it was begun with, or choose another --out",
            )
        memory = {name.removeprefix("memory/"): a for name, a in arrays.items() if name.startswith("memory/")}
        return cls(meta["frame"], MotionState(meta["time"], arrays["x"], arrays["v"], memory), meta["guard"])

    def save(self, folder: Path, simulation: Simulation) -> None:
        home = simulation.backend.to_host
        memory = {f"memory/{name}": home(array) for name, array in self.state.memory.items()}
        meta = {
            "fingerprint": simulation.fingerprint,
            "series": _series_settings(simulation),
            "frame": self.frame,
            "time": self.state.time,
            "guard": self.guard,
        }
        save_checkpoint(folder, {"x": self.state.x, "v": self.state.v, **memory}, meta)


def _series_settings(simulation: Simulation) -> dict[str, Any]:
    """What must stay the same for frames to be added to a series."""
    return simulation.scene.output.model_dump(mode="json", include={"format", "every", "fields"})


class _Recorder:
    """Writes the frames of one run into its folder."""

    def __init__(self, folder: Path, simulation: Simulation, point: _Point | None) -> None:
        self.folder, self._simulation = folder, simulation
        self._every = simulation.scene.output.every
        self._saved: int | None = point.frame if point else None
        kept = None if point is None else point.frame + 1
        if kept is None:
            self.log = RunLog.create(folder, _header(simulation))
            (folder / SCENE_FILE).write_text(scene_to_toml(simulation.scene), encoding="utf-8")
        static_point, static_cell = simulation.static_fields()
        self._series: SeriesWriter = open_series(
            folder,
            simulation.world.mesh,
            format=simulation.scene.output.format,
            static_cell_data=static_cell,
            static_point_data=static_point,
            resume_frames=None if kept is None else 1 + (kept - 1) // self._every,
        )
        # Last, so that a series which cannot be resumed leaves the log as it is.
        if kept is not None:
            self.log = RunLog.resume(folder, kept)

    def record(self, frame: Frame) -> None:
        """Write a frame: the series first, so that the log never promises a frame that is not there."""
        if frame.index % self._every == 0:
            point: dict[str, NDArray[Any]] = {}
            cell: dict[str, NDArray[Any]] = {}
            for name, values in frame.fields.items():
                entry = find_field(name)
                (point if entry and entry.kind == "point" else cell)[name] = values
            numbers = {k: v for k, v in frame.row.items() if isinstance(v, int | float)}
            self._series.append(frame.state.time, point, cell, _same_names(numbers))
        self.log.append_frame(frame.row)
        if frame.index % self._simulation.scene.output.checkpoint_every == 0:
            self.checkpoint(frame)

    def checkpoint(self, frame: Frame) -> None:
        """Save the state of a frame that has been recorded, unless that has been done."""
        if frame.index != self._saved:
            _Point(frame.index, frame.state, frame.guard).save(self.folder, self._simulation)
            self._saved = frame.index

    def finish(self, status: Status, failure: BaseException | None) -> None:
        """Close the series and the log."""
        self._series.close()
        extra: dict[str, Any] = {}
        if isinstance(failure, SolverFailure):
            extra["failure"] = failure.as_dict()
        elif failure is not None:
            extra["failure"] = {"what": f"{type(failure).__name__}: {failure}"}
        self.log.finish(status, **extra)


class _Run:
    """One call of `run`."""

    def __init__(self, simulation: Simulation, progress: Progress, recorder: _Recorder | None, signals: bool) -> None:
        self._simulation, self._progress, self._recorder = simulation, progress, recorder
        self._result = RunResult("finished", simulation, out=recorder.folder if recorder else None)
        self._stop, self._signals = False, signals
        self._last: Frame | None = None
        # A frame that is still to be written.
        self._pending: Frame | None = None

    def go(self, point: _Point | None) -> RunResult:
        """Solve all frames, and end well whatever happens."""
        resume = (point.frame, point.state, point.guard) if point else None
        self._result.state = point.state if point else None
        with _signals(self._ask_to_stop) if self._signals else contextlib.nullcontext():
            try:
                self._progress.announce("compiling kernels (first run only) and estimating spectra")
                self._simulation.compile(point.state if point else None)
                self._progress.start(self._simulation, point.frame + 1 if point else 0)
                for frame in self._simulation.frames(resume, self._on_substep):
                    self._keep(frame)
                    if self._stop and frame.index < self._simulation.scene.frames:
                        raise Stopped
            except Stopped:
                self._end("interrupted")
            except (SolverFailure, OSError) as failure:
                self._end("failed", failure)
            except (KeyboardInterrupt, SystemExit):
                self._end("interrupted")
                raise
            except BaseException as error:
                self._end("failed", error)
                raise
            else:
                self._end("finished")
        return self._result

    def _keep(self, frame: Frame) -> None:
        """Write a frame, or leave that for when the device is at work on the next one."""
        self._write()
        self._pending = frame
        if not self._simulation.backend.runs_ahead:
            self._write()

    def _write(self) -> None:
        """Write the frame that is pending, if there is one; what fails to be written is not tried again."""
        frame, self._pending = self._pending, None
        if frame is None:
            return
        if self._recorder:
            self._recorder.record(frame)
        else:
            self._result.displacements.append(frame.state.x - self._simulation.world.mesh.points)
        self._last = frame
        self._result.rows.append(frame.row)
        self._result.state = frame.state
        self._progress.frame(frame.row)

    def _end(self, status: Status, failure: BaseException | None = None) -> None:
        self._result.status = status
        self._result.failure = failure if isinstance(failure, SolverFailure | OSError) else None
        try:
            try:
                self._write()
                if self._recorder and self._last is not None:
                    self._recorder.checkpoint(self._last)
            finally:
                # Closed properly, a series is cheap to resume; and the log must not go on saying "running".
                if self._recorder:
                    self._recorder.finish(status, failure)
        except OSError as error:
            # The disk is full or gone; what was flushed before stays, and the first cause is the one to report.
            self._result.status, self._result.failure = "failed", self._result.failure or error

    def _on_substep(self, substep: int, substeps: int) -> bool:
        if substep == substeps:
            # All of this frame has been handed to the device.
            self._write()
        self._progress.substep(substep, substeps)
        return not self._stop

    def _ask_to_stop(self) -> None:
        self._stop = True


@contextlib.contextmanager
def _signals(stop: Any) -> Iterator[None]:
    """Turn Ctrl-C and a polite kill into a call of `stop` while the block runs; a second one gets through."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) or signal.SIG_DFL for number in (signal.SIGINT, signal.SIGTERM)}

    def handle(number: int, frame: FrameType | None) -> None:
        stop()
        signal.signal(number, before[signal.Signals(number)])

    for number in before:
        signal.signal(number, handle)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _same_names(numbers: dict[str, Any]) -> dict[str, float]:
    """Numbers of a frame for the series, which wants the same names at every frame: eps18 is missing at frame 0."""
    return {"eps18": float("nan"), **{name: float(value) for name, value in numbers.items()}}


def _header(simulation: Simulation) -> dict[str, Any]:
    scene, world = simulation.scene, simulation.world
    return {
        "scene": scene.model_dump(mode="json"),
        "mesh": {
            "vertices": simulation.disc.n_vertices,
            "tets": simulation.disc.n_tets,
            "free_vertices": int(simulation.disc.free.sum()),
            "sha256": world.mesh.content_hash,
            "bodies": world.origins,
        },
        "warnings": list(world.warnings),
        "fingerprint": simulation.fingerprint,
        "accuracy": scene.solver.accuracy,
        "choice": simulation.choice.as_dict() if simulation.choice else None,
        "mass_scaling": simulation.mass_scaling.as_dict() if simulation.mass_scaling else None,
        "hierarchy": str(simulation.hierarchy).splitlines() if simulation.hierarchy else None,
        "plan": [" | ".join(row) for row in simulation.plan.rows()],
        "threads": simulation.backend.threads,
        "device": scene.solver.device,
        "precision": simulation.backend.precision,
    }
