# SPDX-License-Identifier: BSD-3-Clause
"""The plots of a record as PNG files, one file for each kind of plot."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from reports.benchmark.charts import Chart, Plot, Record, charts

_CHARTS = ("error-seconds", "error-passes", "solver-error-seconds", "cost-size", "cost-stiffness", "cost-slivers")
NAMES = tuple(f"{name}.png" for name in _CHARTS)

_COLUMNS, _WIDTH, _HEIGHT = 3, 5.0, 4.0
_MARKS = "os^Dvx+*<>ph"

# Colours before they come again, then with dotted lines; marks and colours do not come again together.
_COLOURS = 10

# Axes that span fewer decades have labels at 2 and 5 too.
_FEW_DECADES = 2.0


def draw_pictures(record: Record, folder: Path) -> list[Path]:
    """Write the plots and return their paths; needs matplotlib.

    Raises
    ------
    ImportError
        There is no matplotlib.
    """
    from matplotlib.figure import Figure

    written = []
    for chart in charts(record):
        drawn = Figure(figsize=_size(chart), layout="constrained")
        _draw(chart, drawn)
        path = folder / f"{chart.name}.png"
        drawn.savefig(path, dpi=120)
        written.append(path)
    return written


def _size(chart: Chart) -> tuple[float, float]:
    columns = min(_COLUMNS, len(chart.plots))
    return _WIDTH * columns, _HEIGHT * math.ceil(len(chart.plots) / columns) + 1.2


def _draw(chart: Chart, figure: Any) -> None:
    columns = min(_COLUMNS, len(chart.plots))
    axes = figure.subplots(math.ceil(len(chart.plots) / columns), columns, squeeze=False).ravel()
    for place, plot in enumerate(chart.plots):
        _panel(axes[place], plot)
    for empty in axes[len(chart.plots) :]:
        empty.set_axis_off()
    handles, labels = axes[0].get_legend_handles_labels()
    figure.suptitle(chart.title)
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize="small")


def _panel(axes: Any, plot: Plot) -> None:
    for number, curve in enumerate(plot["curves"]):
        of_reference = curve["name"].startswith("the reference")
        style = {"color": "0.6", "linestyle": "--"} if of_reference else _style(number)
        axes.plot(curve["x"], curve["y"], label=curve["name"], markersize=4, linewidth=1.2, **style)
    axes.set(title=plot["title"], xlabel=plot["x"], ylabel=plot["y"])
    axes.title.set_fontsize("medium")
    if any(curve["x"] for curve in plot["curves"]):
        axes.set(xscale="log", yscale="log")
        for axis in (axes.xaxis, axes.yaxis):
            _label_few_decades(axis)
    axes.grid(True, which="major", alpha=0.3)


def _style(number: int) -> dict[str, Any]:
    line = "-" if number < _COLOURS else ":"
    return {"color": f"C{number % _COLOURS}", "linestyle": line, "marker": _MARKS[number % len(_MARKS)]}


def _label_few_decades(axis: Any) -> None:
    """Short labels at 2 and 5 where powers of ten are few, and at powers of ten alone where they are many."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    least, most = sorted(axis.get_view_interval())
    if math.log10(most / least) < _FEW_DECADES:
        axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
        axis.set_minor_formatter(FuncFormatter(lambda value, _: f"{value:.3g}"))
        axis.set_tick_params(which="minor", labelsize="small")
    else:
        axis.set_minor_formatter(NullFormatter())
