# SPDX-License-Identifier: BSD-3-Clause
"""What a scene file may say: every key with its type, unit, range and default.

The classes are frozen pydantic models that refuse unknown keys. Lengths are in metres, times in seconds, masses in
kilograms, z points up. `femgal.scene.load` reads files into `Scene`; `femgal.scene.build` makes arrays of it.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from femgal.scene.quantities import (
    Count,
    Density,
    DihedralAngle,
    Index,
    Integer,
    Length,
    NotEmpty,
    Number,
    PoissonsRatio,
    Text,
    Unit,
    Vector,
    Words,
    YoungsModulus,
)
from femgal.scene.shapes import Initial, Path, Rest, Rotation, Selector, Table, Turn
from femgal.scene.solver import SolverSettings


class Region(Table):
    """Another material in a part of a body; a later region overrides an earlier one.

    Attributes
    ----------
    id : Region id of the mesh file whose tetrahedra are meant; or
    where : the tetrahedra whose rest centroid the selector holds.
    E, nu, rho : As in `Body`; what is left out keeps the body's value.
    """

    id: Integer | None = None
    where: Selector | None = None
    E: YoungsModulus | None = None
    nu: PoissonsRatio | None = None
    rho: Density | None = None

    @model_validator(mode="after")
    def _says_what_and_where(self) -> Self:
        if (self.id is None) == (self.where is None):
            raise PydanticCustomError("one_of", "give either id or where", {"allowed": "exactly one of id, where"})
        if self.E is None and self.nu is None and self.rho is None:
            raise PydanticCustomError("no_change", "changes nothing", {"allowed": "at least one of E, nu, rho"})
        return self


class Body(Table):
    """One elastic body: its mesh, where it stands, what it is made of, and how it starts.

    The mesh is turned so that `up` points to +z, scaled, and rotated about the centre of its bounding box, in this
    order. A body that is scaled (`height` or `size`) then stands on the plane z = 0 with its bounding box centred
    over the origin; one that is not scaled keeps the coordinates of its file. `translate` is added last. Where a
    surface is filled with tetrahedra, height, size and bounding box are those of the surface, the same for every
    number of vertices; coarse meshes may cut thin tips off.

    Attributes
    ----------
    mesh : Catalogue name (see ``femgal mesh``), or path of a surface or tetrahedral file; relative paths count from
        the folder of the scene file.
    vertices : Number of vertices to tetrahedralise with; leave it out for files that hold tetrahedra.
    slivers : Smallest dihedral angle [degrees] of tetrahedra that are made on purpose, by moving one inner vertex in a
        hundred: what does a bad mesh do to a solver? Left out, the mesh stays as it is.
    height : Extent along `up` after scaling [m].
    size : Longest side of the bounding box after scaling [m]; not together with `height`.
    up : Axis of the mesh file that points up.
    rotate : Turns, applied in the order given.
    translate : Displacement of the placed body [m].
    E : Young's modulus [Pa].
    nu : Poisson's ratio.
    rho : Density [kg/m^3].
    regions : Parts of another material.
    velocity : Initial velocity [m/s]; vertices that a constraint holds start with the constraint's velocity.
    initial : Shape in which the body starts; the rest shape when left out.
    """

    mesh: Annotated[Text, Field(min_length=1), Words("a catalogue name or the path of a mesh file")]
    vertices: Annotated[Count, Field(ge=8)] | None = None
    slivers: DihedralAngle | None = None
    height: Length | None = None
    size: Length | None = None
    up: Literal["x", "y", "z"] = "z"
    rotate: tuple[Turn, ...] = ()
    translate: Annotated[Vector, Unit("m")] = (0.0, 0.0, 0.0)
    E: YoungsModulus
    nu: PoissonsRatio
    rho: Density
    regions: tuple[Region, ...] = ()
    velocity: Annotated[Vector, Unit("m/s")] = (0.0, 0.0, 0.0)
    initial: Initial = Rest(kind="rest")

    @model_validator(mode="after")
    def _one_scaling(self) -> Self:
        if self.height is not None and self.size is not None:
            raise PydanticCustomError("one_of", "height and size both scale", {"allowed": "one of height, size"})
        return self


class Constraint(Table):
    """Vertices whose motion is prescribed, relative to their rest positions; held still without a path.

    Attributes
    ----------
    where : Which vertices, by their rest positions.
    body : Index of the body that the selector looks at; all bodies when left out.
    path : Displacement from the rest position over time.
    rotation : Rotation of the rest positions over time, applied before the displacement (for twisting).
    """

    where: Selector
    body: Index | None = None
    path: Path | None = None
    rotation: Rotation | None = None


def _known_fields(names: tuple[str, ...]) -> tuple[str, ...]:
    from femgal.output.fields import check_fields
    from meshes.errors import InputError

    try:
        return tuple(check_fields(names))
    except InputError as error:
        context = {"found": str(error.found), "allowed": str(error.allowed), "advice": error.advice}
        raise PydanticCustomError("fields", "not a known output field", context) from None


class Output(Table):
    """What a run writes.

    Attributes
    ----------
    fields : Names of output fields.
    format : ``vtkhdf`` (one file for the whole run) or ``vtu`` (one file per frame and a ``.pvd``).
    every : Write each so many frames.
    checkpoint_every : Write a checkpoint each so many frames.
    """

    fields: Annotated[tuple[Text, ...], AfterValidator(_known_fields), Words("a list of field names")] = (
        "displacement",
        "velocity",
        "von_mises",
    )
    format: Literal["vtkhdf", "vtu"] = "vtkhdf"
    every: Count = 1
    checkpoint_every: Count = 10


class Scene(Table):
    """A complete scene.

    Attributes
    ----------
    name, description : For people; a scene without a name has that of its file.
    frames : Number of frames.
    frames_per_second : Frames per second of simulated time.
    gravity : Acceleration of every body [m/s^2].
    damping : Mass-proportional Rayleigh damping alpha [1/s]: the force -alpha m v.
    bodies, constraints, solver, output : The tables described above.
    """

    name: Text = "scene"
    description: Text = ""
    frames: Count = 60
    frames_per_second: Annotated[Number, Field(ge=1e-6, le=1e9), Unit("1/s")] = 60.0
    gravity: Annotated[Vector, Unit("m/s^2")] = (0.0, 0.0, -9.81)
    damping: Annotated[Number, Field(ge=0), Unit("1/s")] = 0.0
    bodies: Annotated[tuple[Body, ...], NotEmpty, Words("at least one [[bodies]] table")]
    constraints: tuple[Constraint, ...] = ()
    solver: SolverSettings = SolverSettings()
    output: Output = Output()

    @model_validator(mode="after")
    def _bodies_exist(self) -> Self:
        for number, constraint in enumerate(self.constraints):
            if constraint.body is not None and constraint.body >= len(self.bodies):
                context = {
                    "key": f"constraints[{number}].body",
                    "found": str(constraint.body),
                    "allowed": f"0 <= body <= {len(self.bodies) - 1}",
                }
                raise PydanticCustomError("no_such_body", "no such body", context)
        return self
