# SPDX-License-Identifier: BSD-3-Clause
"""Every format that meshio reads, without its traps.

meshio prints to standard output, ends the process on an unknown format, trusts every count and follows HDF5 links;
here all of that becomes one MeshError or a message.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from meshes.errors import MeshError
from meshes.io.counts_guard import check_counts
from meshes.io.hdf5_guard import check_hdf5, check_xdmf
from meshes.io.raw import RawMesh

# Suffix -> meshio modules to try in this order.
FORMATS: dict[str, tuple[str, ...]] = {
    ".msh": ("gmsh", "ansys"),
    ".vtk": ("vtk",),
    ".vtu": ("vtu",),
    ".mesh": ("medit",),
    ".meshb": ("medit",),
    ".xdmf": ("xdmf",),
    ".xmf": ("xdmf",),
    ".inp": ("abaqus",),
    ".nas": ("nastran",),
    ".bdf": ("nastran",),
    ".fem": ("nastran",),
    ".avs": ("avsucd",),
    ".cgns": ("cgns",),
    ".xml": ("dolfin",),
    ".e": ("exodus",),
    ".exo": ("exodus",),
    ".ex2": ("exodus",),
    ".f3grid": ("flac3d",),
    ".h5m": ("h5m",),
    ".hmf": ("hmf",),
    ".med": ("med",),
    ".mdpa": ("mdpa",),
    ".vol": ("netgen",),
    ".dato": ("permas",),
    ".post": ("permas",),
    ".su2": ("su2",),
    ".dat": ("tecplot",),
    ".tec": ("tecplot",),
    ".ele": ("tetgen",),
    ".node": ("tetgen",),
    ".ugrid": ("ugrid",),
    ".off": ("off",),
}
_HDF5 = {".cgns", ".h5m", ".hmf", ".med"}
# What meshio says when it leaves out cells of a type that it does not know.
_LEFT_OUT = re.compile(r"cells that meshio cannot handle \(type (\d+)\)")


def read_with_meshio(path: Path) -> RawMesh:
    """Read a file by its suffix.

    Raises
    ------
    MeshError
        Damaged, cut off, of another format than its suffix says, needing a package that is not installed, declaring
        impossible sizes, or pointing at other files.
    """
    _check_before(path)
    problems = []
    for name in FORMATS[path.suffix.lower()]:
        try:
            return _read_as(name, path)
        except MeshError:
            raise
        except (Exception, SystemExit) as error:  # meshio raises every kind there is on damaged input
            problems.append(f"{name}: {_in_words(error)}")
    raise MeshError(
        "cannot be read",
        where=str(path),
        found="; ".join(problems),
        allowed=f"a complete {path.suffix} file",
        advice="the file is damaged, cut off or of another format than its suffix says: export it again",
    )


def _check_before(path: Path) -> None:
    suffix = path.suffix.lower()
    if suffix in _HDF5:
        check_hdf5(path)
    elif suffix in {".xdmf", ".xmf"}:
        check_xdmf(path)
    else:
        check_counts(path)


def _read_as(name: str, path: Path) -> RawMesh:
    with _captured() as spoken:
        mesh = import_module(f"meshio.{name}").read(str(path))
    left_out = _LEFT_OUT.search(spoken.getvalue())
    if left_out:
        raise MeshError(
            "holds cells of a type that cannot be read",
            where=str(path),
            found=f"VTK cell type {left_out[1]}",
            allowed="tetrahedra (10) and triangles (5)",
        )
    messages = [f"meshio: {line.strip()}" for line in spoken.getvalue().splitlines() if line.strip()]
    blocks = [(block.type, _rectangular(block)) for block in mesh.cells]
    return RawMesh(np.asarray(mesh.points), blocks, dict(mesh.cell_data), messages)


def _rectangular(block: Any) -> np.ndarray:
    # Polyhedra come as nested lists; only their number matters, for the message.
    return np.zeros((len(block.data), 0), int) if block.type.startswith("polyhedron") else np.asarray(block.data)


@contextmanager
def _captured() -> Iterator[io.StringIO]:
    """Collect what is printed, and turn NumPy's hint at a cut-off number list into an error."""
    spoken = io.StringIO()
    with redirect_stdout(spoken), redirect_stderr(spoken), warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        warnings.filterwarnings("error", message=".*could not be read to its end.*")
        yield spoken


def _in_words(error: BaseException) -> str:
    if isinstance(error, ModuleNotFoundError):
        return f"reading needs the package {error.name}, which is not installed"
    if isinstance(error, MemoryError):
        return "declares more data than the memory holds"
    first = str(error).strip().splitlines()[:1]
    return f"{type(error).__name__}{': ' + first[0][:120] if first else ''}"
