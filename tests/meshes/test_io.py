# SPDX-License-Identifier: BSD-3-Clause
"""Mesh files.

1. Tetrahedra survive a round trip in every format that is written: positions, cells in order, regions where the
   format has a place for them; .msh in both versions.
2. Published files load with their known counts.
3. What can be repaired is repaired with a message: winding, unused vertices, ids of .t files from 0, 1 or with gaps.
4. What no solver should see is refused with file, fault, found and allowed: index out of range, NaN, zero volume,
   empty, mixed, quadratic, planar, no tetrahedra, missing, wrong suffix. Slivers are not refused.
5. Cut-off or corrupted files give a MeshError and nothing else, whatever the damage, and print nothing.
6. Headers that declare more than the file holds are refused before anything is allocated.
7. HDF5 that reaches outside its file is refused; so is XDMF that leaves its folder. Every object is looked at once,
   however the hard links run; a torn file gives a MeshError.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from meshes.errors import InputError, MeshError
from meshes.generators import box
from meshes.io.hdf5_guard import check_hdf5
from meshes.io.tets import WRITABLE, read_tets, write_tets
from meshes.types import TetMesh

SEED = 987654321
# Nothing in these tells a cut at the end of a line from the end of the file.
WITHOUT_COUNTS = {".t", ".nas", ".bdf"}
WITHOUT_REGIONS = {".t", ".inp", ".su2"}
TET = "Vertex 0 0 0 0\nVertex 1 1 0 0\nVertex 2 0 1 0\nVertex 3 0 0 1\nTet 0 0 1 2 3\n"


@pytest.fixture
def mesh() -> TetMesh:
    grid = box((1.0, 0.7, 0.5), (3, 2, 2), jitter=0.15)
    return replace(grid, regions=np.arange(len(grid.cells), dtype=np.int32) % 3 + 4)


def refusal(path: Path, *parts: str) -> str:
    """Message of the MeshError that reading must raise; it names the file and holds all parts."""
    with pytest.raises(MeshError) as caught:
        read_tets(path)
    message = str(caught.value)
    for part in (str(path), *parts):
        assert part in message
    return message


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def medit(points: str, cells: str, counts: tuple[int, int]) -> str:
    head = f"MeshVersionFormatted 2\nDimension 3\nVertices\n{counts[0]}\n{points}\n"
    return f"{head}Tetrahedra\n{counts[1]}\n{cells}\nEnd\n"


# 1 ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", WRITABLE)
def test_round_trip_keeps_points_cells_and_regions(tmp_path, mesh, suffix):
    path = tmp_path / f"mesh{suffix}"
    remarks = write_tets(path, mesh)
    back, messages = read_tets(path)
    np.testing.assert_allclose(back.points, mesh.points, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(back.cells, mesh.cells)
    if suffix in WITHOUT_REGIONS:
        assert remarks == [f"{suffix} has no place for regions: they were left out"]
        assert not back.regions.any()
    else:
        np.testing.assert_array_equal(back.regions, mesh.regions)
        assert any("3 (4, 5, 6)" in message for message in messages)
    assert list(tmp_path.iterdir()) == [path], "one file, nothing beside it"


def test_msh_is_version_41_without_regions_and_22_with(tmp_path, mesh):
    write_tets(tmp_path / "with.msh", mesh)
    plain = replace(mesh, regions=np.zeros(len(mesh.cells), np.int32))
    write_tets(tmp_path / "without.msh", plain)
    assert (tmp_path / "with.msh").read_bytes().split()[1] == b"2.2"
    assert (tmp_path / "without.msh").read_bytes().split()[1] == b"4.1"
    np.testing.assert_array_equal(read_tets(tmp_path / "without.msh")[0].cells, mesh.cells)


def test_origin_names_file_and_digest(tmp_path, mesh):
    import hashlib

    path = tmp_path / "body.vtu"
    write_tets(path, mesh)
    origin = read_tets(path)[0].origin
    assert (origin.name, origin.source) == ("body", str(path))
    assert origin.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


def test_unwritable_targets(tmp_path, mesh):
    with pytest.raises(InputError, match=r"(?s)cannot be written in this format.*\.xyz.*\.msh"):
        write_tets(tmp_path / "a.xyz", mesh)
    with pytest.raises(InputError, match="folder does not exist"):
        write_tets(tmp_path / "missing" / "a.vtu", mesh)
    with pytest.raises(InputError, match="is a folder"):
        write_tets(tmp_path, mesh)
    with pytest.raises(InputError, match="cannot be written"):
        write_tets("/proc/mesh.vtu", mesh)


# 2 ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "counts"), [("ipc_bunny", (4670, 19379)), ("ipc_Armadillo13K", (13230, 54985))])
def test_published_meshes_load(name, counts):
    folders = [Path(part) / "tets" for part in os.environ.get("FEMGAL_MESH_PATH", "").split(":") if part]
    found = [path for folder in folders if (path := folder / f"{name}.msh").is_file()]
    if not found:
        pytest.skip(f"FEMGAL_MESH_PATH has no tets/{name}.msh")
    mesh, messages = read_tets(found[0])
    assert (len(mesh.points), len(mesh.cells)) == counts
    assert messages == []


# 3 ------------------------------------------------------------------------------------------------


def test_inverted_cells_are_turned_and_counted(tmp_path, mesh):
    inverted = mesh.cells.copy()
    inverted[[0, 5, 9]] = inverted[[0, 5, 9]][:, [1, 0, 2, 3]]
    lines = [f"Vertex {k} {x} {y} {z}" for k, (x, y, z) in enumerate(mesh.points.tolist())]
    lines += [f"Tet {k} {a} {b} {c} {d}" for k, (a, b, c, d) in enumerate(inverted.tolist())]
    back, messages = read_tets(written(tmp_path / "a.t", "\n".join(lines) + "\n"))
    assert messages == [f"winding repaired: 3 of {len(mesh.cells)} tetrahedra had negative volume"]
    np.testing.assert_allclose(back.volumes, mesh.volumes, rtol=1e-12)


def test_unused_vertices_are_dropped(tmp_path):
    text = TET.replace("Tet", "Vertex 9 5 5 5\nTet")
    mesh, messages = read_tets(written(tmp_path / "a.t", text))
    assert len(mesh.points) == 4
    assert messages == ["dropped 1 of 5 vertices that no cell uses"]


@pytest.mark.parametrize("ids", [(0, 1, 2, 3), (1, 2, 3, 4), (70, 3, 12, 9)])
def test_vertex_ids_of_t_files_are_mapped(tmp_path, ids):
    corners = ["0 0 0", "1 0 0", "0 1 0", "0 0 1"]
    lines = [f"Vertex {k} {p} {{normal=(0 0 1)}}" for k, p in zip(ids, corners, strict=True)]
    lines += ["", f"Tet 1 {' '.join(map(str, ids))}\n"]
    mesh, messages = read_tets(written(tmp_path / "a.t", "\n".join(lines)))
    assert mesh.volumes[0] == pytest.approx(1 / 6)
    assert messages == []


def test_boundary_cells_are_ignored_with_a_message(tmp_path):
    meshio = pytest.importorskip("meshio")
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    cells = [("triangle", [[0, 2, 1]]), ("tetra", [[0, 1, 2, 3]])]
    meshio.vtu.write(str(tmp_path / "a.vtu"), meshio.Mesh(points, cells))
    assert read_tets(tmp_path / "a.vtu")[1] == ["ignored 1 triangle cells"]


# 4 ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "text", "parts"),
    [
        ("range.t", TET.replace("Tet 0 0 1 2 3", "Tet 0 0 1 2 99"), ("does not exist", "vertex id 99")),
        ("nan.t", TET.replace("Vertex 2 0 1 0", "Vertex 2 0 nan 0"), ("not finite", "vertex 2")),
        ("flat.t", TET.replace("Vertex 3 0 0 1", "Vertex 3 1 1 0"), ("zero volume", "tetrahedron 0")),
        ("twice.t", TET.replace("Tet 0 0 1 2 3", "Tet 0 0 1 2 2"), ("zero volume",)),
        ("copy.t", TET + "Tet 1 1 2 0 3\n", ("listed more than once", "tetrahedra 0 and 1", "remove the copies")),
        ("word.t", TET + "Hex 0 0 1 2 3 4 5 6 7\n", ("line 6", "Hex", "'Vertex id x y z'")),
        ("short.t", TET[:-3], ("line 5", "Tet 0 0 1")),
        ("double.t", TET + "Vertex 2 0 0 0\n", ("defined twice", "Vertex 2")),
        ("points.t", TET.partition("Tet")[0], ("holds no tetrahedra", "no cells")),
        ("empty.t", "", ("empty", "0 bytes")),
        ("range.mesh", medit("0 0 0 1\n1 0 0 1\n0 1 0 1\n0 0 1 1", "1 2 3 9 1", (4, 1)), ("does not exist", "0 to 3")),
        ("below.mesh", medit("0 0 0 1\n1 0 0 1\n0 1 0 1\n0 0 1 1", "1 2 3 0 1", (4, 1)), ("does not exist", "-1")),
        ("nan.mesh", medit("0 0 0 1\nnan 0 0 1\n0 1 0 1\n0 0 1 1", "1 2 3 4 1", (4, 1)), ("not finite", "vertex 1")),
        ("a.xyz", "mesh", ("unknown mesh format", ".xyz", ".msh")),
        ("gmsh.vtk", "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n", ("cannot be read", "vtk", "another format")),
        ("exodus.exo", "CDF", ("cannot be read", "exodus")),
    ],
)
def test_broken_meshes_are_refused(tmp_path, capsys, name, text, parts):
    refusal(written(tmp_path / name, text), *parts)
    assert capsys.readouterr().out == ""


def test_missing_file_and_folder(tmp_path):
    refusal(tmp_path / "none.vtu", "no such file", "femgal mesh info", "FEMGAL_MESH_PATH")
    refusal(tmp_path, "is a folder")


@pytest.mark.parametrize(
    ("kind", "width", "parts"),
    [("hexahedron", 8, ("1 tetra, 1 hexahedron", "linear tetrahedra")), ("tetra10", 10, ("1 tetra10", "order 1"))],
)
def test_other_volume_cells_are_refused(tmp_path, kind, width, parts):
    meshio = pytest.importorskip("meshio")
    points = np.random.default_rng(SEED).random((12, 3))
    cells = [("tetra", [[0, 1, 2, 3]]), (kind, [list(range(width))])]
    meshio.vtu.write(str(tmp_path / "a.vtu"), meshio.Mesh(points, cells))
    refusal(tmp_path / "a.vtu", "other than linear tetrahedra", *parts)


def test_voxels_are_not_lost_silently(tmp_path):
    """meshio leaves out cells of types that it does not know, with no more than a warning."""
    arrays = {
        "connectivity": ("Int64", "0 1 2 3 4 5 6 7 4 5 6 8"),
        "offsets": ("Int64", "8 12"),
        "types": ("Int64", "11 10"),
    }
    cells = "".join(f'<DataArray type="{t}" Name="{n}" format="ascii">{v}</DataArray>' for n, (t, v) in arrays.items())
    points = "0 0 0 1 0 0 0 1 0 1 1 0 0 0 1 1 0 1 0 1 1 1 1 1 0 0 2"
    text = (
        '<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian"><UnstructuredGrid>'
        '<Piece NumberOfPoints="9" NumberOfCells="2"><Points>'
        f'<DataArray type="Float64" NumberOfComponents="3" format="ascii">{points}</DataArray></Points>'
        f"<Cells>{cells}</Cells></Piece></UnstructuredGrid></VTKFile>"
    )
    refusal(written(tmp_path / "a.vtu", text), "VTK cell type 11", "tetrahedra (10)")


def test_planar_points_are_refused(tmp_path):
    points = "0 0 1\n1 0 1\n0 1 1\n1 1 1"
    text = medit(points, "1 2 3 4 1", (4, 1)).replace("Dimension 3", "Dimension 2")
    refusal(written(tmp_path / "a.mesh", text), "not points in space", "2 coordinates", "3 coordinates")


def test_slivers_are_accepted(tmp_path):
    mesh, messages = read_tets(written(tmp_path / "a.t", TET.replace("Vertex 3 0 0 1", "Vertex 3 .3 .3 1e-9")))
    assert mesh.volumes[0] == pytest.approx(1e-9 / 6)
    assert messages == []


def test_fractional_regions_are_refused(tmp_path):
    meshio = pytest.importorskip("meshio")
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    data = meshio.Mesh(points, [("tetra", [[0, 1, 2, 3]])], cell_data={"region": [np.array([1.5])]})
    meshio.vtu.write(str(tmp_path / "a.vtu"), data)
    refusal(tmp_path / "a.vtu", "'region'", "whole number")


# 5 ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.02, 0.3, 0.6])
@pytest.mark.parametrize("suffix", [s for s in WRITABLE if s not in WITHOUT_COUNTS])
def test_cut_off_files_are_refused(tmp_path, capsys, mesh, suffix, share):
    path = tmp_path / f"mesh{suffix}"
    write_tets(path, mesh)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    refusal(path)
    assert capsys.readouterr().out == ""


def test_cut_t_file_is_noticed(tmp_path, mesh):
    path = tmp_path / "mesh.t"
    write_tets(path, mesh)
    path.write_bytes(path.read_bytes()[:-3])
    _, messages = read_tets(written(path, path.read_text() + "0"))
    assert messages[0] == "the last line has no line end: the file may be cut off"


@pytest.mark.parametrize("suffix", [*WRITABLE, ".med", ".cgns", ".h5m", ".off", ".vol", ".ugrid", ".dat", ".e"])
def test_garbage_is_refused(tmp_path, suffix):
    path = tmp_path / f"mesh{suffix}"
    path.write_bytes(np.random.default_rng(SEED).bytes(4000))
    refusal(path)


@pytest.mark.parametrize("suffix", WRITABLE)
def test_damaged_files_never_raise_anything_else(tmp_path, mesh, suffix):
    path = tmp_path / f"mesh{suffix}"
    write_tets(path, mesh)
    data = np.frombuffer(path.read_bytes(), np.uint8)
    random = np.random.default_rng(SEED)
    outcomes = set()
    for _ in range(40):
        broken = data.copy()
        where = random.integers(0, len(data), 3)
        broken[where] = random.integers(0, 256, 3)
        path.write_bytes(broken.tobytes())
        try:
            loaded, _ = read_tets(path)
        except MeshError:
            outcomes.add("refused")
        else:
            assert (loaded.volumes > 0).all()
            outcomes.add("read")
    assert outcomes <= {"refused", "read"}
    assert "refused" in outcomes


# 6 ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "text"),
    [
        (
            "a.vtk",
            "# vtk DataFile Version 4.2\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 900000000000 double\n0 0 0\n",
        ),
        ("a.msh", "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 1000000000000 1 1000000000000\n3 1 0 1\n"),
        ("b.msh", "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n1000000000000\n1 0 0 0\n"),
        ("a.mesh", medit("0 0 0 1", "1 1 1 1 1", (900000000000, 1))),
    ],
)
def test_impossible_counts_are_refused_before_allocation(tmp_path, name, text):
    message = refusal(written(tmp_path / name, text), "declares more items than the file can hold")
    assert "000000000" in message


# 7 ------------------------------------------------------------------------------------------------


def test_hdf5_that_reaches_outside_is_refused(tmp_path):
    h5py = pytest.importorskip("h5py")
    secret = written(tmp_path / "secret.bin", "x" * 800)
    for name, make in {
        "external.med": lambda f: f.create_dataset("a", (100,), "f8", external=[(str(secret), 0, 800)]),
        "link.h5m": lambda f: f.__setitem__("a", h5py.ExternalLink("other.h5", "/a")),
        "bomb.cgns": lambda f: f.create_dataset("a", (10**12,), "f8", chunks=(1000,)),
    }.items():
        with h5py.File(tmp_path / name, "w") as file:
            make(file.create_group("mesh"))
        refusal(tmp_path / name, "refused", "/mesh/a")


@pytest.mark.parametrize(
    ("item", "part"),
    [
        ('<DataItem Format="HDF" Dimensions="4 3">../other.h5:/points</DataItem>', "../other.h5"),
        ('<DataItem Format="HDF" Dimensions="4 3">missing.h5:/points</DataItem>', "missing.h5"),
        ('<DataItem Format="Binary" Dimensions="4 3">/etc/hostname</DataItem>', "Binary"),
    ],
)
def test_xdmf_that_leaves_its_folder_is_refused(tmp_path, item, part):
    text = f'<Xdmf Version="3.0"><Domain><Grid><Geometry>{item}</Geometry></Grid></Domain></Xdmf>'
    refusal(written(tmp_path / "a.xdmf", text), part)


def test_xdmf_of_an_unknown_encoding_or_an_impossible_name(tmp_path):
    refusal(written(tmp_path / "a.xdmf", '<?xml version="1.0" encoding="no-such"?><Xdmf/>'), "not well-formed XML")
    item = f'<Xdmf><DataItem Format="HDF">{"a" * 5000}.h5:/points</DataItem></Xdmf>'
    refusal(written(tmp_path / "b.xdmf", item), "names a file that is missing")


def test_hard_links_in_a_circle(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "circle.med"
    with h5py.File(path, "w") as file:
        inner = file.create_group("a/b/c")
        inner["up"], inner["top"] = file["a"], file["/"]
        inner["data"] = np.arange(4.0)
    check_hdf5(path)
    refusal(path, "cannot be read", "med")
    with h5py.File(path, "a") as file:
        file["a/b/c"].create_dataset("outside", (10,), "f8", external=[("other.bin", 0, 80)])
    refusal(path, "refused", "/outside stored in other files")


def test_groups_far_deeper_than_calls_may_nest(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "deep.h5m"
    with h5py.File(path, "w") as file:
        group = file
        for _ in range(3000):
            group = group.create_group("g")
        group.create_dataset("bomb", (10**12,), "f8", chunks=(1000,))
    refusal(path, "refused", "/g/g/g/bomb of 8000000000000 bytes")


def test_torn_hdf5_gives_a_mesh_error(tmp_path):
    h5py = pytest.importorskip("h5py")
    whole = tmp_path / "whole.h5"
    with h5py.File(whole, "w") as file:
        for k in range(12):
            file.create_group(f"group {k}").create_dataset("values", data=np.arange(30.0), chunks=(10,), shuffle=True)
    data = np.frombuffer(whole.read_bytes(), np.uint8)
    random = np.random.default_rng(SEED)
    messages = []
    for k in range(300):
        torn = data.copy()
        start = random.integers(0, len(data) - 64)
        torn[start : start + random.integers(1, 64)] = random.integers(0, 256)
        path = written(tmp_path / f"{k}.h5", "")
        path.write_bytes(torn.tobytes())
        try:
            check_hdf5(path)
        except MeshError as error:
            messages.append((str(path), str(error)))
    assert 20 < len(messages) < 300
    assert all(path in message for path, message in messages)
