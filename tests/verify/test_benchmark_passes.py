# SPDX-License-Identifier: BSD-3-Clause
"""The passes that are timed.

1. Every variant offers the same passes under unique names: gradient, blocks on every layer, Hessian product, energies,
   work at nodes, substeps.
2. Each call makes the pass that its name says, once, over as many tetrahedra as it says.
3. A call changes nothing that a later one uses: the same bits come out again.
4. Every pass but whole substeps has a model of its bytes.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.kernels.backend import Passes
from verify.benchmark.body import benchmark_body, kuhn_box
from verify.benchmark.passes import BLOCKS, CORRECTION, SUBSTEPS, VARIANTS, all_passes, make_backend

BODY = benchmark_body(kuhn_box(6), ratio=8)
LAYERS = BODY.hierarchy.layers


def passes_of(variant):
    backend = make_backend(variant, BODY, 1)
    return backend, {entry.name: entry for entry in all_passes(backend, BODY)}


def test_names():
    names = [[entry.name for entry in all_passes(make_backend(variant, BODY, 1), BODY)] for variant in VARIANTS]
    assert all(set(other) <= set(names[0]) for other in names)
    for each in names:
        assert len(set(each)) == len(each)
        assert {"gradient", BLOCKS, CORRECTION, "Hessian product", "energy", "energy along a line", *SUBSTEPS} <= set(
            each
        )
        assert sum(name.startswith(f"{BLOCKS}, layer") for name in each) == len(LAYERS) - 1 >= 2


@pytest.mark.parametrize("variant", VARIANTS)
def test_calls_make_their_pass(variant):
    backend, passes = passes_of(variant)
    share = [layer.n_pairs / LAYERS[0].n_pairs for layer in LAYERS]
    expected = {
        "gradient": Passes(gradient=1.0),
        BLOCKS: Passes(gradient_and_blocks=1.0),
        CORRECTION: Passes(gradient_and_blocks=1.0),
        "Hessian product": Passes(hessian_product=1.0),
        "energy": Passes(energy=1.0),
        "energy along a line": Passes(energy=len(LAYERS[0].active) / BODY.disc.n_tets),
        "node work: solve": Passes(),
        "node work: prolong": Passes(),
        next(iter(SUBSTEPS)): Passes(gradient_and_blocks=sum(share)),
    }
    expected |= {f"{BLOCKS}, layer {k}": Passes(gradient_and_blocks=share[k]) for k in range(1, len(LAYERS))}
    for name, counts in expected.items():
        backend.passes = Passes()
        passes[name].call()
        assert backend.passes.as_dict() == pytest.approx(counts.as_dict(), rel=1e-12), name
    assert passes["gradient"].tets == BODY.disc.n_tets
    assert passes[f"{BLOCKS}, layer 1"].tets == len(LAYERS[1].active) < BODY.disc.n_tets


@pytest.mark.parametrize("variant", VARIANTS)
def test_calls_can_be_repeated(variant):
    _, passes = passes_of(variant)
    x = BODY.x.copy()

    def bits():
        g, H = passes[BLOCKS].call()
        states = [passes[name].call() for name in SUBSTEPS]
        return [array.tobytes() for array in (passes["gradient"].call(), g, H, *(state.x for state in states))]

    before = bits()
    for entry in passes.values():
        entry.call()
    assert bits() == before
    assert (BODY.x == x).all()
    moved = [passes[name].call() for name in SUBSTEPS]
    assert all(np.isfinite(state.x).all() and (state.x != x).any() for state in moved)


def test_bytes():
    for variant in VARIANTS:
        for name, entry in passes_of(variant)[1].items():
            assert (entry.bytes_per_tet is None) == (name in SUBSTEPS)
            assert entry.bytes_per_tet is None or 1.0 <= entry.bytes_per_tet <= 149.0
    assert passes_of("plain")[1][BLOCKS].bytes_per_tet == 149.0
