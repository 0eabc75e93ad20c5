# SPDX-License-Identifier: BSD-3-Clause
"""Starts the process of one run and stays with it: a run that crashes, is killed or takes too long is a result."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from femgal.scene.load import parse_scene
from verify.work_precision.request import Request
from verify.work_precision.store import write_result

# What the interpreter is asked to run.
COMMAND: tuple[str, ...] = ("-m", "verify.work_precision.child")

# Every library that has threads of its own takes as many as the run may have.
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")

# What ends a run whose CPU time is up; and how many times its limit, and seconds to start, it may take by the clock.
END = signal.SIGPROF
MOST_STARVED, STARTING = 20.0, 120.0

# Longest end of what a process that crashed had to say.
_MOST_WORDS = 2000


# Processes of this one that run now, and those that were asked to end.
_running: set[subprocess.Popen[bytes]] = set()
_unwanted: set[subprocess.Popen[bytes]] = set()


class Unwanted(Exception):
    """The run was ended because nobody wants its result any more."""


def launch(request: Request, out: Path) -> None:
    """Run a request; OUT.json is there afterwards, whatever happens to the run.

    Raises
    ------
    KeyboardInterrupt
        The user stops; the process is stopped first, and the run has no result.
    Unwanted
        `end_all` was called; no result either.
    """
    out.with_suffix(".json").unlink(missing_ok=True)
    with tempfile.TemporaryDirectory(prefix="femgal-bench-") as folder:
        asked = Path(folder) / "request.json"
        asked.write_text(request.as_json(), encoding="utf-8")
        command = [sys.executable, *COMMAND, str(asked), str(out)]
        began = time.perf_counter()
        with (Path(folder) / "stderr").open("w+b") as words:
            # A session of its own: Ctrl-C is for this process, which then ends the other one.
            process = subprocess.Popen(
                command, stdout=words, stderr=words, env=_environment(request), start_new_session=True
            )
            _running.add(process)
            try:
                late = _wait(process, _most_seconds(request))
            finally:
                _running.discard(process)
            words.seek(0)
            said = words.read().decode(errors="replace").strip()[-_MOST_WORDS:]
    if process in _unwanted:
        _unwanted.discard(process)
        _remove_parts(out)
        raise Unwanted
    if late or process.returncode != 0:
        _remove_parts(out)
        write_result(out, _failure(request, process.returncode, late, said, time.perf_counter() - began))


def end_all() -> None:
    """End the runs of all threads of this process; none of them has a result."""
    for process in list(_running):
        _unwanted.add(process)
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)


def _most_seconds(request: Request) -> float | None:
    """By the clock; a run that waits for something that never comes takes no CPU time."""
    return None if request.time_limit is None else MOST_STARVED * request.time_limit + STARTING


def _wait(process: subprocess.Popen[bytes], limit: float | None) -> bool:
    """Wait for the end; returns whether it had to be brought about."""
    try:
        _wait_for(process, limit)
    except subprocess.TimeoutExpired:
        _end(process)
        return True
    except BaseException:
        _end(process)
        raise
    return False


def _wait_for(process: subprocess.Popen[bytes], limit: float | None) -> None:
    process.wait(limit)


def _end(process: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _environment(request: Request) -> dict[str, str]:
    threads = parse_scene(request.scene, request.label).solver.threads
    return dict(os.environ) | ({} if threads is None else dict.fromkeys(_THREADS, str(threads)))


def _failure(request: Request, code: int, late: bool, said: str, seconds: float) -> dict[str, Any]:
    if late:
        kind, text = "time limit", f"stopped after {seconds:.0f} s, with less CPU time than its limit"
    elif code == -END:
        kind, text = "time limit", f"stopped after {request.time_limit:g} s of CPU time per thread, its time limit"
    elif code < 0:
        name = signal.Signals(-code).name
        hint = ", as the system does where memory runs out" if -code == signal.SIGKILL else ""
        kind, text = "killed", f"killed by {name}{hint}" + (f": {said}" if said else "")
    else:
        kind, text = "crash", f"ended with exit code {code}: {said}"
    return {
        "label": request.label,
        "failure": text,
        "failure_kind": kind,
        "time_limit": request.time_limit,
        "process_seconds": seconds,
        "rows": [],
    }


def _remove_parts(out: Path) -> None:
    for part in out.parent.glob(f".{out.stem}*.part*"):
        part.unlink(missing_ok=True)
