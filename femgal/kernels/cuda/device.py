# SPDX-License-Identifier: BSD-3-Clause
"""Which GPU there is, and one message that says what is missing where there is none. Needs no package for that."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version

from meshes.errors import InputError

# The wheels of the extra `cuda` make code for this version of CUDA and later ones (PTX 9.0, drivers R580 and later).
OLDEST_DRIVER = (13, 0)

# Turing: what CUDA 13 still knows.
OLDEST_CAPABILITY = (7, 5)

PACKAGES = ("numba-cuda", "cuda-bindings", "cuda-core", "nvidia-nvvm", "nvidia-nvjitlink", "nvidia-cuda-nvrtc")
OPTIONAL_PACKAGES = ("cuda-toolkit", "nvidia-cuda-nvcc")

INSTALL = "pip install 'femgal[cuda]'"

# cuDeviceGetAttribute: compute capability and number of multiprocessors.
_MAJOR, _MINOR, _PROCESSORS = 75, 76, 16


@dataclass(frozen=True)
class Device:
    """A GPU.

    Parameters
    ----------
    name : As its driver says.
    capability : Of its instructions, such as (9, 0).
    processors : Multiprocessors.
    memory, free : Bytes in all, and not in use now.
    """

    name: str
    capability: tuple[int, int]
    processors: int
    memory: int
    free: int

    def __str__(self) -> str:
        major, minor = self.capability
        memory, free = self.memory / 2**30, self.free / 2**30
        return (
            f"{self.name}, compute capability {major}.{minor}, {self.processors} multiprocessors, "
            f"{memory:.1f} GiB, {free:.1f} GiB free"
        )


@dataclass(frozen=True)
class Findings:
    """What there is for CUDA on this machine.

    Parameters
    ----------
    driver : Version of CUDA that the driver knows; None where there is no driver.
    trouble : What the driver said instead of giving devices; empty when all is well.
    devices : GPUs, the one that is used first.
    packages : Version of each package, None where it is missing.
    simulated : Kernels run in Numba's simulator.
    """

    driver: tuple[int, int] | None = None
    trouble: str = ""
    devices: tuple[Device, ...] = ()
    packages: dict[str, str | None] = field(default_factory=dict)
    simulated: bool = False

    @property
    def driver_text(self) -> str:
        """The driver's version for people."""
        return (
            "no NVIDIA driver (libcuda.so.1)" if self.driver is None else "a driver for CUDA {}.{}".format(*self.driver)
        )


def find_devices() -> Findings:
    """Look for packages, driver and devices; never fails."""
    packages = {name: _version(name) for name in (*PACKAGES, *OPTIONAL_PACKAGES)}
    if simulator_wanted():
        return Findings(packages=packages, simulated=True)
    try:
        library = ctypes.CDLL("libcuda.so.1")
    except OSError:
        return Findings(packages=packages)
    number = ctypes.c_int()
    library.cuDriverGetVersion(ctypes.byref(number))
    driver = number.value // 1000, number.value % 1000 // 10
    if status := library.cuInit(0):
        return Findings(driver, f"cuInit: {_error(library, status)}", (), packages)
    library.cuDeviceGetCount(ctypes.byref(number))
    return Findings(driver, "", tuple(_describe(library, k) for k in range(number.value)), packages)


def simulator_wanted() -> bool:
    """Whether the environment asks for Numba's simulator."""
    return os.environ.get("NUMBA_ENABLE_CUDASIM", "0") not in ("", "0")


def require_device(found: Findings | None = None, *, nbytes: int = 0) -> Device | None:
    """The device that will be used; None stands for the simulator.

    Parameters
    ----------
    found : What there is; looked for when left out.
    nbytes : Memory that is needed.

    Raises
    ------
    InputError
        A package, the driver or the device is missing, too old, or has too little memory.
    """
    found = found or find_devices()
    missing = [name for name in PACKAGES if found.packages.get(name) is None]
    if found.simulated:
        missing = [name for name in missing if name == "numba-cuda"]
    if missing:
        raise _refusal("packages for CUDA are missing", ", ".join(missing), "all of: " + ", ".join(PACKAGES), INSTALL)
    if found.simulated:
        return None
    if found.driver is None or found.trouble or not found.devices:
        says = found.trouble or ("no device" if found.driver else "")
        what = ", ".join(text for text in (found.driver_text, says) if text)
        advice = "install the driver of an NVIDIA GPU (R580 or later), or leave --device out: the CPU solves all scenes"
        raise _refusal("there is no GPU to use", what, "a GPU with its driver", advice)
    if found.driver < OLDEST_DRIVER:
        needed = "CUDA {}.{} (driver R580) or later".format(*OLDEST_DRIVER)
        raise _refusal("the driver is too old", found.driver_text, needed, "install a newer driver")
    return _usable(found.devices, nbytes)


def _usable(devices: Sequence[Device], nbytes: int) -> Device:
    device = devices[0]
    if device.capability < OLDEST_CAPABILITY:
        needed = "compute capability {}.{} or later".format(*OLDEST_CAPABILITY)
        raise _refusal("the GPU is too old", str(device), needed, "set CUDA_VISIBLE_DEVICES to another one")
    if device.free < nbytes:
        advice = "fewer vertices, precision = 'float32', or another GPU (CUDA_VISIBLE_DEVICES)"
        raise _refusal("the GPU has too little memory", str(device), f"{nbytes / 2**30:.2f} GiB free", advice)
    return device


def _refusal(what: str, found: str, allowed: str, advice: str) -> InputError:
    return InputError(what, where="solver.device = cuda", found=found, allowed=allowed, advice=advice)


def _describe(library: ctypes.CDLL, index: int) -> Device:
    device, context, number = ctypes.c_int(), ctypes.c_void_p(), ctypes.c_int()
    library.cuDeviceGet(ctypes.byref(device), index)
    name = ctypes.create_string_buffer(256)
    library.cuDeviceGetName(name, len(name), device)

    def attribute(kind: int) -> int:
        library.cuDeviceGetAttribute(ctypes.byref(number), kind, device)
        return number.value

    capability, processors = (attribute(_MAJOR), attribute(_MINOR)), attribute(_PROCESSORS)
    free, memory = ctypes.c_size_t(), ctypes.c_size_t()
    library.cuDeviceTotalMem_v2(ctypes.byref(memory), device)
    # What is free is known within a context only; the primary one is made anyway by what comes after.
    if library.cuDevicePrimaryCtxRetain(ctypes.byref(context), device) == 0:
        library.cuCtxPushCurrent_v2(context)
        library.cuMemGetInfo_v2(ctypes.byref(free), ctypes.byref(memory))
        library.cuCtxPopCurrent_v2(ctypes.byref(context))
        library.cuDevicePrimaryCtxRelease_v2(device)
    return Device(name.value.decode(), capability, processors, memory.value, free.value)


def _error(library: ctypes.CDLL, status: int) -> str:
    text = ctypes.c_char_p()
    library.cuGetErrorString(status, ctypes.byref(text))
    return f"{text.value.decode() if text.value else 'unknown error'} ({status})"


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
