# SPDX-License-Identifier: BSD-3-Clause
"""One command for a machine with a GPU: `python -m reports.gpu.run`.

Checks every kernel and whole scenes against the CPU, runs compute-sanitizer where there is one, measures, and writes
figures.json and README.md into this folder. `--toy` does it at the size of the simulator (NUMBA_ENABLE_CUDASIM=1);
`--page FILE` draws the page of figures that are there. Nothing but the installed package is needed.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parent

# Largest differences that are accepted, of the motion and of the largest energy.
ACCEPTED = {"float64": (1e-9, 1e-8), "float32": (1e-4, 1e-4)}


def page(found: dict[str, Any]) -> str:
    """The figures for people, in Markdown."""
    lines = ["# The CUDA backend on a GPU", "", *_environment(found["environment"])]
    for name, draw in {"correctness": _correctness, "sanitizer": _sanitizer, "speed": _speed}.items():
        part = found.get(name, {"not_run": "the run ended before"})
        lines += ["", f"## {name.capitalize()}", ""]
        if "failure" in part:
            lines += ["```", part["failure"].strip(), "```"]
        else:
            lines += [f"Not run: {part['not_run']}."] if "not_run" in part else draw(part)
    return "\n".join(lines) + "\n"


def _environment(environment: dict[str, Any]) -> Iterator[str]:
    cuda = environment["cuda"]
    yield f"Devices: {cuda['devices'] or ('simulator' if cuda['simulated'] else 'none')}; driver {cuda['driver']}."
    yield f"Packages: {cuda['packages']}; numba {environment['numba']}, numpy {environment['numpy']}."
    yield f"Graphs: {environment['no_graphs'] or 'each repeated substep is one'}."


def _correctness(part: dict[str, Any]) -> Iterator[str]:
    yield "| what | precision | largest difference | accepted | |"
    yield "|---|---|---|---|---|"
    for precision, result in part["passes"].items():
        name, size = max(result["differences"].items(), key=lambda item: item[1])
        limit = {"float64": 1e-12, "float32": 2e-5}[precision]
        yield _row(f"{len(result['differences'])} passes, worst {name}", precision, size, limit)
        yield f"| the same bits again | {precision} | | | {'yes' if result['repeats'] else 'NO'} |"
    for name, result in part["scenes"].items():
        solver, _, precision = name.rpartition(", ")
        for what, limit in zip(("positions", "energies"), ACCEPTED[precision], strict=True):
            yield _row(f"{solver}: {what}", precision, result[what], limit)


def _row(what: str, precision: str, size: float, limit: float) -> str:
    return f"| {what} | {precision} | {size:.1e} | {limit:.0e} | {'yes' if size <= limit else 'NO'} |"


def _sanitizer(part: dict[str, Any]) -> Iterator[str]:
    for check, result in part.items():
        yield f"* {check}: exit code {result['exit_code']}; {' '.join(result['summary'])}"


def _speed(part: dict[str, Any]) -> Iterator[str]:
    yield "| vertices | precision | solver | s per frame | substeps | ms per substep | repeated | graph | GiB |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for row in part["bunny drape"]:
        head = f"| {row['vertices']} | {row['precision']} | {row['solver']} |"
        if "failure" in row:
            yield f"{head} failed: {row['failure'].strip().splitlines()[-1]} | | | | | |"
            continue
        f = row["frames"]
        times = f" {f['seconds_per_frame']:.4f} | {f['substeps']} | {1e3 * f['seconds_per_substep']:.4f} |"
        yield f"{head}{times} {f['repeated']} | {f['graphs']} | {f['bytes_of_arrays'] / 2**30:.2f} |"
    yield from ("", "Passes, as a share of the bandwidth of a copy:", "")
    yield "| vertices | precision | layer | pass | ms | GB/s | share of a copy | M tets/s |"
    yield "|---|---|---|---|---|---|---|---|"
    for row in part["bunny drape"]:
        for one in row.get("passes", ()):
            share = one["bandwidth"] / row["copy_bandwidth"]
            head = f"| {row['vertices']} | {row['precision']} | {one['layer']} | {one['pass']} |"
            rate = 1e-6 * one["tets_per_second"]
            yield f"{head} {1e3 * one['seconds']:.4f} | {1e-9 * one['bandwidth']:.0f} | {share:.2f} | {rate:.0f} |"
    yield from ("", "Seconds of the host per substep, with the solver's Python and repeated:", "")
    for row in part["bunny drape"]:
        if "launch_overhead" in row:
            shown = ", ".join(f"{name} {1e6 * value:.0f} us" for name, value in row["launch_overhead"].items())
            yield f"* {row['vertices']} vertices, {row['precision']}, {row['solver']}: {shown}"


def main(arguments: list[str]) -> int:
    """Measure and draw, or only draw."""
    given = [Path(argument) for argument in arguments if not argument.startswith("--")]
    if "--page" in arguments:
        print(page(json.loads(given[0].read_text(encoding="utf-8"))))
        return 0
    folder = given[0] if given else FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    toy = [argument for argument in arguments if argument == "--toy"]
    status = subprocess.run([sys.executable, "-m", "verify.gpu", str(folder / "figures.json"), *toy]).returncode
    if (folder / "figures.json").is_file():
        found = json.loads((folder / "figures.json").read_text(encoding="utf-8"))
        (folder / "README.md").write_text(page(found), encoding="utf-8")
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
