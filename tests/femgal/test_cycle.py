# SPDX-License-Identifier: BSD-3-Clause
"""The order in which cycles smooth the layers.

1. Sequences for one to four layers are those written by hand.
2. With pre = 0, V is coarse-to-fine, and the default is one smoothing of every layer from coarse to fine.
3. Every layer is smoothed as often as its place in the recursion says, in deep hierarchies too.
4. Sequences are shown in full when short, and with their length when long.
"""

from __future__ import annotations

from collections import Counter

import pytest

from femgal.solvers.cycle import Cycle, shown

BY_HAND = {
    ("coarse-to-fine", 0, 1): ["0", "1 0", "2 1 0", "3 2 1 0"],
    ("coarse-to-fine", 0, 2): ["00", "11 00", "22 11 00", "33 22 11 00"],
    ("V", 1, 1): ["0", "0 1 0", "0 1 2 1 0", "0 1 2 3 2 1 0"],
    ("V", 2, 1): ["00", "00 11 0", "00 11 22 1 0", "00 11 22 33 2 1 0"],
    ("V", 1, 0): ["0", "0 1", "0 1 2", "0 1 2 3"],
    ("F", 1, 1): ["0", "0 1 0", "0 121 121 0", "0 1232 2321 12321 0"],
    ("F", 0, 1): ["0", "1 0", "21 21 0", "32 321 321 0"],
    ("W", 1, 1): ["0", "0 1 0", "0 121 121 0", "0 1232 2321 1232 2321 0"],
    ("W", 0, 1): ["0", "1 0", "21 21 0", "32 321 32 321 0"],
}


@pytest.mark.parametrize(("cycle", "sequences"), BY_HAND.items(), ids=str)
def test_sequences(cycle, sequences):
    for n_layers, expected in enumerate(sequences, start=1):
        assert Cycle(*cycle).schedule(n_layers) == tuple(int(c) for c in expected.replace(" ", ""))


@pytest.mark.parametrize("n_layers", [1, 2, 5])
def test_coarse_to_fine_is_half_a_v(n_layers):
    assert Cycle("V", 0, 3).schedule(n_layers) == Cycle("coarse-to-fine", 0, 3).schedule(n_layers)
    assert Cycle().schedule(n_layers) == tuple(reversed(range(n_layers)))


@pytest.mark.parametrize(("pre", "post"), [(1, 1), (0, 2), (3, 1)])
@pytest.mark.parametrize("n_layers", [2, 4, 7])
@pytest.mark.parametrize("kind", ["V", "F", "W"])
def test_visits(kind, n_layers, pre, post):
    def times(layer):
        return {"V": 1, "F": layer + 1, "W": 2**layer}[kind]

    found = Counter(Cycle(kind, pre, post).schedule(n_layers))
    coarsest = n_layers - 1
    assert found == {
        **{layer: (pre + post) * times(layer) for layer in range(coarsest)},
        # Visited from each smoothing cycle of the layer above it, once.
        coarsest: max(pre, post) * times(coarsest - 1),
    }


def test_shown():
    assert shown(Cycle("V", 1, 1).schedule(3)) == "0 1 2 1 0"
    assert shown(Cycle("coarse-to-fine", 0, 3).schedule(2)) == "1x3 0x3"
    assert str(Cycle()) == "coarse-to-fine(1)"
    assert str(Cycle("W", 2, 1)) == "W(2, 1)"
    long = shown(Cycle("W", 1, 1).schedule(9))
    assert len(long) < 80
    assert long.startswith("0 1 2 3 4 5 6 7 8 7 7 8 7 6 6")
    assert long.endswith(f"2 1 0 ({len(Cycle('W', 1, 1).schedule(9))} in all)")
