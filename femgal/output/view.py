# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of a run: which surface, which colours, which frames. `femgal.output.draw` puts them on the screen.

Drawing happens in a process of its own, because a machine without working OpenGL ends it with a signal and no
message: so the caller survives and can say what is missing.
"""

from __future__ import annotations

import importlib.util
import json
import math
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from femgal.output.atomic import replacing
from femgal.output.boundary import vertex_average
from femgal.output.fields import unit_of
from femgal.output.read import SavedRun
from femgal.output.series import checked_frame
from meshes.errors import InputError
from meshes.surface import boundary_with_owners

_DRAW = (sys.executable, "-m", "femgal.output.draw")
_TIMEOUT = 600.0  # seconds; software rendering of a million triangles takes some ten
_PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
_STEPS = (1.0, 1.2, 1.6, 2.0, 2.4, 2.8, 3.2, 4.0, 4.8, 6.0, 8.0, 10.0)
_TITLES = {"von_mises": "von Mises stress", "J": "volume ratio J", "energy_density": "elastic energy density"}
_PREFIXABLE = ("m", "m/s", "Pa", "J/m^3", "J")
_GL_ADVICE = (
    "on a machine without a display install libegl1 and libgl1 (Debian, Ubuntu: apt-get install libegl1 libgl1 "
    "libgl1-mesa-dri), or run under xvfb-run"
)


@dataclass(frozen=True)
class Colours:
    """How values become colours.

    Parameters
    ----------
    label : str
        Title of the scalar bar, with unit.
    low, high : float
        Ends of the scalar bar.
    ids : bool
        The values are ids: one colour each, no scalar bar.
    """

    label: str
    low: float
    high: float
    ids: bool


def save_picture(
    run: SavedRun, png: Path, *, frames: Sequence[int | str] = ("last",), field: str | None = None
) -> Path:
    """Draw the deformed surface of one frame, or of several side by side.

    Parameters
    ----------
    run : SavedRun
        What to draw.
    png : Path
        Picture to write.
    frames : sequence of int, "first" or "last"
        One pane each; all with the same colours and camera.
    field : str, optional
        Point or cell array to colour by; the length of vectors. Default von_mises, else displacement.

    Raises
    ------
    InputError
        No such frame or field, motion that is not finite, a file that cannot be written, pyvista or OpenGL missing.
    """
    _need_pyvista()
    numbers = [frame_number(frame, run.n_frames, str(run.path)) for frame in frames]
    name = field or _default_field(run)
    triangles, owners = boundary_with_owners(run.cells)
    raw = [_surface_values(run, name, number, triangles, owners) for number in numbers]
    colours, values = _coloured(name, raw)
    arrays: dict[str, NDArray[Any]] = {"triangles": triangles}
    for pane, number in enumerate(numbers):
        arrays |= {f"points_{pane}": _positions(run, number), f"values_{pane}": values[pane]}
    captions = [f"frame {number},  t = {run.times[number]:.4g} s" for number in numbers]
    _draw({"captions": captions, "colours": asdict(colours)}, arrays, png)
    return png


def frame_number(frame: int | str, n_frames: int, where: str) -> int:
    """Return a frame as a number: "first", "last", or an integer, counted from the end when negative.

    Raises
    ------
    InputError
        Not a frame of this run.
    """
    named = {"first": 0, "last": -1}.get(str(frame), frame)
    try:
        number = int(named)
    except ValueError:
        raise InputError("no such frame", where=where, found=frame, allowed="a number, first or last") from None
    return checked_frame(number, n_frames, where)


def _default_field(run: SavedRun) -> str:
    return "von_mises" if "von_mises" in run.cell_names else "displacement"


def _positions(run: SavedRun, frame: int) -> NDArray[np.float64]:
    positions = run.points + run.displacement(frame)
    if not np.isfinite(positions).all():
        raise InputError(
            "positions are not finite, nothing to draw",
            where=str(run.path),
            found=f"NaN or infinity in frame {frame}",
            advice="draw an earlier frame with --frame",
        )
    return positions


def _surface_values(
    run: SavedRun, name: str, frame: int, triangles: NDArray[np.int32], owners: NDArray[np.int32]
) -> NDArray[Any]:
    """Return ids per triangle, or real values per vertex."""
    on_points = name in run.point_names
    if not on_points and name not in run.cell_names:
        raise InputError(
            "no such field in this run",
            where=str(run.path),
            found=name,
            allowed=", ".join((*run.point_names, *run.cell_names)),
        )
    values = run.point_data(name, frame) if on_points else run.cell_data(name, frame)
    if values.ndim == 2:
        values = np.linalg.norm(values.astype(np.float64), axis=1)
    if values.dtype.kind in "iu":
        # The median of three ids is the one that two of them share, if any do.
        return np.median(values[triangles], axis=1).astype(np.int64) if on_points else values[owners]
    return values.astype(np.float64) if on_points else vertex_average(values, run.cells, run.mesh.volumes)


def _coloured(name: str, raw: list[NDArray[Any]]) -> tuple[Colours, list[NDArray[Any]]]:
    if raw[0].dtype.kind in "iu":
        ids = len(np.unique(np.concatenate(raw)))
        return Colours(f"{name} ({ids} ids)", 0.0, 1.0, ids=True), raw
    finite = np.concatenate(raw)
    finite = finite[np.isfinite(finite)]
    # Stress peaks at a few corners would leave the rest in one colour.
    low, high = np.percentile(finite, [0.2, 99.8]) if len(finite) else (0.0, 1.0)
    low = 0.0 if 0.0 <= low < 0.3 * high else float(low)
    high = float(high) if high > low else low + 1.0
    factor, unit = _readable_unit(unit_of(name), max(abs(low), abs(high)))
    low, high = factor * low, factor * high
    title = _TITLES.get(name, name.replace("_", " "))
    label = f"{title}  [{unit}]" if unit else title
    return Colours(label, low, high if low else _rounded_up(high), ids=False), [factor * values for values in raw]


def _rounded_up(value: float) -> float:
    """Return the next number above whose quarters are short, for the labels of the scalar bar."""
    if value <= 0.0:
        return value
    power = 10.0 ** math.floor(math.log10(value))
    return power * min(step for step in _STEPS if step * power >= value * (1.0 - 1e-12))


def _readable_unit(unit: str, largest: float) -> tuple[float, str]:
    """Return the factor and unit that bring the largest value to 1 ... 1000."""
    if unit not in _PREFIXABLE or not 0.0 < largest < math.inf:
        return 1.0, "" if unit == "-" else unit
    power = 3 * math.floor(math.log10(largest) / 3.0)
    highest = 0 if unit.startswith("m") else 9  # nobody reads kilometres of displacement
    power = min(max(power, -9), highest)
    return 10.0**-power, _PREFIXES[power] + unit


def _draw(request: dict[str, Any], arrays: dict[str, NDArray[Any]], png: Path) -> None:
    with tempfile.TemporaryDirectory(prefix="femgal-") as folder:
        room = Path(folder)
        np.savez(room / "arrays.npz", **arrays)  # type: ignore[arg-type]
        (room / "request.json").write_text(json.dumps(request), encoding="utf-8")
        try:
            done = subprocess.run((*_DRAW, folder), capture_output=True, text=True, timeout=_TIMEOUT, check=False)
            failure = _failure(done)
        except subprocess.TimeoutExpired:
            failure = f"no picture after {_TIMEOUT:g} s"
        if failure or not (room / "picture.png").is_file():
            raise InputError("drawing failed", found=failure or "no picture", advice=_GL_ADVICE)
        _save(png, (room / "picture.png").read_bytes())


def _failure(done: subprocess.CompletedProcess[str]) -> str:
    if done.returncode == 0:
        return ""
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    last = f"; {lines[-1].strip()}" if lines else ""
    if done.returncode < 0:
        return f"OpenGL ended the drawing process with {signal.Signals(-done.returncode).name}{last}"
    return f"exit code {done.returncode}{last}"


def _save(png: Path, content: bytes) -> None:
    try:
        with replacing(png) as part:
            part.write_bytes(content)
    except OSError as error:
        raise InputError(
            "picture cannot be written", where=str(png), found=error, allowed="a writable file", advice="see --png"
        ) from error


def _need_pyvista() -> None:
    if importlib.util.find_spec("pyvista") is None:
        raise InputError(
            "pictures need pyvista", found="not installed", allowed="pyvista", advice='pip install "femgal[view]"'
        )
