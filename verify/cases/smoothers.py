# SPDX-License-Identifier: BSD-3-Clause
"""Step lengths of smoothers against dense eigenvalues, and what a smoothing may never do: raise the potential."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from femgal.hierarchy.layer import Layer
from femgal.kernels.backend import Precision
from femgal.solvers.line_search import first_minimum
from femgal.solvers.smoother import Relaxation, StepRule, step_lengths
from femgal.solvers.spectrum import largest_block_jacobi_eigenvalue
from femgal.timestep.potential import IncrementalPotential
from verify.cases.cycles import make, sequence, started
from verify.problems.bodies import STATES, body, mean_edge, rng
from verify.reference.corrections import corrections_at
from verify.reference.galerkin import HIERARCHIES, assembled, balanced, layers
from verify.reference.transfer import block_diagonal, diagonal_blocks, galerkin, mass_matrix, prolongation
from verify.suite.case import PRECISIONS, Kind, Measurement, case
from verify.suite.measure import at_most, compare, worst
from verify.suite.use import Use

# Of inertia over elasticity: a long step, one where both weigh the same, a short one.
_WEIGHTS = {"long step": 1e-3, "even step": 1.0, "short step": 1e3}
# Matrices up to this size have all their eigenvalues computed.
_SMALL = 300
_SEARCHES: tuple[StepRule, ...] = ("exact", "backtracking")


@case(
    "smoothers/largest-eigenvalue",
    title="Lanczos' method finds the largest eigenvalue of D^-1 A from below, within a twentieth",
    quantity="relative difference of lambda_max",
    unit="1",
    kind=Kind.IDENTITY,
    formula="lambda_max(D^-1 P^T A P), D its diagonal 3x3 blocks, or its diagonal, at rest",
    source="LAPACK or ARPACK on scikit-fem's matrix, scaled by Cholesky factors of D",
    tolerance=0.05,
    reason="it stops when an eigenvalue is known to 2%; step lengths keep a tenth below the bound of stability",
    over={"hierarchy": HIERARCHIES, "mesh": ("box", "rabbit")},
    quick={"mesh": ("box",)},
    requires="scikit-fem",
)
def largest_eigenvalue(use: Use, *, hierarchy: str, mesh: str) -> Measurement:
    """Every layer, with blocks and diagonals, at three lengths of the step."""
    disc = body(mesh)
    backend, X, found = use.backend(disc), disc.mesh.points, {}
    for name, weight in _WEIGHTS.items():
        phi = IncrementalPotential(backend, X, (weight * balanced(disc)) ** -0.5)
        for layer in layers(disc, hierarchy):
            for scalar in (False, True):
                estimate = largest_block_jacobi_eigenvalue(phi, layer, X, scalar=scalar)
                exact = _eigenvalue(_matrix(mesh, layer, weight), scalar)
                # A Rayleigh quotient above the largest eigenvalue belongs to another matrix.
                error = 1.0 - estimate / exact if estimate <= exact * (1.0 + 1e-6) else np.inf
                found[f"{name}, {layer.name}, scalar={scalar}"] = Measurement(estimate, exact, error)
    return worst(found)


@case(
    "smoothers/stable-steps",
    title="No spectral step overshoots the stiffest mode by more than keeps its vibration bounded",
    quantity="w lambda_max over its bound, as excess",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="1 - w lambda >= -1/3: then x_{n+1} = T (2 x_n - x_{n-1}), T = 1 - w lambda, is bounded",
    source="roots of z^2 - 2 T z + T; eigenvalues as in smoothers/largest-eigenvalue",
    tolerance=0.0,
    reason="a bound, kept with a tenth to spare",
    over={"mesh": ("box", "rabbit")},
    quick={"mesh": ("box",)},
    requires="scikit-fem",
)
def stable_steps(use: Use, *, mesh: str) -> Measurement:
    """Every layer of every hierarchy at three lengths of the step."""
    disc, overshoots = body(mesh), {}
    for name, weight in _WEIGHTS.items():
        phi = IncrementalPotential(use.backend(disc), disc.mesh.points, (weight * balanced(disc)) ** -0.5)
        for hierarchy in HIERARCHIES:
            chosen = layers(disc, hierarchy)
            for layer, w in zip(chosen, step_lengths("spectral", phi, chosen), strict=True):
                exact = _eigenvalue(_matrix(mesh, layer, weight), False)
                overshoots[f"{name}, {layer.name}"] = float(w) * exact
    # The first that is not a number, where there is one.
    most = list(overshoots)[int(np.argmax(list(overshoots.values())))]
    return at_most(overshoots[most], 4.0 / 3.0, f"largest of {len(overshoots)}: {most}")


@case(
    "smoothers/consistent-steps",
    title="Spectral steps go to 1 as the time step goes to 0, with the square of the time step",
    quantity="largest (1 - w) h0^2 / h^2 over lambda_max(D_M^-1 K) / 2 at h0, as excess",
    unit="1",
    kind=Kind.CLOSED_FORM,
    formula="w = 2 / (1 + lambda), lambda <= 1 + h^2 lambda_max(M_l^-1 K_l): 1 - w <= h^2 lambda_max / 2",
    source="lumped mass of clusters is diagonal, so D -> M / h^2 and D^-1 A -> I",
    tolerance=0.0,
    reason="a bound",
    over={"hierarchy": ("clusters-8", "clusters-32")},
    requires="scikit-fem",
)
def consistent_steps(use: Use, *, hierarchy: str) -> Measurement:
    """A step of 1/1000 of the one at which inertia and elasticity weigh the same."""
    disc, weight, found = body("box"), 1e6, {}
    inverse_h2 = weight * balanced(disc)
    phi = IncrementalPotential(use.backend(disc), disc.mesh.points, inverse_h2**-0.5)
    chosen = layers(disc, hierarchy)
    for layer, w in zip(chosen, step_lengths("spectral", phi, chosen), strict=True):
        mass = np.bincount(layer.parent[disc.free, 0], disc.mass[disc.free], layer.n_nodes)
        K = _matrix("box", layer, 0.0)
        scaled = np.repeat(mass, 3)[:, None] ** -0.5 * K.toarray() * np.repeat(mass, 3) ** -0.5
        bound = float(np.linalg.eigvalsh(scaled)[-1]) / inverse_h2 / 2.0
        found[layer.name] = at_most(1.0 - float(w), bound)
    return worst(found)


@case(
    "smoothers/exact-steps",
    title="An exact step ends where the potential has no slope along the correction, and not before it fell",
    quantity="slope at the end over the largest term of its sum, or 1 where the potential has grown",
    unit="1",
    kind=Kind.CROSS_CODE,
    formula="d . grad phi(x + t d) = 0 and phi(x + t d) < phi(x), t the smallest such step",
    source="gradient and energy by scikit-fem",
    tolerance={"float64": 1e-12, "float32": 2e-5},
    reason="rounding of the coefficients, whose roots are simple",
    over={"mesh": ("box", "rabbit"), "precision": PRECISIONS},
    quick={"mesh": ("box",)},
    requires="scikit-fem",
)
def exact_steps(use: Use, *, mesh: str, precision: Precision) -> Measurement:
    """Block-Jacobi corrections of the vertices and of all coarse layers, in all states."""
    disc = body(mesh)
    backend, found = use.backend(disc, precision), {}
    for state in STATES:
        at = assembled(disc, state)
        phi = IncrementalPotential(backend, at.xhat, at.inverse_h2**-0.5)
        for layer in (backend.vertices, *(one for name in HIERARCHIES for one in layers(disc, name)[1:])):
            dx, slope = backend.correction(layer, at.x, at.xhat, at.inverse_h2)
            d = np.zeros_like(at.x)
            backend.prolong(layer, dx, d)
            coefficients = phi.along(layer, at.x, d)
            coefficients[0] = slope
            end = at.x + first_minimum(coefficients) * d
            terms = np.abs(d * at.gradient_at(end)).sum()
            grown = 0.0 if at.value(end) < at.value(at.x) else 1.0
            one = compare(float((d * at.gradient_at(end)).sum()), 0.0, float(terms))
            found[f"{state}, {layer.name}"] = replace(one, error=float(np.maximum(one.error, grown)))
    return worst(found)


@case(
    "smoothers/potential-never-grows",
    title="With a line search no smoothing of any layer raises the potential, from any state",
    quantity="largest growth in one smoothing over the size of the energy's terms",
    unit="1",
    kind=Kind.CROSS_CODE,
    formula="phi(x_{k+1}) <= phi(x_k) for steps 'exact' and 'backtracking'",
    source="Armijo 1966; energies by scikit-fem",
    tolerance={"float64": 1e-14, "float32": 1e-11},
    reason="rounding of the energies that are compared; in single precision the square of that of a force",
    over={"solver": ("jacobi", "v-clusters", "v-lattice"), "precision": PRECISIONS},
    quick={"solver": ("jacobi", "v-lattice")},
    requires="scikit-fem",
)
def potential_never_grows(use: Use, *, solver: str, precision: Precision) -> Measurement:
    """Four iterations, smoothing by smoothing."""
    disc = body("box")
    backend, found = use.backend(disc, precision), {}
    for state in STATES:
        at = assembled(disc, state)
        x_n = np.where(disc.free[:, None], at.x, disc.mesh.points)
        xhat = np.where(disc.free[:, None], x_n + 0.5 * (at.xhat - at.x), disc.mesh.points)
        at = replace(at, x=x_n, xhat=xhat)
        phi = IncrementalPotential(backend, xhat, at.inverse_h2**-0.5, 1.0, x_n)
        for rule in _SEARCHES:
            one = make(backend, solver, rule)
            assert isinstance(one, Relaxation)
            x = started(one, phi, x_n).x
            values = [at.value(x)]
            for number in 4 * sequence(disc, solver):
                one.smooth_layer(phi, x, number)
                values.append(at.value(x))
            growth = float(np.maximum(0.0, np.diff(values).max()))
            fell = 1.0 if values[-1] < values[0] else np.inf
            found[f"{state}, {rule}"] = Measurement(growth, 0.0, fell * growth / at.energy_terms(x_n))
    return worst(found)


@case(
    "smoothers/error-falls-on-a-quadratic",
    title="On a quadratic potential every smoothing with a spectral step brings the minimiser nearer",
    quantity="largest ratio of the error's energy norm after and before a smoothing, over 1, as excess",
    unit="1",
    kind=Kind.IDENTITY,
    formula="|I - w P D^-1 P^T A|_A <= 1 where w lambda_max <= 2",
    source="textbook; A by scikit-fem, minimiser by a direct solver",
    tolerance=0.0,
    reason="a bound",
    over={"solver": ("jacobi", "scalar-jacobi", "v-clusters", "v-lattice")},
    requires="scikit-fem",
)
def error_falls_on_a_quadratic(use: Use, *, solver: str) -> Measurement:
    """Smoothing by smoothing from displacements of 1e-5 edges around rest."""
    disc = body("box")
    X, free, inverse_h2 = disc.mesh.points, disc.free, 1e-2 * balanced(disc)
    exact = corrections_at(disc, (), X, inverse_h2)
    d = 1e-5 * mean_edge(disc.mesh) * rng(40).standard_normal(X.shape) * free[:, None]
    phi = IncrementalPotential(use.backend(disc), X + d, inverse_h2**-0.5)
    solution = exact.solution((inverse_h2 * disc.mass[:, None] * d)[free].ravel())
    one = make(phi.backend, solver, "spectral")
    assert isinstance(one, Relaxation)
    x = started(one, phi, X + d).x
    norms = [exact.norm(d[free].ravel() - solution)]
    for number in 10 * sequence(disc, solver):
        one.smooth_layer(phi, x, number)
        norms.append(exact.norm((x - X)[free].ravel() - solution))
    ratios = np.array(norms[1:]) / norms[:-1]
    return at_most(float(ratios.max()), 1.0, f"{len(ratios)} smoothings left {norms[-1] / norms[0]:.2g} of the error")


@case(
    "smoothers/age-of-blocks",
    title="What old blocks cost is measured as dense algebra says",
    quantity="relative difference of the energy lost, and of the largest change",
    unit="1",
    kind=Kind.IDENTITY,
    formula="(dx' - dx) . H (dx' - dx), dx = -H^-1 g, dx' = -H'^-1 g; max |H' - H|_F over the node's mean diagonal",
    source="numpy.linalg on scikit-fem's blocks of two states",
    tolerance=1e-10,
    reason="rounding of the blocks, amplified by their condition",
    over={"hierarchy": HIERARCHIES},
    requires="scikit-fem",
)
def age_of_blocks(use: Use, *, hierarchy: str) -> Measurement:
    """Blocks at rest are the old ones, those of the random state the new ones."""
    disc = body("box")
    backend, at, before, found = use.backend(disc), assembled(disc, "random"), assembled(disc, "rest"), {}
    for layer in layers(disc, hierarchy):
        g, H = backend.gradient_and_blocks(layer, at.x, at.xhat, at.inverse_h2)
        _, old = backend.gradient_and_blocks(layer, before.x, before.xhat, before.inverse_h2)
        new, kept, r = at.blocks(layer), before.blocks(layer), at.gradient(layer)[:, :, None]
        lost = np.linalg.solve(new, r) - np.linalg.solve(kept, r)
        mean = np.trace(new, axis1=1, axis2=2) / 3.0
        expected = {
            "lost": float((lost * (new @ lost)).sum()),
            "change": float((np.linalg.norm(kept - new, axis=(1, 2)) / mean).max()),
        }
        for (name, value), computed in zip(expected.items(), backend.compare_blocks(g, old, H), strict=True):
            found[f"{name}, {layer.name}"] = compare(computed, value)
    return worst(found)


def _matrix(mesh: str, layer: Layer, weight: float) -> sp.csr_matrix:
    """P^T A P of a layer at rest, with inertia so many times as heavy as elasticity."""
    at = assembled(body(mesh), "rest")
    A = at.A + (weight - 1.0) * at.inverse_h2 * mass_matrix(at.disc.mass)
    return galerkin(prolongation(layer), A.tocsr())


def _eigenvalue(A: sp.csr_matrix, scalar: bool) -> float:
    """Largest eigenvalue of D^-1 A: of L^-1 A L^-T with D = L L^T."""
    D = diagonal_blocks(A) * (np.eye(3) if scalar else 1.0)
    inverse = block_diagonal(np.asarray(np.linalg.inv(np.linalg.cholesky(D)), np.float64))
    S = inverse @ A @ inverse.T
    if S.shape[0] <= _SMALL:
        return float(np.linalg.eigvalsh(S.toarray())[-1])
    return float(spla.eigsh(S, 1, which="LA", return_eigenvectors=False, tol=1e-6)[0])
