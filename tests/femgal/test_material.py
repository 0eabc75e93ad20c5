# SPDX-License-Identifier: BSD-3-Clause
"""Stable neo-Hookean material: derivatives, closed forms, parameters and symmetries at any deformation gradient.

States: rest, random, inverted (det F < 0), collapsed to a plane, to a line and to a point.

1. Energy and stress agree: the Taylor remainder of the energy falls with order 2, with the Hessian term with order 3.
2. The energy along a line is the polynomial of degree 6 whose coefficients `energy_along` gives.
3. The Hessian action is the central difference of the stress to 1e-8, and symmetric.
4. Closed forms: uniaxial with free sides, equibiaxial with free thickness, confined (P11 linear in the stretch),
   simple shear with its Poynting stress, dilation; at rest and under rotations energy and stress vanish.
5. Parameters: slopes of the uniaxial response at small strain give back E and nu; without the added mu they would not.
6. Objectivity: Psi(QF) = Psi(F), P(QF) = Q P(F).  Isotropy: Psi(FQ) = Psi(F), P(FQ) = P(F) Q.
7. node_gradient is P u, node_block the Hessian's block along a (x) u, positive definite at any F, collapsed ones too.
8. In float32 the formulas do no float64 arithmetic, and agree with float64 to 1e-5.
9. The definite Hessian is the 9x9 Hessian with its negative eigenvalues set to zero, at 6,000 gradients of every kind
   (1e-13 in float64, 1e-5 in float32): so symmetric, positive semi-definite, and the Hessian itself where that is
   definite. Without material it is zero. The loop around it is vectorised.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numba
import numpy as np
import pytest

from femgal.discretisation import Discretisation, discretise
from femgal.hierarchy.layer import build_layer
from femgal.kernels.plain.backend import PlainBackend
from femgal.materials import stable_neo_hookean as material
from femgal.materials.stable_neo_hookean import parameters
from femgal.materials.tensor import cofactor
from meshes.types import TetMesh
from tests.femgal.gradients import COUNT as MANY
from tests.femgal.gradients import GRADIENTS, LANES, from_tiles, to_tiles
from verify.problems.bodies import rng, slopes
from verify.reference.transfer import unpacked

MU, LAM = (float(p) for p in parameters(1e5, 0.4))
I = np.eye(3)  # noqa: E741
COUNT = 20
STATES = {
    "rest": np.repeat(I[None], COUNT, axis=0),
    "random": I + 0.5 * rng(40).standard_normal((COUNT, 3, 3)),
    "inverted": np.diag([-1.0, 1.1, 0.9]) + 0.1 * rng(41).standard_normal((COUNT, 3, 3)),
    "flat": np.diag([1.3, 0.7, 0.0]) @ np.linalg.qr(rng(42).standard_normal((COUNT, 3, 3)))[0],
    "line": np.diag([1.3, 0.0, 0.0]) @ np.linalg.qr(rng(43).standard_normal((COUNT, 3, 3)))[0],
    "point": np.zeros((COUNT, 3, 3)),
}
DIRECTIONS = rng(44).standard_normal((2, COUNT, 3, 3))


@cache
def separate(count: int, mu: float, lam: float) -> Discretisation:
    """Tetrahedra of their own with unit edges along the axes, so that B = I: one for each F."""
    corner = np.concatenate([np.zeros((1, 3)), I])
    mesh = TetMesh(np.tile(corner, (count, 1)), np.arange(4 * count).reshape(-1, 4))
    disc = discretise(mesh, 1.0, 0.3, 1.0)
    mus, lams = np.full(count, mu), np.full(count, lam)
    return replace(disc, mu=mus, lam=lams, Vmu=mus / 6.0, Vlam=lams / 6.0)


@cache
def backend(count: int, mu: float, lam: float) -> PlainBackend:
    return PlainBackend(separate(count, mu, lam), 1)


def moved(F: np.ndarray) -> np.ndarray:
    """Vertices of those tetrahedra at the deformation gradients F, shape [k, 3, 3]."""
    return np.concatenate([np.zeros((len(F), 1, 3)), F.transpose(0, 2, 1)], axis=1).reshape(-1, 3)


def tensors(forces: np.ndarray) -> np.ndarray:
    """P from the forces V P e_k on the last three vertices."""
    return 6.0 * forces.reshape(-1, 4, 3)[:, 1:].transpose(0, 2, 1)


def energy(F: np.ndarray, mu: float = MU, lam: float = LAM) -> np.ndarray:
    energies, J = backend(len(F), mu, lam).energies(moved(F))
    np.testing.assert_allclose(J, np.linalg.det(F), rtol=0, atol=1e-12)
    return 6.0 * energies


def stress(F: np.ndarray, mu: float = MU, lam: float = LAM) -> np.ndarray:
    return tensors(backend(len(F), mu, lam).gradient(moved(F)))


def stress_increment(F: np.ndarray, dF: np.ndarray) -> np.ndarray:
    return tensors(backend(len(F), MU, LAM).hessian_product(moved(F), moved(dF)))


@pytest.mark.parametrize("state", STATES)
def test_taylor_remainders(state):
    F, dF = STATES[state], DIRECTIONS[0] / np.linalg.norm(DIRECTIONS[0], axis=(1, 2))[:, None, None]
    # Psi along a line is a polynomial of degree 6, so the steps may be long; they stay clear of rounding.
    steps = 2.0 ** -np.arange(5.0, 10.0)
    first, second = [], []
    for t in steps:
        remainder = energy(F + t * dF) - energy(F) - t * (stress(F) * dF).sum(axis=(1, 2))
        first.append(np.abs(remainder).sum())
        second.append(np.abs(remainder - 0.5 * t * t * (stress_increment(F, dF) * dF).sum(axis=(1, 2))).sum())
    np.testing.assert_allclose(slopes(first)[-3:], 2.0, atol=0.1)
    # At a point Psi has no cubic term except det dF itself; the order is 3 there too.
    np.testing.assert_allclose(slopes(second)[-3:], 3.0, atol=0.1)


@pytest.mark.parametrize("state", STATES)
def test_energy_along_a_line(state):
    F, dF = STATES[state], DIRECTIONS[0]
    one = backend(COUNT, MU, LAM)
    coefficients = 6.0 * one.energies_along(one.vertices, moved(F), moved(dF))
    for t in (-0.7, 1e-3, 0.4, 1.0, 2.0):
        change = (energy(F + t * dF) - energy(F)).sum()
        terms = coefficients * t ** np.arange(1, 7)
        # The difference of two energies is rounded at their size, the sum of the terms at theirs.
        rounding = np.abs(terms).sum() + np.abs(energy(F)).sum() + COUNT * MU
        assert abs(terms.sum() - change) <= 1e-13 * rounding


@pytest.mark.parametrize("state", STATES)
def test_hessian_action(state):
    F, (dF, dG) = STATES[state], DIRECTIONS
    t = 1e-5  # truncation t^2 ~ 1e-10, rounding 1e-16 / t ~ 1e-11, both times the norms of a few random tensors
    difference = (stress(F + t * dF) - stress(F - t * dF)) / (2.0 * t)
    dP = stress_increment(F, dF)
    assert np.linalg.norm(difference - dP) <= 1e-8 * np.linalg.norm(dP)
    one, two = (dP * dG).sum(axis=(1, 2)), (stress_increment(F, dG) * dF).sum(axis=(1, 2))
    scale = np.linalg.norm(dP, axis=(1, 2)) * np.linalg.norm(dG, axis=(1, 2))
    assert (np.abs(one - two) / scale).max() <= 1e-13


def one(F: np.ndarray) -> tuple[float, np.ndarray]:
    return float(energy(np.asarray(F)[None])[0]), stress(np.asarray(F)[None])[0]


@pytest.mark.parametrize("s", [0.6, 0.95, 1.0, 1.4, 3.0])
def test_uniaxial(s):
    J = 1.0 + MU / LAM * (1.0 - 1.0 / s)
    t = np.sqrt(J / s)
    np.testing.assert_allclose(one(np.diag([s, t, t]))[1], np.diag([MU * (s - J / s**2), 0, 0]), atol=1e-12 * LAM)


@pytest.mark.parametrize("s", [0.6, 1.0, 2.0])
def test_equibiaxial(s):
    t = (LAM + MU) * s**2 / (MU + LAM * s**4)
    P = MU * (s - t**2 / s)
    np.testing.assert_allclose(one(np.diag([s, s, t]))[1], np.diag([P, P, 0]), atol=1e-12 * LAM)


@pytest.mark.parametrize("s", [-0.5, 0.0, 0.3, 1.0, 2.5])
def test_confined(s):
    expected = np.diag([(LAM + MU) * (s - 1.0), (s - 1.0) * (LAM * s - MU), (s - 1.0) * (LAM * s - MU)])
    np.testing.assert_allclose(one(np.diag([s, 1.0, 1.0]))[1], expected, atol=1e-12 * LAM)


@pytest.mark.parametrize("g", [-2.0, 1e-3, 0.7])
def test_simple_shear(g):
    F = I + g * np.outer(I[0], I[1])
    psi, P = one(F)
    assert psi == pytest.approx(0.5 * MU * g**2, abs=1e-12 * MU)
    np.testing.assert_allclose(P, MU * g * (np.outer(I[0], I[1]) + np.outer(I[1], I[0])), atol=1e-12 * LAM)
    np.testing.assert_allclose((P @ F.T)[0, :2], [MU * g**2, MU * g], atol=1e-12 * LAM)


@pytest.mark.parametrize("s", [-1.0, 0.0, 0.5, 1.0, 1.5])
def test_dilation(s):
    psi, P = one(s * I)
    np.testing.assert_allclose(P, (MU * s + (LAM * (s**3 - 1.0) - MU) * s**2) * I, atol=1e-12 * LAM)
    expected = 1.5 * MU * (s**2 - 1.0) - MU * (s**3 - 1.0) + 0.5 * LAM * (s**3 - 1.0) ** 2
    assert psi == pytest.approx(expected, abs=1e-12 * LAM)


def test_rotations_are_free():
    Q = np.linalg.qr(rng(45).standard_normal((COUNT, 3, 3)))[0]
    Q *= np.sign(np.linalg.det(Q))[:, None, None]
    assert np.abs(energy(Q)).max() <= 1e-14 * LAM
    assert np.abs(stress(Q)).max() <= 1e-14 * LAM


def small_strain(mu: float, lam: float) -> tuple[float, float]:
    """E and nu as a tensile test sees them: the side stretch that leaves no side stress, and the axial slope."""
    strain = 1e-6

    def axial(s: float) -> tuple[float, float]:
        t = 1.0
        for _ in range(30):  # Newton on P22(t) = 0
            P, slope = stress(np.diag([s, t, t])[None], mu, lam)[0], 1e-5
            P_up = stress(np.diag([s, t + slope, t + slope])[None], mu, lam)[0]
            t -= P[1, 1] * slope / (P_up[1, 1] - P[1, 1])
        return stress(np.diag([s, t, t])[None], mu, lam)[0, 0, 0], t

    (up, wide), (down, narrow) = axial(1.0 + strain), axial(1.0 - strain)
    return (up - down) / (2.0 * strain), -(wide - narrow) / (2.0 * strain)


@pytest.mark.parametrize("nu", [-0.3, 0.0, 0.1, 0.3, 0.49])
def test_parameters_give_young_and_poisson(nu):
    E = 2.5e5
    mu, lam = (float(p) for p in parameters(E, nu))
    measured = small_strain(mu, lam)
    # Rounding of the stress, 1e-16 lam, over the strain.
    assert measured[0] == pytest.approx(E, rel=1e-8)
    assert measured[1] == pytest.approx(nu, abs=1e-8)
    if nu > 0.1:  # with lam_Lame itself the side stretch of smaller nu need not even exist
        wrong = small_strain(mu, lam - mu)
        assert wrong[1] == pytest.approx((lam - 2.0 * mu) / (2.0 * (lam - mu)), abs=1e-6)
        assert abs(wrong[1] - nu) >= 1e-4  # at nu = 0.49 the mistake is that small, at 0.3 it is 0.13


def test_parameters_broadcast():
    mu, lam = parameters(np.array([1.0, 2.0]), 0.25)
    np.testing.assert_allclose(mu, [0.4, 0.8])
    np.testing.assert_allclose(lam, [0.8, 1.6])  # lam_Lame = mu at nu = 1/4


@pytest.mark.parametrize("state", STATES)
def test_objectivity_and_isotropy(state):
    F = STATES[state]
    Q = np.linalg.qr(rng(46).standard_normal((COUNT, 3, 3)))[0]
    Q *= np.sign(np.linalg.det(Q))[:, None, None]
    scale = LAM * (1.0 + np.linalg.norm(F, axis=(1, 2)).max() ** 5)
    np.testing.assert_allclose(energy(Q @ F), energy(F), rtol=0, atol=1e-14 * scale)
    np.testing.assert_allclose(energy(F @ Q), energy(F), rtol=0, atol=1e-14 * scale)
    np.testing.assert_allclose(stress(Q @ F), Q @ stress(F), rtol=0, atol=1e-14 * scale)
    np.testing.assert_allclose(stress(F @ Q), stress(F) @ Q, rtol=0, atol=1e-14 * scale)


@pytest.mark.parametrize("state", STATES)
def test_node_functions(state):
    F, weight = STATES[state], rng(47).standard_normal((4 * COUNT, 1))
    # One node per element, which moves its vertices by random weights: u = sum_k w_k grad N_k, grad N_k = e_k.
    u = weight.reshape(-1, 4)[:, 1:] - weight.reshape(-1, 4)[:, :1]
    parent = np.repeat(np.arange(COUNT, dtype=np.int32), 4)[:, None]
    layer = build_layer(separate(COUNT, MU, LAM), parent, weight, COUNT, "one node per element")
    g, H = (6.0 * out for out in backend(COUNT, MU, LAM).gradient_and_blocks(layer, moved(F), moved(F), 0.0))
    P = stress(F)
    scale = LAM * (1.0 + np.linalg.norm(F, axis=(1, 2)).max() ** 5) * np.linalg.norm(u, axis=1).max()
    np.testing.assert_allclose(g, np.einsum("kij,kj->ki", P, u), rtol=0, atol=1e-14 * scale)

    blocks = np.empty((COUNT, 3, 3))
    for j in range(3):
        along = I[j][None, :, None] * u[:, None, :]
        blocks[:, :, j] = np.einsum("kij,kj->ki", stress_increment(F, along), u)
    error = np.linalg.norm(unpacked(H) - blocks, axis=(1, 2)) / np.linalg.norm(blocks, axis=(1, 2))
    assert error.max() <= 1e-13
    smallest = np.linalg.eigvalsh(unpacked(H))[:, 0]
    assert (smallest >= 0.999 * MU * (u**2).sum(axis=1)).all()


def evaluate_all(F9, mu, lam, out):
    F = (F9[0], F9[1], F9[2], F9[3], F9[4], F9[5], F9[6], F9[7], F9[8])
    dF = (F9[1], F9[0], F9[2], F9[4], F9[3], F9[5], F9[8], F9[7], F9[6])
    u = (F9[2], F9[5], F9[8])
    C = cofactor(F)
    out[0] = material.energy_density(F, mu[0], lam[0])
    P, dP = material.stress(F, mu[0], lam[0]), material.stress_increment(F, dF, mu[0], lam[0])
    g, H = material.node_gradient(F, C, mu[0], lam[0], u), material.node_block(C, mu[0], lam[0], u)
    out[1], out[2], out[3], out[4] = P[0], P[5], dP[1], dP[6]
    out[5], out[6], out[7], out[8] = g[0], g[2], H[1], H[3]


def compiled(precision: type) -> Callable[..., None]:
    arrays = [numba.types.Array(numba.from_dtype(np.dtype(precision)), 1, "C")] * 4
    return numba.njit([numba.void(*arrays)], error_model="numpy", fastmath={"contract"})(evaluate_all)


def test_float32_stays_float32():
    F = STATES["random"][3].ravel()
    results = {}
    for precision, other in ((np.float64, "float"), (np.float32, "double")):
        function = compiled(precision)
        arguments = [F.astype(precision), np.array([MU], precision), np.array([LAM], precision)]
        results[precision] = np.zeros(9, precision)
        function(*arguments, results[precision])
        (ir,) = function.inspect_llvm().values()
        arithmetic = [line for line in ir.splitlines() if " = f" in line and f" {other} " in line]
        assert arithmetic == []
        assert any(" = fmul" in line for line in ir.splitlines())  # the search does see arithmetic
    np.testing.assert_allclose(results[np.float32], results[np.float64], rtol=1e-5)


def hessian(F: np.ndarray, mu: float, lam: float) -> np.ndarray:
    """The 9x9 Hessian at each F as NumPy forms it: d2J/dF_ij dF_kl = e_ikm e_jln F_mn."""
    e = np.zeros((3, 3, 3))
    e[[0, 1, 2], [1, 2, 0], [2, 0, 1]], e[[0, 1, 2], [2, 0, 1], [1, 2, 0]] = 1.0, -1.0
    J2 = np.einsum("ikm,jln,amn->aijkl", e, e, F).reshape(-1, 9, 9)
    C = 0.5 * np.einsum("aij,aj->ai", J2, F.reshape(-1, 9))
    c = lam * (np.linalg.det(F) - 1.0) - mu
    return mu * np.eye(9) + lam * C[:, :, None] * C[:, None] + c[:, None, None] * J2


def without_negative(H: np.ndarray) -> np.ndarray:
    values, Q = np.linalg.eigh(H)
    return (Q * np.maximum(values, 0.0)[:, None]) @ Q.transpose(0, 2, 1)


@numba.njit(fastmath={"contract"}, error_model="numpy")
def increments(S, E):
    """F in rows 0 to 8 and dF from 9 on; the definite increment from row 18 on."""
    for i in range(LANES):
        F = (S[i], S[LANES + i], S[2 * LANES + i], S[3 * LANES + i], S[4 * LANES + i], S[5 * LANES + i],
             S[6 * LANES + i], S[7 * LANES + i], S[8 * LANES + i])  # fmt: skip
        dF = (S[9 * LANES + i], S[10 * LANES + i], S[11 * LANES + i], S[12 * LANES + i], S[13 * LANES + i],
              S[14 * LANES + i], S[15 * LANES + i], S[16 * LANES + i], S[17 * LANES + i])  # fmt: skip
        P = material.stress_increment_definite(F, dF, E[0], E[1])
        S[18 * LANES + i], S[19 * LANES + i], S[20 * LANES + i] = P[0], P[1], P[2]
        S[21 * LANES + i], S[22 * LANES + i], S[23 * LANES + i] = P[3], P[4], P[5]
        S[24 * LANES + i], S[25 * LANES + i], S[26 * LANES + i] = P[6], P[7], P[8]


def definite_increments(F: np.ndarray, dF: np.ndarray, mu: float, lam: float) -> np.ndarray:
    tiles = to_tiles(F, dF, rows=27)
    for tile in tiles:
        increments(tile, np.array([mu, lam], F.dtype))
    return from_tiles(tiles, 18).astype(np.float64)


@pytest.mark.parametrize(("precision", "tolerance"), [(np.float64, 1e-13), (np.float32, 1e-5)])
@pytest.mark.parametrize("nu", [-0.3, 0.4, 0.49])
@pytest.mark.parametrize("family", GRADIENTS)
def test_definite_hessian(family, nu, precision, tolerance):
    mu, lam = (float(precision(p)) for p in parameters(1e5, nu))
    F = GRADIENTS[family].astype(precision)
    H = hessian(F.astype(np.float64), mu, lam)
    norm = np.linalg.norm(H, axis=(1, 2))[:, None, None]
    columns = [
        definite_increments(F, np.broadcast_to(unit.reshape(3, 3), F.shape).astype(precision), mu, lam)
        for unit in np.eye(9)
    ]
    np.testing.assert_allclose((np.stack(columns, axis=2) - without_negative(H)) / norm, 0.0, atol=tolerance)


@pytest.mark.parametrize("family", ["random", "small strain", "point"])
def test_definite_hessian_is_the_hessian_where_that_is_definite(family):
    F, dF = GRADIENTS[family], rng(48).standard_normal((MANY, 3, 3))
    H = hessian(F, MU, LAM)
    definite = np.linalg.eigvalsh(H)[:, 0] > 1e-8 * LAM
    assert definite.sum() >= 10
    P = definite_increments(F, dF, MU, LAM)
    expected = np.einsum("aij,aj->ai", H, dF.reshape(-1, 9))
    error = np.linalg.norm(P - expected, axis=1) / np.linalg.norm(H, axis=(1, 2)) / np.linalg.norm(dF, axis=(1, 2))
    assert error[definite].max() <= 1e-14


def test_no_material_gives_zero():
    for F in GRADIENTS.values():
        assert not definite_increments(F, GRADIENTS["random"], 0.0, 0.0).any()
        assert not definite_increments(F.astype(np.float32), F.astype(np.float32), 0.0, 0.0).any()


@pytest.mark.parametrize(("precision", "name"), [(np.float64, "f64"), (np.float32, "f32")])
def test_definite_hessian_is_vectorised(precision, name):
    signature = (numba.types.Array(numba.from_dtype(np.dtype(precision)), 1, "C"),) * 2
    increments.compile(signature)
    ir = increments.inspect_llvm(signature)
    assert re.search(rf"call .*@llvm\.sqrt\.v\d+{name}\(", ir)
    if precision is np.float32:
        assert not [line for line in ir.splitlines() if " = f" in line and "double" in line]
