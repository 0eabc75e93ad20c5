# SPDX-License-Identifier: BSD-3-Clause
"""The few bad elements that dictate the stable step.

1. One sliver is found: its index, place, altitude and angle, the steps with and without it, and that it alone counts.
2. Of several slivers the worst is named, and as many have to go as there are.
3. `few` is what it says: without so many of the worst the bound of the step is at least twice as long, without one
   fewer it is not.
4. Good meshes have none: boxes, stuffed surfaces, single elements; nor has a body of which a whole part is stiff, or
   whose only sliver is held.
5. The added mass it recommends, as printed, makes the step twice as long.
6. Published meshes: one sliver in one, a fifth of a per cent of the elements in another.
"""

from __future__ import annotations

import re

import numpy as np
import pytest

from femgal.discretisation import Discretisation, discretise
from femgal.timestep.bottleneck import FEW, Bottleneck, find_bottleneck
from femgal.timestep.mass_scaling import scale_mass
from femgal.timestep.stable_step import guaranteed_step, vertex_stiffness
from meshes.generators import box
from meshes.make import make_tets
from meshes.quality import dihedrals
from meshes.types import TetMesh
from tests.femgal.slivers import box_with_slivers, stiffnesses
from verify.problems.bodies import distorted_box, uniform

CELLS = (9, 4, 4)
FLAT = 1e-4


def found_in(disc: Discretisation) -> Bottleneck | None:
    return find_bottleneck(disc, *stiffnesses(disc))


def step_without(disc: Discretisation, removed) -> float:
    """The bound when some elements have no stiffness."""
    stiffness, _ = stiffnesses(disc)
    stiffness[removed] = 0.0
    return guaranteed_step(vertex_stiffness(disc, stiffness), disc.mass)


def slivers_of(mesh: TetMesh, count: int) -> np.ndarray:
    return np.argsort(mesh.volumes)[:count]


def test_one_sliver():
    mesh = box_with_slivers(FLAT, 1, CELLS)
    disc = uniform(mesh)
    found, sliver = found_in(disc), slivers_of(mesh, 1)[0]
    corners = mesh.points[mesh.cells[sliver]]
    assert found is not None
    assert (found.tet, found.few, found.tets) == (sliver, 1, len(mesh.cells))
    np.testing.assert_allclose(found.centroid, corners.mean(axis=0), rtol=1e-12)
    normal = np.cross(corners[2] - corners[1], corners[3] - corners[1])
    altitude = abs((corners[0] - corners[1]) @ normal) / np.linalg.norm(normal)
    assert found.altitude == pytest.approx(altitude, rel=1e-6)
    assert found.dihedral == dihedrals(mesh.points, mesh.cells[[sliver]]).minimum < 0.1
    assert found.step == step_without(disc, [])
    assert found.step_without == pytest.approx(step_without(disc, [sliver]), rel=1e-9)
    assert found.step_without >= 10.0 * found.step


def test_several_slivers():
    mesh = box_with_slivers(FLAT, 4, CELLS)
    found = found_in(uniform(mesh))
    assert found is not None
    assert found.few == 4 <= FEW * len(mesh.cells)
    assert found.tet in slivers_of(mesh, 4)


def test_few_is_as_few_as_said(monkeypatch):
    monkeypatch.setattr("femgal.timestep.bottleneck.FEW", 1.0)
    disc = uniform(distorted_box((5, 3, 3)))
    stiffness, k = stiffnesses(disc)
    found = find_bottleneck(disc, stiffness, k)
    assert found is not None
    score = stiffness * (k / disc.mass**2)[disc.mesh.cells].max(axis=1)
    order = np.argsort(-score, kind="stable")
    assert found.tet == order[0]
    assert step_without(disc, order[: found.few]) >= 2.0 * found.step
    assert step_without(disc, order[: found.few - 1]) < 2.0 * found.step
    assert found.few > 0.5 * disc.n_tets


@pytest.mark.parametrize(
    "mesh",
    [distorted_box(CELLS), box((1.0, 1.0, 0.02), (10, 10, 2), jitter=0.1, seed=30_091), box(cells=(1, 1, 1))],
    ids=["box", "plate", "cube of six"],
)
def test_good_meshes_have_none(mesh):
    assert found_in(uniform(mesh)) is None


def test_single_element_has_none():
    assert found_in(uniform(TetMesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]), [[0, 1, 2, 3]]))) is None


def test_stiff_part_has_none():
    mesh = distorted_box(CELLS)
    E = np.where(mesh.points[mesh.cells].mean(axis=1)[:, 0] < 0.2, 1e7, 1e5)
    assert found_in(discretise(mesh, E, 0.4, 1000.0)) is None


def test_held_sliver_is_no_matter():
    mesh = box_with_slivers(FLAT, 1, CELLS)
    assert found_in(uniform(mesh, mesh.cells[slivers_of(mesh, 1)[0]])) is None


@pytest.mark.parametrize("count", [1, 4])
def test_recommended_mass_doubles_the_step(count):
    disc = uniform(box_with_slivers(FLAT, count, CELLS))
    stiffness, k = stiffnesses(disc)
    found = find_bottleneck(disc, stiffness, k)
    printed = re.search(r"solver\.mass_scaling = (\S+)", str(found))
    assert found is not None
    assert printed is not None
    share = float(printed[1])
    assert found.share <= share <= 1.1 * found.share
    assert scale_mass(disc, k, share)[1].step >= 2.0 * found.step * (1.0 - 1e-9)
    assert f"{found.few} of {found.tets} tetrahedra" in str(found)
    assert f"{found.step:.3g} s" in str(found)


@pytest.mark.parametrize(("name", "few"), [("ipc_bunny", 1), ("ipc_Armadillo13K", 145)])
def test_published_meshes(real_surface, name, few):
    found = found_in(uniform(make_tets(real_surface(name)).mesh))
    assert found is not None
    assert found.few == pytest.approx(few, abs=3)
    assert found.step_without >= (2.0 if few == 1 else 1.1) * found.step


def test_stuffed_surface_has_none(real_surface):
    real_surface("bunny")
    assert found_in(uniform(make_tets("bunny", 3000).mesh)) is None
