# SPDX-License-Identifier: BSD-3-Clause
"""PLY surfaces, ASCII and binary: vertex positions and faces, other properties are skipped.

meshio's reader knows the face list only as ``vertex_indices`` and takes ``uchar`` counts as signed; scans say
``vertex_index`` just as often.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from meshes.errors import MeshError
from meshes.io.raw import RawMesh
from meshes.types import TriMesh

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
_FACE_LISTS = ("vertex_indices", "vertex_index")


@dataclass
class _Element:
    name: str
    count: int
    scalars: list[tuple[str, str]] = field(default_factory=list)
    lists: dict[str, tuple[str, str]] = field(default_factory=dict)


def read_ply(path: Path) -> RawMesh:
    """Read vertices and faces of a PLY file.

    Raises
    ------
    MeshError
        Not a PLY file, cut off, no positions or no faces.
    """
    with path.open("rb") as stream:
        order, elements = _header(stream, path)
        try:
            content = _read_ascii(stream, elements) if order == "" else _read_binary(stream, elements, order)
        except (ValueError, IndexError, MemoryError) as error:
            raise MeshError("is damaged or cut off", where=str(path), found=str(error)[:120]) from error
    points, faces = content
    return RawMesh(points, faces)


def write_ply(path: Path, mesh: TriMesh) -> None:
    """Write a binary PLY file with float64 positions."""
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(mesh.points)}\nproperty double x\nproperty double y\nproperty double z\n"
        f"element face {len(mesh.cells)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(mesh.cells), [("n", "u1"), ("v", "<i4", 3)])
    faces["n"], faces["v"] = 3, mesh.cells
    with path.open("wb") as stream:
        stream.write(header.encode("ascii"))
        stream.write(mesh.points.astype("<f8").tobytes())
        stream.write(faces.tobytes())


def _header(stream: BinaryIO, path: Path) -> tuple[str, list[_Element]]:
    elements: list[_Element] = []
    order = None
    if stream.readline(16).strip() != b"ply":
        raise MeshError("is not a PLY file", where=str(path), found="another first line", allowed="'ply'")
    for _ in range(1000):
        line = stream.readline(4096).decode("ascii", "replace").strip()
        match line.split():
            case ["end_header"]:
                break
            case ["format", name, _]:
                order = _ORDERS.get(name)
            case ["element", name, count] if count.isdigit():
                elements.append(_Element(name, int(count)))
            case ["property", "list", count, value, name] if elements and count in _TYPES and value in _TYPES:
                elements[-1].lists[name] = (_TYPES[count], _TYPES[value])
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].scalars.append((name, _TYPES[kind]))
            case ["comment" | "obj_info", *_]:
                pass
            case _:
                raise MeshError("the PLY header is damaged", where=str(path), found=repr(line[:60]))
    return _checked_header(order, elements, path)


def _checked_header(order: str | None, elements: list[_Element], path: Path) -> tuple[str, list[_Element]]:
    names = [element.name for element in elements]
    size = path.stat().st_size
    if order is None or names[:2] != ["vertex", "face"]:
        raise MeshError("the PLY header is damaged", where=str(path), found=names, allowed="format, vertex, face")
    if max(element.count for element in elements) > size:
        raise MeshError(
            "declares more items than the file can hold",
            where=str(path),
            found=[element.count for element in elements],
            allowed=f"at most {size}",
        )
    vertex, face = elements[:2]
    if not {"x", "y", "z"} <= {name for name, _ in vertex.scalars} or vertex.lists:
        raise MeshError("the PLY vertices have no positions", where=str(path), found=vertex.scalars, allowed="x, y, z")
    if len(face.lists) != 1 or next(iter(face.lists)) not in _FACE_LISTS:
        raise MeshError("the PLY faces have no single vertex list", where=str(path), found=list(face.lists))
    return order, [vertex, face]


def _read_binary(stream: BinaryIO, elements: list[_Element], order: str) -> tuple[NDArray, list[tuple[str, NDArray]]]:
    vertex, face = elements
    layout = np.dtype([(name, order + kind) for name, kind in vertex.scalars])
    rows = np.frombuffer(stream.read(vertex.count * layout.itemsize), layout, vertex.count)
    points = np.stack([rows[axis].astype(np.float64) for axis in "xyz"], axis=1)
    count_type, index_type = next(iter(face.lists.values()))
    data = stream.read()
    width = int(np.frombuffer(data, order + count_type, 1)[0])
    record = np.dtype([("n", order + count_type), ("v", order + index_type, (width,)), *_trailing(face, order)])
    if len(data) >= face.count * record.itemsize:
        faces = np.frombuffer(data, record, face.count)
        if (faces["n"] == width).all():
            return points, [_block(faces["v"].astype(np.int64))]
    return points, _mixed_faces(data, face, order)


def _trailing(face: _Element, order: str) -> list[tuple[str, str]]:
    return [(name, order + kind) for name, kind in face.scalars]


def _mixed_faces(data: bytes, face: _Element, order: str) -> list[tuple[str, NDArray]]:
    count_type, index_type = (np.dtype(order + kind) for kind in next(iter(face.lists.values())))
    skip = sum(np.dtype(kind).itemsize for _, kind in face.scalars)
    blocks, at = [], 0
    for _ in range(face.count):
        width = int(np.frombuffer(data, count_type, 1, at)[0])
        at += count_type.itemsize
        blocks.append(_block(np.frombuffer(data, index_type, width, at).astype(np.int64)[None]))
        at += width * index_type.itemsize + skip
    return blocks


def _read_ascii(stream: BinaryIO, elements: list[_Element]) -> tuple[NDArray, list[tuple[str, NDArray]]]:
    vertex, face = elements
    lines = [line for line in stream.read().decode("ascii").splitlines() if line.strip()]
    if len(lines) < vertex.count + face.count:
        raise ValueError(f"{len(lines)} lines of data, {vertex.count + face.count} declared")
    columns = [[name for name, _ in vertex.scalars].index(axis) for axis in "xyz"]
    rows = [line.split() for line in lines[: vertex.count]]
    points = np.array([[float(row[column]) for column in columns] for row in rows]).reshape(-1, 3)
    blocks = []
    for line in lines[vertex.count : vertex.count + face.count]:
        width, *rest = (int(float(word)) for word in line.split())
        if len(rest) < width:
            raise ValueError(f"a face of {width} vertices names {len(rest)}")
        blocks.append(_block(np.array(rest[:width])[None]))
    return points, blocks


def _block(faces: NDArray) -> tuple[str, NDArray]:
    return {3: "triangle", 4: "quad"}.get(faces.shape[1], "polygon"), faces
