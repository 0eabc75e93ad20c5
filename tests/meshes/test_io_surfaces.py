# SPDX-License-Identifier: BSD-3-Clause
"""Surface files.

1. Surfaces survive a round trip as PLY, OBJ and STL.
2. Quads and polygons are split without changing the volume; STL corners merge; PLY lists may be called vertex_index,
   be big-endian, of mixed width, and followed by other properties.
3. Broken, cut-off, open-ended and foreign files are refused with file, fault and place.
4. Volumes are not surfaces.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from meshes.errors import InputError, MeshError
from meshes.generators import box, icosphere
from meshes.io.surfaces import read_surface, write_surface
from meshes.io.tets import write_tets
from meshes.types import TriMesh


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


@pytest.mark.parametrize(("suffix", "tolerance"), [(".ply", 0.0), (".obj", 0.0), (".stl", 1e-7)])
def test_surface_round_trip(tmp_path, suffix, tolerance):
    surface = icosphere(2)
    path = tmp_path / f"ball{suffix}"
    write_surface(path, surface)
    back = read_surface(path)
    assert (len(back.points), len(back.cells)) == (len(surface.points), len(surface.cells))
    assert back.enclosed_volume == pytest.approx(surface.enclosed_volume, rel=max(tolerance, 1e-14))
    corners, expected = back.points[back.cells], surface.points[surface.cells]
    np.testing.assert_allclose(corners, expected, rtol=0, atol=tolerance)
    assert back.origin.source == str(path)


QUADS = {
    ".obj": "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n"
    "f 4/1 3/2 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf -8 -4 -1 -5\n",
    ".ply": "ply\nformat ascii 1.0\ncomment c\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
    "property uchar red\nelement face 6\nproperty list uchar int vertex_index\nend_header\n"
    "0 0 0 9\n1 0 0 9\n1 1 0 9\n0 1 0 9\n0 0 1 9\n1 0 1 9\n1 1 1 9\n0 1 1 9\n"
    "4 3 2 1 0\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 0 4 7 3\n",
    ".off": "OFF\n8 12 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n1 0 1\n1 1 1\n0 1 1\n"
    "3 3 2 1\n3 3 1 0\n3 4 5 6\n3 4 6 7\n3 0 1 5\n3 0 5 4\n3 1 2 6\n3 1 6 5\n3 2 3 7\n3 2 7 6\n3 0 4 7\n3 0 7 3\n",
}


@pytest.mark.parametrize("suffix", QUADS)
def test_cube_of_quads_becomes_twelve_triangles(tmp_path, suffix):
    cube = read_surface(written(tmp_path / f"cube{suffix}", QUADS[suffix]))
    assert cube.cells.shape == (12, 3)
    assert cube.enclosed_volume == pytest.approx(1.0)


def test_binary_ply_of_triangles_and_pentagons(tmp_path):
    """A pyramid over a pentagon, big-endian, with a property after each face list."""
    angle = 2 * np.pi * np.arange(5) / 5
    points = np.concatenate([np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1), [[0.0, 0.0, 1.0]]])
    faces = [[4, 3, 2, 1, 0], *([k, (k + 1) % 5, 5] for k in range(5))]
    header = (
        "ply\nformat binary_big_endian 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 6\nproperty list uchar uint vertex_indices\nproperty short group\nend_header\n"
    )
    body = points.astype(">f4").tobytes()
    body += b"".join(struct.pack(f">B{len(f)}Ih", len(f), *f, 7) for f in faces)
    path = tmp_path / "a.ply"
    path.write_bytes(header.encode() + body)
    area = 2.5 * np.sin(2 * np.pi / 5)
    assert read_surface(path).enclosed_volume == pytest.approx(area / 3, rel=1e-6)


def test_ascii_stl_merges_corners(tmp_path):
    a, b, c, d = "0 0 0", "1 0 0", "0 1 0", "0 0 1"
    facets = [(a, c, b), (a, b, d), (b, c, d), (c, a, d)]
    loops = [
        "facet normal 0 0 0\nouter loop\n" + "".join(f"vertex {p}\n" for p in f) + "endloop\nendfacet" for f in facets
    ]
    path = written(tmp_path / "a.stl", "solid tet\n" + "\n".join(loops) + "\nendsolid tet\n")
    surface = read_surface(path)
    assert (len(surface.points), len(surface.cells)) == (4, 4)
    assert surface.enclosed_volume == pytest.approx(1 / 6)


@pytest.mark.parametrize(
    ("name", "content", "parts"),
    [
        ("a.ply", b"solid", ("not a PLY file",)),
        ("b.ply", QUADS[".ply"].replace("vertex 8", "vertex 800000").encode(), ("declares more items",)),
        ("c.ply", QUADS[".ply"][:-20].encode(), ("damaged or cut off",)),
        ("d.ply", QUADS[".ply"].replace("4 3 2 1 0", "4 3 2 1 8").encode(), ("does not exist", "0 to 7")),
        ("e.ply", QUADS[".ply"].replace("float z", "float w").encode(), ("no positions",)),
        ("f.ply", QUADS[".ply"].replace("1 1 1 9", "1 inf 1 9").encode(), ("not finite", "vertex 6")),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1\nf 1 2 3\n", ("line 3", "'v 0 1'")),
        ("b.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", ("does not exist", "[0, 1, 3]")),
        ("c.obj", b"# nothing\n", ("holds no surface", "no cells")),
        ("a.stl", b"\x01" * 200, ("neither a complete binary nor an ASCII STL",)),
        ("b.stl", b"solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0", ("cut off",)),
        ("a.jpg", b"JFIF", ("unknown surface format", ".ply")),
        ("a.off", b"", ("empty",)),
    ],
)
def test_broken_surfaces_are_refused(tmp_path, name, content, parts):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(MeshError) as caught:
        read_surface(path)
    for part in (str(path), *parts):
        assert part in str(caught.value)


def test_cut_binary_surfaces_are_refused(tmp_path):
    for suffix in (".ply", ".stl"):
        path = tmp_path / f"ball{suffix}"
        write_surface(path, icosphere(1))
        path.write_bytes(path.read_bytes()[:-7])
        with pytest.raises(MeshError, match=r"cut off|neither"):
            read_surface(path)


def test_a_volume_is_not_a_surface(tmp_path):
    mesh = box(cells=(1, 1, 1))
    write_tets(tmp_path / "a.vtu", mesh)
    with pytest.raises(MeshError, match="holds no surface"):
        read_surface(tmp_path / "a.vtu")
    with pytest.raises(InputError, match="surfaces cannot be written"):
        write_surface(tmp_path / "a.vtu", TriMesh(mesh.points[:3], [[0, 1, 2]]))
