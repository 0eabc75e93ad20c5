# SPDX-License-Identifier: BSD-3-Clause
"""Cases of matrix-free blocks.

1. Every quick row passes, and all hierarchies, meshes and precisions that the quick suite promises are among them.
2. One wrong entry of one block, gradient, product or correction is noticed, in either precision.
3. An element that is left out although a node deforms it is counted; where none is left out the row is skipped, and
   it notices a wrong pass.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from verify.cases import blocks
from verify.problems.bodies import body
from verify.reference.galerkin import assembled, layers
from verify.suite.run import Status, choose, run_row
from verify.suite.use import Use

ROWS = choose("blocks/", quick=True)
USE = Use(threads=1)


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_quick_rows(row):
    result = run_row(row, USE)
    assert result.status is Status.PASS, result


def test_quick_rows_are_there():
    names = {str(row) for row in ROWS}
    for hierarchy in ("clusters-8", "clusters-32", "lattice"):
        for precision in ("float64", "float32"):
            assert f"blocks/coarse-blocks[{hierarchy},rabbit,{precision}]" in names
    assert {"blocks/vertex-blocks[box,float32]", "blocks/left-out-elements[clusters-32,rabbit]"} <= names


class Wrong:
    """A backend with one entry of every array that it returns wrong by a share of the largest."""

    def __init__(self, backend, share: float) -> None:
        self._backend, self._share = backend, share

    def __getattr__(self, name: str):
        found = getattr(self._backend, name)
        if name not in ("gradient", "nodal_gradient", "gradient_and_blocks", "hessian_product", "nodal_product"):
            return found
        return lambda *args, **kwargs: self._spoilt(found(*args, **kwargs))

    def _spoilt(self, arrays):
        for one in arrays if isinstance(arrays, tuple) else (arrays,):
            worst = np.unravel_index(np.argmax(np.abs(one)), one.shape)
            one[worst] *= 1.0 + self._share
        return arrays


MEASURES = (blocks._gradient, blocks._blocks, blocks._hessian_products, blocks._nodal_products)


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("measure", MEASURES, ids=lambda one: one.__name__)
def test_one_wrong_entry_is_noticed(measure, precision):
    disc = body("box")
    right, tolerance = USE.backend(disc, precision), {"float64": 1e-12, "float32": 2e-5}[precision]
    wrong = Wrong(right, 100.0 * tolerance)
    for one, fails in ((right, False), (wrong, True)):
        found = measure(one, assembled(disc, "random"), right.vertices)
        assert (max(part.error for part in found.values()) > tolerance) == fails


def test_left_out_elements(monkeypatch):
    (row,) = choose("blocks/left-out-elements[clusters-8,rabbit]")
    backend = Use.backend
    with monkeypatch.context() as context:
        context.setattr(Use, "backend", lambda *args: Wrong(backend(*args), 1e-9))
        result = run_row(row, USE)
    assert result.status is Status.FAIL
    assert "without them" in result.note
    everything = np.arange(body("rabbit").n_tets, dtype=np.int32)
    whole = lambda *args: tuple(replace(layer, active=everything) for layer in layers(*args))  # noqa: E731
    monkeypatch.setattr(blocks, "layers", whole)
    assert run_row(row, USE).status is Status.SKIP


def test_missing_element_is_counted(monkeypatch):
    disc, whole = body("box"), layers

    def without_one(disc, hierarchy):
        return tuple(replace(layer, active=layer.active[1:]) for layer in whole(disc, hierarchy))

    monkeypatch.setattr(blocks, "layers", without_one)
    assert blocks.active_elements(USE, mesh="box").error == 1.0
    assert disc.n_tets == 576
