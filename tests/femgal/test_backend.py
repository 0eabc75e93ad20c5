# SPDX-License-Identifier: BSD-3-Clause
"""Element passes against scikit-fem, and what equilibrium, affine maps and threads demand of them.

1. Gradient at the free vertices equals the assembled one; at constrained vertices it is exactly zero.
2. The same where elements have no free vertex, so that the finest layer does not list every element.
3. Hessian products equal the assembled matrix times a vector, in the cases of 1 and 2.
   The definite product is that of the element matrices with their negative eigenvalues left out.
4. Elastic energies sum to the assembled one; J of an affine map is its determinant.
5. Patch test: an affine map of the whole mesh leaves no force at inner vertices, inverted maps included.
6. Forces of a free body sum to zero, and so do their moments about the origin.
7. Forces turn with the body and do not see translations.
8. Gradient, Hessian product, energies, blocks of a coarse layer and sums have the same bits for 1, 2 and 3 threads.
9. Von Mises stress: of a uniaxial and of a sheared state in closed form, zero of a dilation, infinite without volume.
10. Block solves equal dense solves; `scalar` uses only the diagonal.
11. Passes count one per call over all tetrahedra, and coarse layers by their share of pairs.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.hierarchy.hierarchy import build_constant_hierarchy
from femgal.kernels.plain.backend import PlainBackend
from meshes.generators import box
from meshes.types import TetMesh
from verify.problems.bodies import STATES, distorted_box, force_scale, left_end, positions, rng, uniform, varied
from verify.reference.elasticity import AssembledElasticity
from verify.reference.transfer import unpacked

MESH = distorted_box()
REFERENCE = AssembledElasticity(MESH, varied(MESH).mu, varied(MESH).lam)
# None, one face, and two layers of cells: all four vertices of every third element are constrained then.
CONSTRAINED = {"free": (), "face": left_end(MESH), "solid": left_end(MESH, 0.25)}

CASES = [(constrained, state) for constrained in CONSTRAINED for state in STATES]


@pytest.mark.parametrize(("constrained", "state"), CASES)
def test_gradient_equals_assembled(constrained, state):
    disc, x = varied(MESH, CONSTRAINED[constrained]), positions(MESH, state)
    g = PlainBackend(disc, 1).gradient(x)
    assert np.abs(g - REFERENCE.gradient(x))[disc.free].max() <= 1e-13 * force_scale(disc, x)
    assert (g[~disc.free] == 0.0).all()


@pytest.mark.parametrize(("constrained", "state"), CASES)
def test_hessian_product_equals_assembled(constrained, state):
    disc, x = varied(MESH, CONSTRAINED[constrained]), positions(MESH, state)
    H = REFERENCE.hessian(x)
    backend = PlainBackend(disc, 1)
    for salt in range(3):
        d = rng(100 + salt).standard_normal(x.shape)
        # Constrained vertices may be given a motion too: the product then holds their pull on the free ones.
        expected = (H @ d.ravel()).reshape(-1, 3)
        Hd = backend.hessian_product(x, d)
        assert np.linalg.norm((Hd - expected)[disc.free]) <= 1e-13 * np.linalg.norm(expected)
        assert (Hd[~disc.free] == 0.0).all()


@pytest.mark.parametrize("state", STATES)
def test_definite_hessian_product(state):
    mesh = distorted_box((3, 2, 2))
    disc, x, d = varied(mesh), positions(mesh, state), rng(110).standard_normal(mesh.points.shape)
    expected = np.zeros_like(d)
    for e, four in enumerate(mesh.cells):
        alone = TetMesh(mesh.points[four], np.array([[0, 1, 2, 3]]))
        K = AssembledElasticity(alone, disc.mu[e], disc.lam[e]).hessian(x[four]).toarray()
        # K = D A D^T with A the Hessian in terms of F: the filter acts on A.
        B = disc.B[e].reshape(3, 3)
        D = np.kron(np.vstack([-B.sum(axis=0), B]), np.eye(3))
        A = np.linalg.pinv(D) @ K @ np.linalg.pinv(D).T
        values, modes = np.linalg.eigh(0.5 * (A + A.T))
        filtered = (modes * np.maximum(values, 0.0)) @ modes.T
        expected[four] += (D @ (filtered @ (D.T @ d[four].ravel()))).reshape(4, 3)
    backend = PlainBackend(disc, 1)
    Hd, plain = backend.hessian_product(x, d, definite=True), backend.hessian_product(x, d)
    assert np.linalg.norm(Hd - expected) <= 1e-9 * np.linalg.norm(expected)
    assert (d * Hd).sum() >= (d * plain).sum() * (1.0 - 1e-12)
    if state != "rest":
        assert np.linalg.norm(Hd - plain) >= 1e-3 * np.linalg.norm(plain)


@pytest.mark.parametrize("state", STATES)
def test_energies_equal_assembled(state):
    disc, x = varied(MESH), positions(MESH, state)
    energy, J = PlainBackend(disc, 1).energies(x)
    # At rest Psi is a difference of terms of the size of mu.
    assert abs(energy.sum() - REFERENCE.energy(x)) <= 1e-13 * (disc.Vmu.sum() + abs(REFERENCE.energy(x)))
    assert ((J < 0.0).any(), (J > 0.0).any()) == {
        "rest": (False, True),
        "random": (True, True),
        "stretched": (False, True),
        "inverted": (True, False),
    }[state]


AFFINE = {
    "random": np.eye(3) + 0.5 * rng(10).standard_normal((3, 3)),
    "inverted": np.diag([1.0, -1.0, 1.0]) + 0.2 * rng(11).standard_normal((3, 3)),
    "flat": np.diag([1.3, 0.8, 0.0]),
}


@pytest.mark.parametrize("name", AFFINE)
def test_patch(name):
    disc, x = uniform(MESH), MESH.points @ AFFINE[name].T + [0.3, -2.0, 1.0]
    backend = PlainBackend(disc, 1)
    low, high = MESH.points.min(axis=0) + 1e-9, MESH.points.max(axis=0) - 1e-9
    inner = ((MESH.points > low) & (MESH.points < high)).all(axis=1)
    assert inner.sum() >= 50
    g = backend.gradient(x)
    assert np.abs(g[inner]).max() <= 1e-12 * force_scale(disc, x)
    # The same forces are far from zero at the boundary: the test is not about a body without stress.
    assert np.abs(g[~inner]).max() >= 1e-2 * force_scale(disc, x)
    np.testing.assert_allclose(backend.energies(x)[1], np.linalg.det(AFFINE[name]), atol=1e-12)


@pytest.mark.parametrize("state", STATES)
def test_forces_and_moments_sum_to_zero(state):
    disc, x = varied(MESH), positions(MESH, state)
    g = PlainBackend(disc, 1).gradient(x)
    scale = force_scale(disc, x)
    assert np.abs(g.sum(axis=0)).max() <= 1e-12 * scale
    assert np.abs(np.cross(x, g).sum(axis=0)).max() <= 1e-12 * scale * np.abs(x).max()


def test_forces_are_objective():
    disc, x = varied(MESH), positions(MESH, "random")
    backend = PlainBackend(disc, 1)
    Q = np.linalg.qr(rng(12).standard_normal((3, 3)))[0]
    Q *= np.sign(np.linalg.det(Q))
    turned = backend.gradient(x @ Q.T + [5.0, -3.0, 2.0])
    # The translation costs two digits of the edges: 5 m against 0.1 m.
    np.testing.assert_allclose(turned, backend.gradient(x) @ Q.T, atol=1e-13 * force_scale(disc, x), rtol=0)


def test_same_bits_for_any_thread_count():
    mesh = box(cells=(10, 9, 9), jitter=0.1)
    assert len(mesh.points) > 1024
    assert len(mesh.cells) > 4 * 1024
    disc = varied(mesh, left_end(mesh))
    layer = build_constant_hierarchy(disc, 4).layers[1]
    x, d = mesh.points + 0.02 * rng(13).standard_normal(mesh.points.shape), rng(14).standard_normal(mesh.points.shape)
    results = []
    for threads in (1, 2, 3):
        backend = PlainBackend(disc, threads)
        g, H = backend.gradient_and_blocks(layer, x, mesh.points, 1e4)
        moved = x.copy()
        backend.prolong(layer, backend.solve(g, H, 0.7), moved)
        elastic = [backend.gradient(x), backend.hessian_product(x, d), *backend.energies(x), backend.von_mises(x)]
        along = backend.energies_along(backend.vertices, x, d)
        results.append([*elastic, g, H, moved, backend.restrict(layer, d), along])
    for other in results[1:]:
        for one, two in zip(results[0], other, strict=True):
            assert one.tobytes() == two.tobytes()


ONE_TET = TetMesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]), np.array([[0, 1, 2, 3]]))


def von_mises(F: np.ndarray) -> float:
    return float(PlainBackend(uniform(ONE_TET), 1).von_mises(ONE_TET.points @ np.asarray(F).T)[0])


def test_von_mises_closed_forms():
    disc = uniform(ONE_TET)
    mu, lam = disc.mu[0], disc.lam[0]
    s = 1.7  # uniaxial, free sides: the only Cauchy stress is P11 s / J = P11 / t^2
    J = 1.0 + mu / lam * (1.0 - 1.0 / s)
    t = np.sqrt(J / s)
    assert von_mises(np.diag([s, t, t])) == pytest.approx(mu * (s - J / s**2) / t**2, rel=1e-12)
    g = 0.8  # simple shear: sigma_12 = mu g, sigma_11 = mu g^2
    assert von_mises(np.eye(3) + g * np.outer([1, 0, 0], [0, 1, 0])) == pytest.approx(
        mu * np.sqrt(g**4 + 3.0 * g**2), rel=1e-12
    )
    assert von_mises(1.3 * np.eye(3)) <= 1e-12 * mu
    assert von_mises(np.diag([-1.2, 1.0, 1.0])) == pytest.approx(mu / 1.2 * (1.2**2 - 1.0), rel=1e-12)


@pytest.mark.parametrize("stretches", [(1.0, 1.0, 0.0), (1.0, 0.0, 0.0)])
def test_von_mises_without_volume(stretches):
    assert von_mises(np.diag(stretches)) == np.inf


def test_block_solves():
    backend = PlainBackend(uniform(ONE_TET), 1)
    A = rng(15).standard_normal((50, 3, 3))
    A = A @ A.transpose(0, 2, 1) + 0.1 * np.eye(3)
    H, g = A[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]].copy(), rng(16).standard_normal((50, 3))
    np.testing.assert_array_equal(unpacked(H)[:, 1, 0], H[:, 1])
    # Cramer's rule loses the condition number, at most a few thousand here.
    np.testing.assert_allclose(backend.solve(g, H, 0.3), -0.3 * np.linalg.solve(A, g[..., None])[..., 0], rtol=1e-10)
    diagonal = np.einsum("kii->ki", A)
    np.testing.assert_allclose(backend.solve(g, H, 0.3, scalar=True), -0.3 * g / diagonal, rtol=1e-14)


def test_passes_are_counted():
    disc = varied(MESH)
    hierarchy = build_constant_hierarchy(disc, 8)
    backend = PlainBackend(disc, 1, hierarchy.layers[0])
    x = MESH.points
    backend.gradient(x)
    backend.hessian_product(x, x)
    backend.energies(x)
    for layer in hierarchy.layers:
        backend.gradient_and_blocks(layer, x, x, 1.0)
    assert backend.passes.as_dict() == {
        "gradient": 1.0,
        "gradient_and_blocks": pytest.approx(hierarchy.complexity, rel=1e-12),
        "hessian_product": 1.0,
        "energy": 1.0,
        "matrix": 0.0,
    }
    assert backend.passes.total == pytest.approx(3.0 + hierarchy.complexity, rel=1e-12)
