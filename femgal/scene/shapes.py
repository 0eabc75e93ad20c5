# SPDX-License-Identifier: BSD-3-Clause
"""The smaller tables of a scene file: selectors, paths, turns and initial shapes."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from femgal.scene.quantities import (
    DEFAULT_SEED,
    Direction,
    Flag,
    Index,
    Length,
    NotEmpty,
    Number,
    Times,
    Unit,
    Vector,
    Words,
)


class Table(BaseModel):
    """A table of the scene file: unknown keys are refused, values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Box(Table):
    """The points between two corners, borders included [m]."""

    min: Vector
    max: Vector

    @model_validator(mode="after")
    def _not_inside_out(self) -> Self:
        if any(low > high for low, high in zip(self.min, self.max, strict=True)):
            raise PydanticCustomError("box", "min is above max", {"allowed": "min <= max on every axis"})
        return self


class Sphere(Table):
    """The points within `radius` [m] of `center` [m]."""

    center: Vector
    radius: Length


class Halfspace(Table):
    """The points on the side of `point` [m] that `normal` points to, border included."""

    point: Vector
    normal: Direction


class Tip(Table):
    """The points within `depth` [m] of the farthest one in `direction`.

    Unlike a region of space it is never empty, however much of an ear or a finger a coarse mesh leaves.
    """

    direction: Direction
    depth: Length


class Selector(Table):
    """A set of vertices or tetrahedra, chosen by rest position; exactly one of the first six keys.

    Attributes
    ----------
    box, sphere, halfspace, tip : A region of space.
    all, none : ``true`` chooses everything or nothing.
    relative : Points count in the bounding box of the body's own vertices, mapped to [0, 1]^3; the radius of a
        sphere and the depth of a tip count in units of its longest side; directions stay as they are.
    """

    box: Box | None = None
    sphere: Sphere | None = None
    halfspace: Halfspace | None = None
    tip: Tip | None = None
    all: Flag = False
    none: Flag = False
    relative: Flag = False

    @model_validator(mode="after")
    def _exactly_one(self) -> Self:
        given = (self.box, self.sphere, self.halfspace, self.tip, self.all or None, self.none or None)
        if sum(choice is not None for choice in given) != 1:
            allowed = "exactly one of box, sphere, halfspace, tip, all = true, none = true"
            raise PydanticCustomError("selector", "not one selection", {"allowed": allowed})
        return self


def _refuse_unequal(times: tuple[float, ...], values: tuple[object, ...], key: str) -> None:
    if len(times) != len(values):
        context = {"found": f"{len(times)} times, {len(values)} {key}", "allowed": f"as many {key} as times"}
        raise PydanticCustomError("unequal", "the lists differ in length", context)


class Path(Table):
    """Displacement over time, piecewise linear; held before the first and after the last time.

    Attributes
    ----------
    times : Times [s], increasing.
    offsets : Displacement from the rest position [m] at each time.
    """

    times: Times
    offsets: tuple[Vector, ...]

    @model_validator(mode="after")
    def _one_offset_per_time(self) -> Self:
        _refuse_unequal(self.times, self.offsets, "offsets")
        return self


class Rotation(Table):
    """Rotation over time, piecewise linear in the angle; held before the first and after the last time.

    Attributes
    ----------
    times : Times [s], increasing.
    degrees : Angle [degrees] at each time, counter-clockwise about `axis`.
    axis : Direction of the axis.
    center : A point of the axis [m]; the centre of the chosen vertices' bounding box when left out.
    """

    times: Times
    degrees: Annotated[tuple[Number, ...], Words("one angle [degrees] per time")]
    axis: Direction
    center: Vector | None = None

    @model_validator(mode="after")
    def _one_angle_per_time(self) -> Self:
        _refuse_unequal(self.times, self.degrees, "degrees")
        return self


class Turn(Table):
    """Rotation of a body by `degrees`, counter-clockwise about `axis`."""

    axis: Direction
    degrees: Annotated[Number, Unit("degrees")]


class Rest(Table):
    """Start in the rest shape."""

    kind: Literal["rest"]


class Random(Table):
    """Start with every vertex drawn uniformly from the bounding box, enlarged about its centre.

    The expanded cube of Smith et al. 2018 and Lu et al. 2025, appendix C.

    Attributes
    ----------
    scale : Factor on every side of the bounding box.
    seed : Seed of the random numbers.
    """

    kind: Literal["random"]
    scale: Annotated[Number, Field(gt=0)] = 2.0
    seed: Index = DEFAULT_SEED


class Flat(Table):
    """Start flattened along `normal` onto the plane through the lowest point.

    Exactly flat by default, as Lu et al. 2025, appendix C: then J = 0 in every tetrahedron, but the cofactor of F
    still points out of the plane to the side of the rest shape, so the body unfolds.

    Attributes
    ----------
    normal : Direction that is flattened.
    thickness : Extent that is left along `normal` [m].
    """

    kind: Literal["flat"]
    normal: Direction = (0.0, 0.0, 1.0)
    thickness: Annotated[Number, Field(ge=0), Unit("m")] = 0.0


class OnSphere(Table):
    """Start with every vertex on a sphere about the centre of the bounding box (Lu et al. 2025, appendix C).

    Attributes
    ----------
    placement : ``random``: anywhere on it, uniformly; ``projected``: along the ray from the centre.
    radius : Radius [m]; half the longest side of the bounding box when left out.
    seed : Seed of the random numbers.
    """

    kind: Literal["sphere"]
    placement: Literal["random", "projected"] = "random"
    radius: Length | None = None
    seed: Index = DEFAULT_SEED


class Pull(Table):
    """Chosen vertices displaced by `offset` [m]."""

    where: Selector
    offset: Annotated[Vector, Unit("m")]


class Stretched(Table):
    """Start in the rest shape with chosen vertices displaced; a vertex in several pulls adds them up."""

    kind: Literal["stretched"]
    pulls: Annotated[tuple[Pull, ...], NotEmpty, Words("at least one {where, offset}")]


Initial = Annotated[Rest | Random | Flat | OnSphere | Stretched, Field(discriminator="kind")]
