# SPDX-License-Identifier: BSD-3-Clause
"""Kernels compiled without a GPU and without a driver: what a device would get, and what it would need.

The compiler is that of the wheels; `ptxas`, which turns its output into machine code and knows about registers, comes
with `nvidia-cuda-nvcc`.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from numba import types

from femgal.kernels.backend import Precision
from femgal.kernels.cuda.jit import KERNELS, argument_types
from meshes.errors import InputError

# Hopper: H100 and H200.
CAPABILITY = (9, 0)

_MODULES = ("vertex_passes", "pair_passes", "sums", "nodes", "matrices", "descent")

# An instruction on doubles that computes, rather than moves or converts.
_DOUBLE = re.compile(r"^\s+(?:@%p\d+ )?(\w+)(?:\.\w+)*\.f64\s", re.MULTILINE)
_MOVES = {"ld", "st", "mov", "cvt", "selp", "setp", "ldu", "abs", "neg"}


@dataclass(frozen=True)
class Compiled:
    """A kernel in one precision, compiled.

    Parameters
    ----------
    name, precision : Which.
    ptx : Assembly for a virtual machine.
    registers : Of each thread.
    stack, spills : Bytes of local memory of each thread: its arrays, and registers that did not fit.
    """

    name: str
    precision: Precision
    ptx: str
    registers: int
    stack: int
    spills: int

    @property
    def doubles(self) -> Counter[str]:
        """Instructions that compute in double precision, by name."""
        return Counter(found for found in _DOUBLE.findall(self.ptx) if found not in _MOVES)


def kernel_names() -> list[str]:
    """Every kernel, in the order of the modules."""
    for module in _MODULES:
        import_module(f"femgal.kernels.cuda.{module}")
    return list(KERNELS)


def compile_offline(name: str, precision: Precision) -> Compiled:
    """Compile a kernel for Hopper.

    Raises
    ------
    InputError
        There is no ptxas.
    """
    from numba import cuda

    kernel_names()
    function = KERNELS[name]
    with _without_device():
        ptx, _ = cuda.compile_ptx(function, types.void(*_signature(function, precision)), cc=CAPABILITY)
    return Compiled(name, precision, ptx, *_resources(ptx))


def precisions(name: str) -> tuple[Precision, ...]:
    """The precisions in which a kernel exists; what works on states is in double precision only."""
    return ("float32", "float64") if "Reals" in KERNELS[name].__annotations__.values() else ("float64",)


def compile_all() -> Iterator[Compiled]:
    """Every kernel in every precision."""
    for name in kernel_names():
        for precision in precisions(name):
            yield compile_offline(name, precision)


def _signature(function: Any, precision: Precision) -> list[Any]:
    found: list[Any] = []
    for dtype, ndim in argument_types(function, precision):
        kind = getattr(types, dtype)
        found.append(types.Array(kind, ndim, "C") if ndim else kind)
    return found


@contextmanager
def _without_device() -> Iterator[None]:
    """Numba-CUDA asks the present device for its capability whenever a kernel calls a function, even if it is given."""
    import numba.cuda.dispatcher as dispatcher

    class Device:
        compute_capability = CAPABILITY

    before = dispatcher.get_current_device
    dispatcher.get_current_device = lambda: Device
    try:
        yield
    finally:
        dispatcher.get_current_device = before


def find_ptxas() -> Path | None:
    """The assembler of the wheel nvidia-cuda-nvcc, or the one on the path."""
    spec = find_spec("nvidia")
    for folder in spec.submodule_search_locations or () if spec else ():
        for found in sorted(Path(folder).glob("c*/bin/ptxas")):
            return found
    found_on_path = shutil.which("ptxas")
    return Path(found_on_path) if found_on_path else None


def _resources(ptx: str) -> tuple[int, int, int]:
    """Registers, stack and spilled bytes of each thread."""
    ptxas = find_ptxas()
    if ptxas is None:
        raise InputError("ptxas is not installed", advice="pip install 'nvidia-cuda-nvcc==13.0.*'")
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "kernel.ptx"
        source.write_text(ptx)
        target = "sm_{}{}".format(*CAPABILITY)
        command = [str(ptxas), "-arch", target, "-v", str(source), "-o", str(source.with_suffix(".cubin"))]
        report = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    registers = re.search(r"Used (\d+) registers", report)
    memory = re.search(r"(\d+) bytes stack frame, (\d+) bytes spill stores, (\d+) bytes spill loads", report)
    assert registers
    assert memory
    return int(registers[1]), int(memory[1]), int(memory[2]) + int(memory[3])
