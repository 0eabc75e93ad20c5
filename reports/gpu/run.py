# SPDX-License-Identifier: BSD-3-Clause
"""One command for a machine with a GPU: `python -m reports.gpu.run`.

Checks every kernel and whole scenes against the CPU, runs compute-sanitizer where there is one, measures, and writes
figures.json and README.md into this folder. Figures that are there are kept: a run that was cut short, or ended after
`--seconds N`, goes on with the same command. `--toy` does it at the size of the simulator (NUMBA_ENABLE_CUDASIM=1);
`--page FILE` draws the page of figures that are there. Nothing but the installed package is needed.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parent

# Largest differences that are accepted, of the motion and of the largest energy.
ACCEPTED = {"float64": (1e-9, 1e-8), "float32": (1e-4, 1e-4)}


# Largest differences of single passes, and of V-cycles, which are single precision on the host.
OF_PASSES = {"float64": 1e-12, "float32": 2e-5}
OF_CYCLES = 1e-5


def page(found: dict[str, Any]) -> str:
    """The figures for people, in Markdown."""
    lines = ["# The CUDA backend on a GPU", "", *_environment(found["environment"])]
    for part, (title, draw) in SECTIONS.items():
        results = {name: result for name, result in found.get(part, {}).items() if "not_run" not in result}
        lines += ["", f"## {title}", ""]
        good = {name: result for name, result in results.items() if "failure" not in result}
        lines += list(draw(good)) if good else [f"Not run: {_why(found.get(part, {}))}."]
        lines += [f"* {name} failed: {_last_line(one)}" for name, one in results.items() if name not in good]
    return "\n".join(lines) + "\n"


def _why(part: dict[str, Any]) -> str:
    return next((result["not_run"] for result in part.values() if "not_run" in result), "the run ended before")


def _last_line(result: dict[str, Any]) -> str:
    return result["failure"].strip().splitlines()[-1]


def _environment(environment: dict[str, Any]) -> Iterator[str]:
    cuda = environment["cuda"]
    yield f"Devices: {cuda['devices'] or ('simulator' if cuda['simulated'] else 'none')}; driver {cuda['driver']}."
    yield f"Packages: {cuda['packages']}; numba {environment['numba']}, numpy {environment['numpy']}."
    yield f"Graphs: {environment['no_graphs'] or 'each repeated substep is one'}."


def _passes(part: dict[str, Any]) -> Iterator[str]:
    yield "| what | precision | largest difference | accepted | |"
    yield "|---|---|---|---|---|"
    for precision, result in part.items():
        name, size = max(result["differences"].items(), key=lambda item: item[1])
        yield _row(f"{len(result['differences'])} passes, worst {name}", precision, size, OF_PASSES[precision])
        for what, difference in result.get("cycles", {}).items():
            yield _row(what, precision, difference, OF_CYCLES)
        yield f"| the same bits again | {precision} | | | {'yes' if result['repeats'] else 'NO'} |"


def _scenes(part: dict[str, Any]) -> Iterator[str]:
    yield "| what | precision | largest difference | accepted | |"
    yield "|---|---|---|---|---|"
    for name, result in part.items():
        solver, _, precision = name.rpartition(", ")
        for what, limit in zip(("positions", "energies"), ACCEPTED[precision], strict=True):
            yield _row(f"{solver}: {what}", precision, result[what], limit)


def _row(what: str, precision: str, size: float, limit: float) -> str:
    return f"| {what} | {precision} | {size:.1e} | {limit:.0e} | {'yes' if size <= limit else 'NO'} |"


def _sanitizer(part: dict[str, Any]) -> Iterator[str]:
    for check, result in part.items():
        yield f"* {check}: exit code {result['exit_code']}; {' '.join(result['summary'])}"


def _speed(part: dict[str, Any]) -> Iterator[str]:
    yield from _frames(part)
    yield from ("", "Passes, as a share of the bandwidth of a copy:", "")
    yield "| what | layer | pass | ms | GB/s | share of a copy | M tets/s |"
    yield "|---|---|---|---|---|---|---|"
    for name, row in part.items():
        for one in row.get("passes", ()):
            share = one["bandwidth"] / row["copy_bandwidth"]
            head, rate = f"| {name} | {one['layer']} | {one['pass']} |", 1e-6 * one["tets_per_second"]
            yield f"{head} {1e3 * one['seconds']:.4f} | {1e-9 * one['bandwidth']:.0f} | {share:.2f} | {rate:.0f} |"
    yield from ("", "Seconds of the host per substep, with the solver's Python and repeated:", "")
    for name, row in part.items():
        if "launch_overhead" in row:
            shown = ", ".join(f"{what} {1e6 * value:.0f} us" for what, value in row["launch_overhead"].items())
            yield f"* {name}: {shown}"


def _frames(part: dict[str, Any]) -> Iterator[str]:
    yield "| what | scene | vertices | s per frame | substeps | ms per substep | repeated | graph | GiB | expected |"
    yield "|---|---|---|---|---|---|---|---|---|---|"
    for name, row in part.items():
        f = row["frames"]
        times = f"{f['seconds_per_frame']:.4f} | {f['substeps']} | {1e3 * f['seconds_per_substep']:.4f}"
        memory = f"{f['bytes_of_arrays'] / 2**30:.2f} | {f['bytes_expected'] / 2**30:.2f}"
        yield f"| {name} | {row['scene']} | {row['vertices']} | {times} | {f['repeated']} | {f['graphs']} | {memory} |"


def _one_percent(part: dict[str, Any]) -> Iterator[str]:
    yield "| solver | substeps | error | reached | s per frame |"
    yield "|---|---|---|---|---|"
    for name, row in part.items():
        head = f"| {name} | {row['substeps']:.0f} | {100 * row['error']:.2g} % |"
        yield f"{head} {'yes' if row['reached'] else 'NO'} | {row['seconds_per_frame']:.4f} |"


def _registers(part: dict[str, Any]) -> Iterator[str]:
    yield "| kernel | precision | registers | stack | spills |"
    yield "|---|---|---|---|---|"
    for one in part["all"]["kernels"]:
        yield f"| {one['name']} | {one['precision']} | {one['registers']} | {one['stack']} | {one['spills']} |"


SECTIONS: dict[str, tuple[str, Callable[[dict[str, Any]], Iterator[str]]]] = {
    "passes": ("Passes against the CPU", _passes),
    "scenes": ("Scenes against the CPU", _scenes),
    "speed": ("Drape", _speed),
    "table 1": ("Scenes of [L], Table 1", _frames),
    "one percent": ("Whole motions with an error of one percent", _one_percent),
    "sanitizer": ("compute-sanitizer", _sanitizer),
    "registers": ("Registers", _registers),
}


def _positional(arguments: list[str]) -> list[str]:
    """Arguments that are neither options nor the number of seconds."""
    numbers = {k + 1 for k, argument in enumerate(arguments) if argument == "--seconds"}
    return [argument for k, argument in enumerate(arguments) if k not in numbers and not argument.startswith("--")]


def main(arguments: list[str]) -> int:
    """Measure and draw, or only draw."""
    given = [Path(argument) for argument in _positional(arguments)]
    if "--page" in arguments:
        print(page(json.loads(given[0].read_text(encoding="utf-8"))))
        return 0
    folder = given[0] if given else FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    toy = [argument for argument in arguments if argument == "--toy"]
    seconds = [arguments[arguments.index("--seconds") + 1]] if "--seconds" in arguments else []
    command = [sys.executable, "-m", "verify.gpu", str(folder / "figures.json"), *seconds, *toy]
    status = subprocess.run(command).returncode
    if (folder / "figures.json").is_file():
        found = json.loads((folder / "figures.json").read_text(encoding="utf-8"))
        (folder / "README.md").write_text(page(found), encoding="utf-8")
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
