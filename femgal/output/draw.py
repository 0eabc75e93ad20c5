# SPDX-License-Identifier: BSD-3-Clause
"""Draws one picture with pyvista, off screen: `python -m femgal.output.draw FOLDER`, called by `femgal.output.view`.

FOLDER holds request.json and arrays.npz; picture.png is written beside them.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_VIEW = np.array([0.55, -1.0, 0.42])  # from the body to the camera; z is up
_VIEW_ANGLE = 24.0  # degrees, vertical
_MARGIN = 1.06
_STRIP = 130  # pixels below the panes, for the scalar bar
_MAX_COLUMNS = 4
_EDGES_UP_TO = 12_000  # triangles; beyond, mesh lines only darken the picture
_INK = "#202020"
# Light enough at the low end that unloaded parts keep their shading, brightness rising up to yellow, red for the peaks.
_COLOURS = ("#4a63b0", "#3f8fc4", "#3fb8ad", "#8fd175", "#f2dc55", "#f09a3e", "#d1392f")


def draw(folder: Path) -> None:
    """Draw what `folder` asks for."""
    request = json.loads((folder / "request.json").read_text(encoding="utf-8"))
    arrays = dict(np.load(folder / "arrays.npz"))
    captions = request["captions"]
    plotter, columns, aspect = _plotter(len(captions))
    everything = np.concatenate([arrays[f"points_{pane}"] for pane in range(len(captions))])
    camera = _camera(everything[np.isfinite(everything).all(axis=1)], aspect)
    for pane, caption in enumerate(captions):
        plotter.subplot(pane // columns, pane % columns)
        actor = _add_surface(plotter, arrays, pane, request["colours"])
        plotter.add_text(caption, position=(20, 16), font_size=11, color=_INK)
        plotter.camera_position = camera
        plotter.camera.view_angle = _VIEW_ANGLE
        plotter.reset_camera_clipping_range()
    plotter.subplot(plotter.shape[0] - 1, 0)
    _add_legend(plotter, actor, request["colours"])
    plotter.screenshot(folder / "picture.png")


def _plotter(panes: int) -> tuple[Any, int, float]:
    import pyvista

    columns = min(panes, _MAX_COLUMNS)
    rows = -(-panes // columns)
    width, height = (1600, 1070) if panes == 1 else (760, 760)
    total = rows * height + _STRIP
    layout: dict[str, Any] = {
        "shape": (rows + 1, columns),
        "row_weights": [height / total] * rows + [_STRIP / total],
        "groups": [(rows, slice(None))],
        "window_size": [columns * width, total],
    }
    plotter: Any = pyvista.Plotter(off_screen=True, border=False, lighting="light kit", **layout)
    plotter.set_background("white")
    plotter.enable_anti_aliasing("ssaa")
    return plotter, columns, width / height


def _add_surface(plotter: Any, arrays: dict[str, NDArray[Any]], pane: int, colours: dict[str, Any]) -> Any:
    import pyvista

    triangles, points = _used(arrays["triangles"], arrays[f"points_{pane}"])
    surface = pyvista.PolyData.from_regular_faces(points, triangles)
    values = arrays[f"values_{pane}"]
    look: dict[str, Any] = {"show_scalar_bar": False, "ambient": 0.3, "diffuse": 0.85, "specular": 0.12}
    if len(triangles) <= _EDGES_UP_TO:
        look |= {"show_edges": True, "edge_color": _INK, "edge_opacity": 0.25, "line_width": 1}
    if colours["ids"]:
        surface.cell_data["values"] = _id_colours(values)
        return plotter.add_mesh(surface, scalars="values", rgb=True, **look)
    surface.point_data["values"] = values[np.unique(arrays["triangles"])]
    limits = [colours["low"], colours["high"]]
    if len(triangles) > _EDGES_UP_TO:
        look |= {"smooth_shading": True, "split_sharp_edges": True, "feature_angle": 40.0}
    return plotter.add_mesh(surface, scalars="values", cmap=_colour_map(), clim=limits, nan_color="#c0c0c0", **look)


def _colour_map() -> Any:
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("femgal", _COLOURS)


def _id_colours(ids: NDArray[np.integer]) -> NDArray[np.uint8]:
    """Return a colour for each id, shape [n, 3]; close ids get distant hues, -1 ("none") is grey."""
    hue = ids * 0.6180339887 % 1.0
    value = 0.7 + 0.25 * (ids * 0.7548776662 % 1.0)
    # HSV to RGB: each channel is a trapezium of the hue, a third of a turn apart.
    ramp = np.abs((hue[:, None] + np.array([0.0, 2.0, 1.0]) / 3.0) % 1.0 * 6.0 - 3.0) - 1.0
    colours = value[:, None] * (1.0 - 0.55 * (1.0 - np.clip(ramp, 0.0, 1.0)))
    colours[ids < 0] = 0.75
    return np.asarray(255.0 * colours, np.uint8)


def _used(triangles: NDArray[Any], points: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    used, renumbered = np.unique(triangles, return_inverse=True)
    return renumbered.reshape(triangles.shape), points[used]


def _add_legend(plotter: Any, actor: Any, colours: dict[str, Any]) -> None:
    if colours["ids"]:
        plotter.add_text(colours["label"], position=(20, 60), font_size=13, color=_INK)
        return
    width = plotter.window_size[0]
    length = 820 / width
    size: dict[str, Any] = {"width": length, "height": 0.5, "position_x": 0.5 * (1.0 - length), "position_y": 0.1}
    text: dict[str, Any] = {"n_labels": 5, "fmt": "%.4g", "color": _INK, "label_font_size": 22}
    plotter.add_scalar_bar(mapper=actor.mapper, title=" ", **size, **text)
    # The bar's own title would run into its labels.
    plotter.add_text(colours["label"], position=(int(0.5 * width) - 390, 92), font_size=13, color=_INK)


def _camera(points: NDArray[np.float64], aspect: float) -> list[NDArray[np.float64]]:
    """Position, focal point and up of the camera that just sees all points, z up."""
    towards = _VIEW / np.linalg.norm(_VIEW)
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(towards, right), towards])
    local = points @ axes.T
    middle = 0.5 * (local.min(axis=0) + local.max(axis=0))
    across, up, depth = np.abs(local - middle).T[0], np.abs(local - middle).T[1], (local - middle).T[2]
    slope = np.tan(np.radians(0.5 * _VIEW_ANGLE)) / _MARGIN
    distance = float(np.max(np.maximum(across / aspect, up) / slope + depth))
    focus = middle @ axes
    return [focus + max(distance, 1e-12) * towards, focus, np.array([0.0, 0.0, 1.0])]


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
