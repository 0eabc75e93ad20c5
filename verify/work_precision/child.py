# SPDX-License-Identifier: BSD-3-Clause
"""The process of one run, so that its time, its compilation and its memory are its own.

``python -m verify.work_precision.child REQUEST.json OUT`` writes OUT.json and, for a motion, OUT.npz.
"""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from femgal.scene.load import parse_scene
from meshes.errors import InputError
from verify.work_precision.launch import END
from verify.work_precision.request import Request
from verify.work_precision.store import write_result

# prctl(2): the signal that this process gets when the one that started it dies.
_PR_SET_PDEATHSIG = 1

# CPU time [s] for what comes before the frames, beyond the time limit: the first run of a solver compiles its kernels.
PREPARING = 300.0


def main(request_file: Path, out: Path) -> None:
    """Carry out a request; what the user can cause is a result too."""
    _die_with_the_parent()
    request = Request.from_json(request_file.read_text(encoding="utf-8"))
    numbers: dict[str, Any] = {"label": request.label, "failure": None, "load": os.getloadavg()[0]}
    arrays = None
    try:
        scene = parse_scene(request.scene, request.label)
        _end_at(request.time_limit, scene.solver.threads, PREPARING)
        if request.kind == "survey":
            from verify.work_precision.survey import survey

            numbers |= survey(scene)
        elif request.kind == "substep":
            from verify.work_precision.run_substep import run_substep

            numbers |= run_substep(scene, request)
        else:
            from verify.work_precision.run_motion import run_motion

            found, arrays = run_motion(scene, request, lambda: _end_at(request.time_limit, scene.solver.threads))
            numbers |= found
    except InputError as error:
        numbers |= {"failure": str(error), "failure_kind": "input"}
    write_result(out, numbers | {"peak_mb": _peak_mb()}, arrays)


def _die_with_the_parent() -> None:
    """Nobody is left to read the result; a worker that was killed must not leave a run behind that takes its CPU."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def _end_at(time_limit: float | None, threads: int | None, more: float = 0.0) -> None:
    """Have the system end this process when it has had as much CPU time from now as the limit gives its threads.

    CPU time, because a machine that others share may give a process a tenth of the clock's.
    """
    if time_limit is not None:
        signal.signal(END, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, more + time_limit * (threads or os.cpu_count() or 1))


def _peak_mb() -> float:
    """Largest memory of this process [MB]; what getrusage says may be that of the process that started it."""
    with suppress(OSError, StopIteration, ValueError):
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
        return int(next(line for line in lines if line.startswith("VmHWM")).split()[1]) / 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
