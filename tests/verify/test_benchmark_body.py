# SPDX-License-Identifier: BSD-3-Clause
"""The body that passes are timed on.

1. One end is held and stays where it is; everything else is displaced, moves, and is not turned inside out.
2. It has coarse layers, and few_tets has one too.
3. It is the same at every call, and of the size asked for.
"""

from __future__ import annotations

import numpy as np

from femgal.kernels.plain.backend import PlainBackend
from meshes.generators import beam
from verify.benchmark.body import benchmark_body, few_tets, kuhn_box


def test_state():
    mesh = kuhn_box(8)
    body = benchmark_body(mesh)
    held = ~body.disc.free
    assert held.sum() == 9 * 9
    for values, still in ((body.x, mesh.points), (body.v, np.zeros_like(body.x)), (body.xhat, mesh.points)):
        assert (values == still)[held].all()
        assert (values != still)[~held].any(axis=1).all()
    J = PlainBackend(body.disc, 1).energies(body.x)[1]
    assert 0.3 <= J.min() <= 0.95
    assert 1.05 <= J.max() <= 3.0
    (motion,) = body.motions
    assert motion.is_fixed
    np.testing.assert_array_equal(motion.positions(1.0), mesh.points[held])


def test_hierarchies():
    assert len(benchmark_body(kuhn_box(11), 32).hierarchy.layers) == 2
    few = few_tets()
    assert len(few.hierarchy.layers) == 2
    assert few.disc.n_tets == 12
    assert len(few.hierarchy.layers[1].active) >= 1


def test_same_every_time():
    first, second = kuhn_box(4), kuhn_box(4)
    assert len(first.cells) == 6 * 4**3
    assert first.content_hash == second.content_hash
    assert benchmark_body(first).x.tobytes() == benchmark_body(second).x.tobytes()


def test_other_meshes():
    body = benchmark_body(beam(vertices=900))
    assert 0 < (~body.disc.free).sum() < 0.1 * body.disc.n_vertices
