# SPDX-License-Identifier: BSD-3-Clause
"""How much memory and disk a run of the scene takes."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from femgal.simulation import Simulation
from verify.diagnose.finding import Finding, Severity
from verify.diagnose.target import Target

# Python, NumPy, SciPy and Numba with loaded kernels, measured [bytes].
INTERPRETER = 220e6
# Positions, velocities, predictions, gradients and the like [float64 vectors per vertex].
_VECTORS = 12
_FLOAT32 = 4


def memory(target: Target) -> Finding:
    """Arrays of the bodies, the hierarchy and the passes; output per frame."""
    simulation = Simulation.prepare(target.scene)
    simulation.backend.gradient(simulation.world.x0)
    arrays = array_bytes([simulation.disc, simulation.world, simulation.hierarchy, simulation.backend])
    arrays += _VECTORS * 24 * target.disc.n_vertices
    frame = target.disc.n_vertices * 6 * _FLOAT32 + target.disc.n_tets * _FLOAT32
    total = arrays + INTERPRETER
    available = _available()
    numbers = {
        "arrays_bytes": arrays,
        "total_bytes": total,
        "bytes_per_tet": arrays / target.disc.n_tets,
        "output_per_frame_bytes": frame,
        "available_bytes": available,
    }
    what = (
        f"About {_shown(total)} for a run with this solver, {_shown(arrays)} of it arrays "
        f"({arrays / target.disc.n_tets:.0f} bytes per tetrahedron); at most {_shown(frame)} of output per frame with "
        "displacement, velocity and stress."
    )
    if available is not None and total > 0.8 * available:
        advice = f"This machine has {_shown(available)} free: ask for fewer vertices."
        return Finding("memory", Severity.PROBLEM, what, advice, numbers)
    return Finding("memory", Severity.OK, what, numbers=numbers)


def array_bytes(objects: Any, seen: set[int] | None = None) -> int:
    """Bytes of all arrays that objects hold, each once."""
    seen = set() if seen is None else seen
    if id(objects) in seen:
        return 0
    seen.add(id(objects))
    if isinstance(objects, np.ndarray):
        owner = objects if objects.base is None else objects.base
        if owner is objects:
            return objects.nbytes
        return array_bytes(owner, seen) if isinstance(owner, np.ndarray) else objects.nbytes
    return sum(array_bytes(one, seen) for one in _held(objects))


def _held(thing: Any) -> list[Any]:
    if isinstance(thing, dict):
        return list(thing.values())
    if isinstance(thing, list | tuple):
        return list(thing)
    if is_dataclass(thing) and not isinstance(thing, type):
        return [getattr(thing, one.name) for one in fields(thing)]
    if type(thing).__module__.startswith("femgal.") and hasattr(thing, "__dict__"):
        return list(vars(thing).values())
    return []


def _available() -> int | None:
    import os

    try:
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (ValueError, OSError, AttributeError):
        return None


def _shown(size: float) -> str:
    return f"{size / 1e9:.3g} GB" if size >= 1e9 else f"{size / 1e6:.3g} MB"
