# SPDX-License-Identifier: BSD-3-Clause
"""The page of figures from a GPU.

1. What is larger than accepted is marked, what is not is not; parts that were not run, or failed, say so.
2. Passes stand as shares of the bandwidth of a copy, frames in seconds.
"""

from __future__ import annotations

from reports.gpu.run import page

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
}
PASS = {"layer": "vertices", "pass": "terms", "seconds": 0.001, "bandwidth": 3e12, "tets_per_second": 6e9}


def found() -> dict:
    passes = {"float64": {"differences": {"gradient": 3e-13, "dot": 1e-16}, "repeats": True}}
    row = {"vertices": 1000, "precision": "float32", "solver": "fas", "frames": FRAMES, "passes": [PASS]}
    row |= {"copy_bandwidth": 4e12, "launch_overhead": {"plain": 5e-4}}
    lost = {"vertices": 9, "precision": "float64", "solver": "vbd", "failure": "Traceback\nValueError: no"}
    return {
        "environment": ENVIRONMENT,
        "correctness": {"passes": passes, "scenes": {"fas, exact, float64": SCENE}},
        "sanitizer": {"not_run": "compute-sanitizer is not installed"},
        "speed": {"bunny drape": [row, lost]},
    }


def test_differences():
    lines = page(found()).splitlines()
    assert "| 2 passes, worst gradient | float64 | 3.0e-13 | 1e-12 | yes |" in lines
    assert "| fas, exact: positions | float64 | 3.0e-12 | 1e-09 | yes |" in lines
    assert "| fas, exact: energies | float64 | 2.0e-07 | 1e-08 | NO |" in lines


def test_speed():
    text = page(found())
    assert "| 1000 | float32 | fas | 0.2500 | 400 | 0.6250 | 398 | True | 1.00 |" in text
    assert "| 1000 | float32 | vertices | terms | 1.0000 | 3000 | 0.75 | 6000 |" in text
    assert "failed: ValueError: no" in text
    assert "plain 500 us" in text


def test_what_was_not_run():
    text = page({"environment": ENVIRONMENT, "correctness": {"failure": "Traceback\nKeyError: 3"}})
    assert text.count("Not run:") == 2
    assert "KeyError: 3" in text
    assert "Not run: compute-sanitizer is not installed." in page(found())
