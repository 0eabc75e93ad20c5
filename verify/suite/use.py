# SPDX-License-Identifier: BSD-3-Clause
"""What every case is given: the device and threads of the run, its seed, and backends made for them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from femgal.discretisation import Discretisation
from femgal.kernels.backend import Backend, Precision
from femgal.kernels.cpu.backend import CpuBackend
from meshes.errors import InputError
from verify.suite.case import Skip

DEVICES = ("cpu", "cuda")
SEED = 20_260_117


@dataclass(frozen=True)
class Use:
    """How the suite runs.

    Parameters
    ----------
    device : "cpu" or "cuda": where element passes run.
    threads : Threads of the CPU's element passes; None takes all. Never changes a bit.
    seed : Of everything random.
    """

    device: str = "cpu"
    threads: int | None = None
    seed: int = SEED

    def backend(self, disc: Discretisation, precision: Precision = "float64") -> Backend:
        """Production element passes on the run's device.

        Raises
        ------
        Skip
            The device cannot be used here.
        """
        if self.device == "cpu":
            return CpuBackend(disc, self.threads, precision=precision)
        if reason := unavailable(self.device):
            raise Skip(reason)
        from femgal.kernels.cuda.backend import CudaBackend

        return CudaBackend(disc, self.threads, precision=precision)

    def rng(self, salt: int = 0) -> np.random.Generator:
        """A random generator of its own for each use."""
        return np.random.default_rng(self.seed + 2 * salt)


def unavailable(device: str) -> str | None:
    """Why a device cannot be used; None when it can."""
    if device == "cpu":
        return None
    from femgal.kernels.cuda.device import require_device

    try:
        require_device()
    except InputError as error:
        return f"{error.what} ({error.found})"
    return None
