# SPDX-License-Identifier: BSD-3-Clause
"""The catalogue of output fields: what may be asked for, where it lives, in which unit."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from meshes.errors import InputError


@dataclass(frozen=True)
class Field:
    """One output field.

    Parameters
    ----------
    name : str
        Name of the array in the files.
    kind : "point" or "cell"
        One row per vertex, or one row per tetrahedron.
    components : int
        Numbers per row; a 3x3 tensor has 9, row by row.
    unit : str
        SI unit, "-" for pure numbers and ids.
    static : bool
        The same at every frame, so written once.
    description : str
        What the numbers are, for file attributes and documentation.
    """

    name: str
    kind: Literal["point", "cell"]
    components: int
    unit: str
    static: bool
    description: str


_CATALOGUE = (
    Field("displacement", "point", 3, "m", False, "x - X, current minus rest position"),
    Field("velocity", "point", 3, "m/s", False, "velocity of the time stepping method"),
    Field("residual", "point", 1, "m", False, "|(x - xhat) + h^2 M^-1 grad E|, the summand of eps18"),
    Field("von_mises", "cell", 1, "Pa", False, "von Mises norm of the Cauchy stress P F^T / J"),
    Field("J", "cell", 1, "-", False, "det F, the volume ratio; negative where a tetrahedron is inverted"),
    Field("energy_density", "cell", 1, "J/m^3", False, "elastic energy per rest volume"),
    Field("region", "cell", 1, "-", True, "region id, which selects the material"),
    Field("material", "cell", 1, "-", True, "number of the combination of E, nu and rho that the tetrahedron has"),
    Field("body", "cell", 1, "-", True, "id of the body that the tetrahedron belongs to"),
)

FIELDS: Mapping[str, Field] = MappingProxyType({field.name: field for field in _CATALOGUE})
"""All fields with a fixed name; `cluster_<layer>` exists once per coarse layer of the solver."""

GLOBAL_UNITS: Mapping[str, str] = MappingProxyType(
    {
        "time": "s",
        "seconds": "s",
        "kinetic_energy": "J",
        "elastic_energy": "J",
        "potential_energy": "J",
        "total_energy": "J",
        "eps18": "m",
        "min_J": "-",
        "passes": "-",
    }
)
"""Units of the numbers that a frame carries once, in the field data and in run.json."""

_CLUSTER = re.compile(r"cluster_(0|[1-9][0-9]{0,2})")


def find_field(name: str) -> Field | None:
    """Return the catalogue's entry for `name`, None when there is none."""
    layer = _CLUSTER.fullmatch(name)
    if layer:
        meaning = f"node of coarse layer {layer[1]} that moves the vertex most, its cluster; -1 if fixed"
        return Field(name, "point", 1, "-", True, meaning)
    return FIELDS.get(name)


def unit_of(name: str) -> str:
    """Return the unit of a field or of a per-frame number, "" when it is not known."""
    field = find_field(name)
    return field.unit if field else GLOBAL_UNITS.get(name, "")


def check_fields(names: Iterable[str], *, where: str = "output fields") -> tuple[str, ...]:
    """Return the names in their order, each once.

    Parameters
    ----------
    names : iterable of str
        What the user asked for.
    where : str
        File and key that the names come from, for the message.

    Raises
    ------
    InputError
        A name that the catalogue does not have.
    """
    wanted = (names,) if isinstance(names, str) else tuple(names)
    unknown = [name for name in wanted if not isinstance(name, str) or find_field(name) is None]
    if unknown:
        raise InputError(
            "unknown output field",
            where=where,
            found=", ".join(map(repr, unknown)),
            allowed=", ".join([*FIELDS, "cluster_<layer>"]),
        )
    return tuple(dict.fromkeys(wanted))
