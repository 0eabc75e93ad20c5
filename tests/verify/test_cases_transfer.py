# SPDX-License-Identifier: BSD-3-Clause
"""Cases about transfer between layers.

1. Every quick row passes, for each hierarchy.
2. A wrong weight in the restriction, a node that moves a fixed vertex, a torn node and a lattice that is shifted are
   each seen by the row named for it. A builder that makes no coarse layer is red.
3. The barycentric coordinates of the reference reproduce positions, and sum to one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from verify.cases import transfer
from verify.problems.bodies import body, mean_edge
from verify.suite.run import Status, choose, run, run_row
from verify.suite.use import Use

coarse_layers, nodes_of = transfer.coarse_layers, transfer.nodes_of


def test_quick_rows_pass():
    rows = choose("transfer/*", quick=True)
    assert {row.values["hierarchy"] for row in rows if "hierarchy" in row.values} == set(transfer.HIERARCHIES)
    assert len(rows) >= 18
    assert [str(one.row) for one in run(rows, Use()) if one.status is not Status.PASS] == []


def status(name: str) -> Status:
    (row,) = choose(f"transfer/{name}")
    return run_row(row, Use()).status


def wrong_restriction(layer):
    return replace(layer, child_weight=layer.child_weight * np.where(layer.child == layer.child[-1], 1.001, 1.0))


def wrong_weights(layer):
    return replace(layer, weight=1.001 * layer.weight)


def moves_fixed(layer):
    return replace(layer, parent=np.where(layer.parent < 0, 0, layer.parent).astype(np.int32))


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("transpose", wrong_restriction),
        ("assembled", wrong_restriction),
        ("translation", wrong_weights),
        ("fixed-vertices", moves_fixed),
    ],
)
def test_faults_are_noticed(monkeypatch, name, fault):
    monkeypatch.setattr(transfer, "coarse_layers", lambda *a: tuple(fault(one) for one in coarse_layers(*a)))
    assert status(f"{name}[rabbit,constant-8]") is Status.FAIL


def test_a_missing_layer_is_noticed(monkeypatch):
    build = transfer.build_constant_hierarchy
    alone = lambda *a: replace(build(*a), layers=build(*a).layers[:1])  # noqa: E731
    monkeypatch.setattr(transfer, "build_constant_hierarchy", alone)
    monkeypatch.setattr(transfer, "coarse_layers", coarse_layers.__wrapped__)
    for name in ("translation", "fixed-vertices", "transpose", "assembled", "connected-nodes"):
        assert status(f"{name}[rabbit,constant-8]") is Status.FAIL


def test_a_shifted_lattice_is_noticed(monkeypatch):
    shifted = lambda *a: replace(nodes_of(*a), position=nodes_of(*a).position + 0.001)  # noqa: E731
    monkeypatch.setattr(transfer, "nodes_of", shifted)
    assert status("linear-fields[rabbit,2.5]") is Status.FAIL
    assert status("lattice-weights[rabbit,2.5]") is Status.FAIL


def test_a_torn_node_is_noticed():
    disc = body("rabbit")
    layer = coarse_layers(disc, "constant-8")[0]
    assert transfer.support_parts(disc, layer) == layer.n_nodes
    # The first vertex of the last node goes to the first node, far away.
    child = layer.child.copy()
    child[0], child[-1] = layer.child[-1], layer.child[0]
    assert transfer.support_parts(disc, replace(layer, child=child)) > layer.n_nodes


def test_barycentric():
    disc = body("rabbit")
    one = transfer.barycentric(disc, 2.5 * mean_edge(disc.mesh))
    np.testing.assert_allclose(one.weight.sum(axis=1), 1.0, atol=1e-8)
    mean = (one.weight[:, :, None] * one.corner).sum(axis=1)
    assert np.abs(mean - disc.mesh.points).max() <= 1e-8
