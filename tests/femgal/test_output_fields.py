# SPDX-License-Identifier: BSD-3-Clause
"""The catalogue of output fields.

1. Every entry is complete and stands under its own name; static ones are ids.
2. `cluster_<layer>` exists for every layer number and for nothing else.
3. `check_fields` keeps the order, drops repetitions, and refuses unknown names with the allowed list.
"""

from __future__ import annotations

import pytest

from femgal.output.fields import FIELDS, check_fields, find_field, unit_of
from meshes.errors import InputError


def test_catalogue_is_complete():
    static = {"region", "material", "body"}
    assert {"displacement", "velocity", "residual", "von_mises", "J", "energy_density"} | static == set(FIELDS)
    for name, field in FIELDS.items():
        assert field.name == name
        assert field.kind in ("point", "cell")
        assert field.components in (1, 3, 9)
        assert field.unit
        assert field.description
        assert not field.static or field.unit == "-"


@pytest.mark.parametrize(
    ("name", "unit"), [("displacement", "m"), ("von_mises", "Pa"), ("total_energy", "J"), ("x", "")]
)
def test_units(name, unit):
    assert unit_of(name) == unit


def test_clusters():
    field = find_field("cluster_12")
    assert (field.name, field.kind, field.static) == ("cluster_12", "point", True)
    for wrong in ("cluster_", "cluster_-1", "cluster_01", "cluster_1x", "cluster"):
        assert find_field(wrong) is None


def test_check_fields():
    assert check_fields(["J", "cluster_0", "displacement", "J"]) == ("J", "cluster_0", "displacement")
    assert check_fields("von_mises") == ("von_mises",)
    assert check_fields([]) == ()
    with pytest.raises(InputError) as caught:
        check_fields(["J", "strss", 3], where="beam.toml: output.fields")
    message = str(caught.value)
    assert "beam.toml: output.fields" in message
    assert "'strss', 3" in message
    assert "von_mises" in message
    assert "cluster_<layer>" in message
