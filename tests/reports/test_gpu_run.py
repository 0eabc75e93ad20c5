# SPDX-License-Identifier: BSD-3-Clause
"""The page of figures from a GPU.

1. What is larger than accepted is marked, what is not is not; parts that were not run say so, and what failed is named
   with its reason beside what was found.
2. Passes stand as shares of the bandwidth of a copy, frames in seconds with the memory that they took and were expected
   to; whole motions with their error, and whether it is small enough.
"""

from __future__ import annotations

from typing import Any

from reports.gpu.run import SECTIONS, page

ENVIRONMENT = {
    "cuda": {"devices": [{"name": "some GPU"}], "driver": [13, 0], "packages": {}, "simulated": False},
    "numba": "0.68",
    "numpy": "2.4",
    "no_graphs": "",
}
SCENE = {"positions": 3e-12, "energies": 2e-7}
FRAMES = {
    "seconds_per_frame": 0.25,
    "substeps": 400,
    "seconds_per_substep": 0.000625,
    "repeated": 398,
    "graphs": True,
    "bytes_of_arrays": 2**30,
    "bytes_expected": 3 * 2**29,
}
PASS = {"layer": "vertices", "pass": "terms", "seconds": 0.001, "bandwidth": 3e12, "tets_per_second": 6e9}
PASSES = {"differences": {"gradient": 3e-13, "dot": 1e-16}, "cycles": {"cycle": 4e-5}, "repeats": True}
LOST = {"failure": "Traceback\nValueError: no"}
MOTION = {"substeps": 12.0, "error": 0.0082, "reached": True, "seconds_per_frame": 0.02}


def found() -> dict[str, Any]:
    row = {"vertices": 1000, "scene": "bunny-drape", "precision": "float32", "frames": FRAMES, "passes": [PASS]}
    row |= {"copy_bandwidth": 4e12, "launch_overhead": {"plain": 5e-4}}
    return {
        "environment": ENVIRONMENT,
        "passes": {"float64": PASSES},
        "scenes": {"fas, exact, float64": SCENE},
        "sanitizer": {"all": {"not_run": "compute-sanitizer is not installed"}},
        "speed": {"1000, float32, fas": row, "9, float64, vbd": LOST},
        "table 1": {"bunny drape": {"vertices": 44, "scene": "bunny-drape", "frames": FRAMES}},
        "one percent": {"verlet": MOTION, "vbd, BDF2": MOTION | {"error": 0.04, "reached": False}},
        "registers": {
            "all": {"kernels": [{"name": "k", "precision": "float32", "registers": 40, "stack": 0, "spills": 0}]}
        },
    }


def test_differences():
    lines = page(found()).splitlines()
    assert "| 2 passes, worst gradient | float64 | 3.0e-13 | 1e-12 | yes |" in lines
    assert "| cycle | float64 | 4.0e-05 | 1e-05 | NO |" in lines
    assert "| the same bits again | float64 | | | yes |" in lines
    assert "| fas, exact: positions | float64 | 3.0e-12 | 1e-09 | yes |" in lines
    assert "| fas, exact: energies | float64 | 2.0e-07 | 1e-08 | NO |" in lines


def test_speed():
    lines = page(found()).splitlines()
    times = "0.2500 | 400 | 0.6250 | 398 | True | 1.00 | 1.50 |"
    assert f"| 1000, float32, fas | bunny-drape | 1000 | {times}" in lines
    assert f"| bunny drape | bunny-drape | 44 | {times}" in lines
    assert "| 1000, float32, fas | vertices | terms | 1.0000 | 3000 | 0.75 | 6000 |" in lines
    assert "* 9, float64, vbd failed: ValueError: no" in lines
    assert "* 1000, float32, fas: plain 500 us" in lines


def test_whole_motions():
    lines = page(found()).splitlines()
    assert "| verlet | 12 | 0.82 % | yes | 0.0200 |" in lines
    assert "| vbd, BDF2 | 12 | 4 % | NO | 0.0200 |" in lines
    assert "| k | float32 | 40 | 0 | 0 |" in lines


def test_what_was_not_run():
    text = page({"environment": ENVIRONMENT, "passes": {"float64": {"failure": "Traceback\nKeyError: 3"}}})
    assert text.count("Not run:") == len(SECTIONS)
    assert "* float64 failed: KeyError: 3" in text
    assert "Not run: compute-sanitizer is not installed." in page(found())
