# SPDX-License-Identifier: BSD-3-Clause
"""Tiled passes against the plain float64 passes, which are checked against scikit-fem.

1. Gradients, blocks, corrections, Hessian products, energies, energies along a line: to 1e-12 in float64 and 2e-5 in
   float32 of the largest term of the same pass, at the finest layer, constant clusters and layers with four parents,
   with and without constrained vertices, at rest, deformed, stretched to 20 times, and inverted.
2. Meshes of any number of tetrahedra: less than a tile, a whole block, one more.
3. The same bits for 1, 2 and 3 threads, in both precisions.
4. float32 forgets neither a far translation nor a long fall: forces at 1000 m from the origin are those at rest.
5. The force noise of float32 at rest is zero, at a strain of 1e-4 below 1e-4 of the force, and with the body turned by
   45 degrees besides below 2e-3 of it: 2e-7 of Young's modulus.
6. A body in free fall moves as gravity says, to 1e-6 in both precisions, at 400 substeps per frame.
7. The float32 loops over lanes convert nothing to float64: not one conversion in their machine code.
"""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from femgal.hierarchy.hierarchy import build_constant_hierarchy
from femgal.hierarchy.layer import Layer
from femgal.kernels.cpu import tile_arithmetic
from femgal.kernels.cpu.backend import CpuBackend
from femgal.kernels.cpu.simd import W
from femgal.kernels.cpu.tiles import BLOCK, REST
from femgal.kernels.plain.backend import PlainBackend
from femgal.scene.load import parse_scene
from femgal.simulation import Simulation
from meshes.generators import box
from meshes.jit import kernel
from meshes.types import TetMesh
from verify.problems.bodies import STATES, distorted_box, force_scale, left_end, linear_layer, positions, rng, varied

MESH = distorted_box((14, 9, 9))
CONSTRAINED = {"free": (), "solid": left_end(MESH, 0.25)}
LAYERS = ("vertices", "clusters of 8", "clusters of 64", "made up")
TOLERANCE = {"float64": 1e-12, "float32": 2e-5}
CASES = [(c, p, s) for c in CONSTRAINED for p in TOLERANCE for s in STATES]
INVERSE_H2 = 1e4


@cache
def body(constrained: str):
    return varied(MESH, CONSTRAINED[constrained])


@cache
def layers(constrained: str) -> dict[str, Layer]:
    built = {one.name: one for one in build_constant_hierarchy(body(constrained), 8).layers}
    return {**built, "made up": linear_layer(body(constrained))}


@cache
def backend(constrained: str, kind: str):
    finest = layers(constrained)["vertices"]
    if kind == "plain":
        return PlainBackend(body(constrained), 1, finest)
    return CpuBackend(body(constrained), 1, finest, kind)


def assert_close(one: np.ndarray, two: np.ndarray, precision: str, scale: float | None = None) -> None:
    scale = np.abs(two).max() if scale is None else scale
    assert np.abs(one - two).max() <= TOLERANCE[precision] * scale


@pytest.mark.parametrize(("constrained", "precision", "state"), CASES)
def test_finest_passes(constrained, precision, state):
    plain, tiled = backend(constrained, "plain"), backend(constrained, precision)
    x, d = positions(MESH, state), rng(300).standard_normal(MESH.points.shape)
    scale = force_scale(plain.disc, x)
    assert_close(tiled.gradient(x), plain.gradient(x), precision, scale)
    assert_close(tiled.hessian_product(x, d), plain.hessian_product(x, d), precision)
    # Fixed sweeps of rotations end at another rounding than the exact eigenvectors of either precision.
    definite, scale = plain.hessian_product(x, d, definite=True), {"float64": 1.0, "float32": 10.0}[precision]
    assert_close(tiled.hessian_product(x, d, definite=True), definite, precision, scale * np.abs(definite).max())
    energy, J = plain.energies(x)
    tiled_energy, tiled_J = tiled.energies(x)
    assert_close(tiled_energy, energy, precision, np.abs(energy).max() + plain.disc.Vmu.max())
    assert_close(tiled_J, J, precision, np.abs(J).max())


@pytest.mark.parametrize("name", LAYERS)
@pytest.mark.parametrize(("constrained", "precision", "state"), CASES)
def test_layer_passes(constrained, precision, state, name):
    plain, tiled, layer = backend(constrained, "plain"), backend(constrained, precision), layers(constrained)[name]
    x = positions(MESH, state)
    xhat = x + 1e-3 * rng(301).standard_normal(x.shape)
    # A coarse node sums the forces of all elements on its rim, which nearly cancel.
    scale = force_scale(plain.disc, x) * max(1.0, np.sqrt(layer.n_pairs / layer.n_nodes / 20.0))
    g, H = plain.gradient_and_blocks(layer, x, xhat, INVERSE_H2)
    tiled_g, tiled_H = tiled.gradient_and_blocks(layer, x, xhat, INVERSE_H2)
    assert_close(tiled_g, g, precision, max(scale, np.abs(g).max()))
    assert (np.abs(tiled_H - H).max(axis=1) <= TOLERANCE[precision] * np.abs(H).max(axis=1)).all()
    np.testing.assert_array_equal(tiled.nodal_gradient(layer, x, xhat, 0.0).shape, g.shape)
    assert_close(tiled.nodal_gradient(layer, x, xhat, INVERSE_H2), g, precision, max(scale, np.abs(g).max()))

    d = np.zeros_like(x)
    plain.prolong(layer, rng(302).standard_normal(g.shape), d)
    product = plain.nodal_product(layer, x, d, INVERSE_H2)
    assert_close(tiled.nodal_product(layer, x, d, INVERSE_H2), product, precision)
    along = plain.energies_along(layer, x, 1e-3 * d)
    # The first coefficient is a sum over forces that nearly cancel, the others are not.
    slope_scale = scale * np.abs(1e-3 * d).max() * len(layer.active) ** 0.5
    tiled_along = tiled.energies_along(layer, x, 1e-3 * d)
    assert abs(tiled_along[0] - along[0]) <= TOLERANCE[precision] * (slope_scale + abs(along[0]))
    assert (np.abs(tiled_along - along)[1:] <= TOLERANCE[precision] * np.abs(along).max()).all()


@pytest.mark.parametrize("scalar", [False, True])
@pytest.mark.parametrize("name", LAYERS)
def test_corrections(name, scalar):
    plain, layer = backend("solid", "plain"), layers("solid")[name]
    x = positions(MESH, "random")
    for precision in TOLERANCE:
        dx, slope = plain.correction(layer, x, MESH.points, INVERSE_H2, 0.7, scalar=scalar)
        tiled_dx, tiled_slope = backend("solid", precision).correction(
            layer, x, MESH.points, INVERSE_H2, 0.7, scalar=scalar
        )
        assert_close(tiled_dx, dx, precision)
        assert slope < 0.0
        assert tiled_slope == pytest.approx(slope, rel=TOLERANCE[precision])


@pytest.mark.parametrize("count", [1, W - 1, W, BLOCK - 1, BLOCK, BLOCK + 1, 2 * BLOCK])
def test_any_number_of_tetrahedra(count):
    whole = box(cells=(8, 8, 6), jitter=0.1)
    cells = whole.cells[:count]
    used, cells = np.unique(cells, return_inverse=True)
    disc = varied(TetMesh(whole.points[used], cells.reshape(-1, 4)))
    x = disc.mesh.points + 0.02 * rng(303).standard_normal(disc.mesh.points.shape)
    plain, tiled = PlainBackend(disc, 1), CpuBackend(disc, 1)
    assert_close(tiled.gradient(x), plain.gradient(x), "float64", force_scale(disc, x))
    assert tiled.energies(x)[0].sum() == pytest.approx(plain.energies(x)[0].sum(), rel=1e-12)


@pytest.mark.parametrize("precision", TOLERANCE)
def test_same_bits_for_any_thread_count(precision):
    disc, layer = body("solid"), layers("solid")["clusters of 8"]
    x, d = positions(MESH, "random"), rng(304).standard_normal(MESH.points.shape)
    results = []
    for threads in (1, 2, 3):
        tiled = CpuBackend(disc, threads, layers("solid")["vertices"], precision)
        dx, slope = tiled.correction(layer, x, MESH.points, INVERSE_H2)
        results.append(
            [
                tiled.gradient(x),
                tiled.hessian_product(x, d),
                tiled.hessian_product(x, d, definite=True),
                *tiled.energies(x),
                *tiled.gradient_and_blocks(layer, x, MESH.points, INVERSE_H2),
                *tiled.gradient_and_blocks(tiled.vertices, x, MESH.points, INVERSE_H2),
                tiled.nodal_gradient(layer, x, MESH.points, INVERSE_H2),
                tiled.nodal_product(layer, x, d, INVERSE_H2),
                tiled.energies_along(layer, x, d),
                tiled.inertia_along(x, MESH.points, d, INVERSE_H2),
                dx,
                np.array([slope, tiled.largest(dx)]),
            ]
        )
    for other in results[1:]:
        for one, two in zip(results[0], other, strict=True):
            assert one.tobytes() == two.tobytes()


def test_sums_over_nodes_have_the_same_bits():
    n = 20_000
    a, b, c = (rng(305 + k).standard_normal((n, 3)) for k in range(3))
    H = np.abs(rng(308).standard_normal((n, 6))) + np.array([3.0, 0.0, 0.0, 3.0, 0.0, 3.0])
    old = H * (1.0 + 0.1 * rng(309).random((n, 1)))
    results = []
    for threads in (1, 2, 3):
        tiled = CpuBackend(body("free"), threads)
        tiled.disc = replace(tiled.disc, mass=rng(310).random(n))
        moved = a.copy()
        tiled.add_scaled(moved, 0.3, b)
        vectors = [moved, tiled.difference(a, b, 2.0), tiled.predict(a, b, 0.1, c[0]), tiled.solve(a, H, 0.7)]
        sums = [tiled.dot(a, b), tiled.largest(a), *tiled.compare_blocks(a, old, H), *tiled.inertia_along(a, b, c, 3.0)]
        results.append([*vectors, np.array(sums)])
    for other in results[1:]:
        for one, two in zip(results[0], other, strict=True):
            assert one.tobytes() == two.tobytes()
    assert results[0][-1][0] == pytest.approx(float((a * b).sum()), rel=1e-12)


def test_far_from_the_origin_in_float32():
    tiled = backend("free", "float32")
    x = positions(MESH, "random")
    near, far = tiled.gradient(x), tiled.gradient(x + np.array([1000.0, -300.0, 20.0]))
    # What the translation costs is the rounding of double precision positions.
    assert np.abs(near - far).max() <= 1e-6 * np.abs(near).max()


def test_noise_near_rest_in_float32():
    disc, tiled = body("free"), backend("free", "float32")
    assert (tiled.gradient(MESH.points) == 0.0).all()
    strained = MESH.points * (1.0 + 1e-4 * np.array([1.0, -0.3, -0.3]))
    exact = backend("free", "plain").gradient(strained)
    assert np.abs(tiled.gradient(strained) - exact).max() <= 1e-4 * np.abs(exact).max()
    c = np.sqrt(0.5)
    turn = np.array([[c, -c, 0.0], [c, c, 0.0], [0.0, 0.0, 1.0]])
    turned = tiled.gradient(strained @ turn.T) @ turn
    assert np.abs(turned - exact).max() <= 2e-3 * np.abs(exact).max()
    # The same forces from positions in single precision would have no digit to spare.
    rounded = CpuBackend(disc, 1).gradient(strained.astype(np.float32).astype(np.float64))
    assert np.abs(rounded - exact).max() >= 1e-3 * np.abs(exact).max()


@pytest.mark.parametrize("name", ["fas", "verlet"])
@pytest.mark.parametrize("precision", TOLERANCE)
def test_free_fall(precision, name):
    text = FREE_FALL.format(precision=precision, name=name)
    simulation = Simulation.prepare(parse_scene(text, "fall.toml"))
    last = list(simulation.frames())[-1].state
    moved = last.x - simulation.disc.mesh.points
    n, h = 2 * 400, 1.0 / 60.0 / 400
    # Verlet is exact under a constant force, backward Euler takes n (n + 1) / 2 steps of g h^2.
    expected = 0.5 * 9.81 * (n * h) ** 2 if name == "verlet" else 9.81 * h**2 * n * (n + 1) / 2.0
    np.testing.assert_allclose(moved[:, 2], -expected, rtol=1e-6)
    assert np.abs(moved[:, :2]).max() <= 1e-6 * expected


FREE_FALL = """
frames = 2
[[bodies]]
mesh = "beam"
vertices = 300
E = 1e6
nu = 0.4
rho = 1000.0
translate = [5.0, -3.0, 0.7]
[solver]
name = "{name}"
substeps = 400
ratio = 8
precision = "{precision}"
"""


@kernel
def terms_of_tile(points, rest, out):
    tile_arithmetic.tile_terms(points, points, rest, out)


@kernel
def forces_of_tile(points, rest, out):
    tile_arithmetic.tile_forces(points, points, rest, out)


@kernel
def stresses_of_tile(points, rest, out):
    tile_arithmetic.tile_stresses(points, points, rest, out)


@kernel
def pairs_of_tile(points, rest, out):
    tile_arithmetic.tile_pair_terms(points, rest, rest, out)


@kernel
def products_of_tile(points, rest, out):
    tile_arithmetic.tile_products(points, points, points, rest, out)


@kernel
def energies_of_tile(points, rest, out):
    tile_arithmetic.tile_energies(points, points, rest, out)


@kernel
def energies_along_of_tile(points, rest, out):
    tile_arithmetic.tile_energies_along(points, points, points, rest, out)


@kernel
def definite_products_of_tile(points, rest, out):
    tile_arithmetic.tile_definite_products(points, points, points, rest, out)


@kernel
def stress_increments_of_tile(points, rest, out):
    tile_arithmetic.tile_stress_increments(points, points, points, rest, out)


@kernel
def pair_forces_of_tile(points, rest, out):
    tile_arithmetic.tile_pair_forces(points, rest, out)


TILE_KERNELS = (
    definite_products_of_tile,
    stress_increments_of_tile,
    pair_forces_of_tile,
    terms_of_tile,
    forces_of_tile,
    stresses_of_tile,
    pairs_of_tile,
    products_of_tile,
    energies_of_tile,
    energies_along_of_tile,
)
CONVERSION = re.compile(r"\b(v?cvt(ss2sd|sd2ss|ps2pd|pd2ps)|fcvt)")


@pytest.mark.parametrize("loop", TILE_KERNELS, ids=lambda loop: loop.__name__)
def test_no_conversions_in_float32(loop):
    loop(np.zeros(36 * W, np.float32), np.zeros(REST * W, np.float32), np.zeros(36 * W, np.float32))
    signature = next(s for s in loop.signatures if "float32" in str(s))
    text = loop.inspect_asm(signature)
    assert len(text) > 1000
    assert CONVERSION.findall(text) == []


def test_a_conversion_would_be_noticed():
    @kernel
    def careless(points, rest, out):
        for k in range(W):
            out[k] = points[k] * 0.1 + rest[k]

    careless(np.zeros(W, np.float32), np.zeros(W, np.float32), np.zeros(W, np.float32))
    assert CONVERSION.findall(careless.inspect_asm(careless.signatures[0])) != []
