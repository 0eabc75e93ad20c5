# SPDX-License-Identifier: BSD-3-Clause
"""The backend that a scene asks for: the CPU's, or that of a GPU where everything the scene needs exists there."""

from __future__ import annotations

from femgal.device_memory import device_bytes
from femgal.discretisation import Discretisation
from femgal.hierarchy.hierarchy import Hierarchy
from femgal.kernels.backend import Backend
from femgal.kernels.cpu.backend import CpuBackend
from femgal.kernels.cuda.device import require_device
from femgal.scene.model import SolverSettings
from meshes.errors import InputError

_ON_CUDA = ("fas", "newton-multigrid", "verlet", "auto", "vbd", "jacobi", "scalar-jacobi")
_PRECONDITIONERS_ON_CUDA = ("v-cycle", "layers", "cycle", "blocks")


def make_backend(settings: SolverSettings, disc: Discretisation, hierarchy: Hierarchy | None) -> Backend:
    """The backend for `solver.device`, which has been checked.

    Raises
    ------
    InputError
        The GPU has less memory free than the scene will need; nothing has been allocated there.
    """
    layers = hierarchy.layers if hierarchy else ()
    finest = layers[0] if layers else None
    if settings.device == "cpu":
        return CpuBackend(disc, settings.threads, finest, settings.precision)
    require_device(nbytes=device_bytes(settings, disc, layers))
    # Imported here: only who asks for a GPU needs Numba's CUDA compiler.
    from femgal.kernels.cuda.backend import CudaBackend

    return CudaBackend(disc, settings.threads, finest, settings.precision)


def check_device(settings: SolverSettings) -> None:
    """Make sure, before anything is built, that the scene can be solved on the device that it asks for.

    Raises
    ------
    InputError
        There is no GPU that could be used, or a part of the solver exists on the CPU only.
    """
    if settings.device == "cuda":
        check_supported(settings)
        require_device()


def check_supported(settings: SolverSettings) -> None:
    """Refuse what a GPU cannot do.

    Raises
    ------
    InputError
        With what can be used instead.
    """
    if settings.name not in _ON_CUDA:
        raise _refusal("solver.name", settings.name, _ON_CUDA)
    if settings.name == "newton-multigrid" and settings.preconditioner not in _PRECONDITIONERS_ON_CUDA:
        raise _refusal("solver.preconditioner", settings.preconditioner, _PRECONDITIONERS_ON_CUDA)


def _refusal(where: str, found: str, allowed: tuple[str, ...]) -> InputError:
    advice = "choose one of these, or leave --device out"
    return InputError("not on a GPU yet", where=where, found=found, allowed=", ".join(allowed), advice=advice)
