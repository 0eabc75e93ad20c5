# SPDX-License-Identifier: BSD-3-Clause
"""Matrix-free passes over vertices and coarse nodes against the Galerkin products of scikit-fem's exact Hessian.

Every row takes the worst of four states: at rest, random, stretched to 20 times, inverted. Differences are relative to
the largest single term of the same node's sum, so a soft node is not measured by a stiff one.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.hierarchy.layer import Layer
from femgal.kernels.backend import Backend, Precision
from femgal.timestep.potential import IncrementalPotential
from verify.problems.bodies import STATES, body, mean_edge, rng
from verify.reference.galerkin import HIERARCHIES, Assembled, assembled, layers, strains
from verify.reference.transfer import unpacked
from verify.suite.case import PRECISIONS, Kind, Measurement, Skip, case
from verify.suite.measure import compare, vanishes, worst
from verify.suite.use import Use

Floats = NDArray[np.float64]

_MESHES = ("box", "rabbit", "bunny", "slivers")
_QUICK = {"mesh": ("box", "rabbit")}
_TOLERANCE = {"float64": 1e-12, "float32": 2e-5}
_ROUNDING = "rounding of F, cof F and of a sum over a node's elements, with room for slivers: 1e4 and 3e2 ulp"
_TERM = "largest difference over the largest single term of the same node"
_SOURCE = "Lu et al. 2025, Eq. 11 to 16; P and A by scikit-fem, no filter"
_VECTORS = 3


@case(
    "blocks/vertex-gradients",
    title="Matrix-free forces and inertia at the vertices are those that scikit-fem assembles",
    quantity=_TERM,
    unit="1",
    kind=Kind.CROSS_CODE,
    formula="g = M (x - xhat) / h^2 + grad E(x)",
    source=_SOURCE,
    tolerance=_TOLERANCE,
    reason=_ROUNDING,
    over={"mesh": _MESHES, "precision": PRECISIONS},
    quick=_QUICK,
    requires="scikit-fem",
    own_mesh=True,
)
def vertex_gradients(use: Use, *, mesh: str, precision: Precision) -> Measurement:
    """Gradients of the finest layer, by the pass that makes blocks too and by the one that does not."""
    disc = body(mesh)
    return _worst_state(disc, use.backend(disc, precision), _finest, _gradient)


@case(
    "blocks/vertex-blocks",
    title="Matrix-free vertex blocks are the diagonal blocks of scikit-fem's Hessian",
    quantity=_TERM,
    unit="1",
    kind=Kind.CROSS_CODE,
    formula="H_v = m / h^2 I + sum_e V (mu |u|^2 I + lam (C u)(C u)^T), u = grad N_v",
    source=_SOURCE,
    tolerance=_TOLERANCE,
    reason=_ROUNDING,
    over={"mesh": _MESHES, "precision": PRECISIONS},
    quick=_QUICK,
    requires="scikit-fem",
    own_mesh=True,
)
def vertex_blocks(use: Use, *, mesh: str, precision: Precision) -> Measurement:
    """Blocks of the finest layer."""
    disc = body(mesh)
    return _worst_state(disc, use.backend(disc, precision), _finest, _blocks)


@case(
    "blocks/coarse-gradients",
    title="Matrix-free gradients of every coarse layer are P^T g",
    quantity=_TERM,
    unit="1",
    kind=Kind.CROSS_CODE,
    formula="g_i = sum_v w_iv m (x - xhat) / h^2 + sum_e V P u, u = sum_k w_k grad N_k",
    source=_SOURCE,
    tolerance=_TOLERANCE,
    reason=_ROUNDING,
    over={"mesh": _MESHES, "precision": PRECISIONS},
    quick=_QUICK,
    requires="scikit-fem",
    own_mesh=True,
)
def coarse_gradients(use: Use, *, mesh: str, precision: Precision) -> Measurement:
    """Gradients of the coarse layers of all hierarchies."""
    disc = body(mesh)
    return _worst_state(disc, use.backend(disc, precision), _all_coarse, _gradient)


@case(
    "blocks/coarse-blocks",
    title="Matrix-free blocks of every coarse layer are the diagonal blocks of P^T A P",
    quantity=_TERM,
    unit="1",
    kind=Kind.CROSS_CODE,
    formula="H_i = sum_v w_iv^2 m / h^2 I + sum_e V (mu |u|^2 I + lam (C u)(C u)^T), u = sum_k w_k grad N_k",
    source=_SOURCE,
    tolerance=_TOLERANCE,
    reason=_ROUNDING,
    over={"hierarchy": HIERARCHIES, "mesh": _MESHES, "precision": PRECISIONS},
    quick=_QUICK,
    requires="scikit-fem",
    own_mesh=True,
)
def coarse_blocks(use: Use, *, hierarchy: str, mesh: str, precision: Precision) -> Measurement:
    """Blocks of the coarse layers of one hierarchy."""
    disc = body(mesh)
    return _worst_state(disc, use.backend(disc, precision), lambda *_: layers(disc, hierarchy)[1:], _blocks)


@case(
    "blocks/hessian-products",
    title="Matrix-free Hessian-vector products are those of scikit-fem's matrix",
    quantity=_TERM,
    unit="1",
    kind=Kind.CROSS_CODE,
    formula="(d2 E / dx2) d at the free vertices, d random at all of them",
    source="dP[G] = mu G + lam (C : G) C + c dC[G], Smith et al. 2018; assembled by scikit-fem",
    tolerance=_TOLERANCE,
    reason=_ROUNDING,
    over={"mesh": ("box", "rabbit", "slivers"), "precision": PRECISIONS},
    quick=_QUICK,
    requires="scikit-fem",
    own_mesh=True,
)
def hessian_products(use: Use, *, mesh: str, precision: Precision) -> Measurement:
    """Products with several random vectors; the inertia, which the pass leaves out, is taken from the reference."""
    disc = body(mesh)
    return _worst_state(disc, use.backend(disc, precision), _finest, _hessian_products)


@case(
    "blocks/nodal-products",
    title="Matrix-free products of a layer with its own Hessian are those of P^T A P",
    quantity=_TERM,
    unit="1",
    kind=Kind.CROSS_CODE,
    formula="P^T A P y, y random",
    source=_SOURCE,
    tolerance=_TOLERANCE,
    reason=_ROUNDING,
    over={"mesh": ("box", "slivers"), "precision": PRECISIONS},
    quick=_QUICK,
    requires="scikit-fem",
)
def nodal_products(use: Use, *, mesh: str, precision: Precision) -> Measurement:
    """Products of the vertices and of the coarse layers of all hierarchies."""
    disc = body(mesh)
    return _worst_state(
        disc, use.backend(disc, precision), lambda *of: (*_finest(*of), *_all_coarse(*of)), _nodal_products
    )


@case(
    "blocks/definite-products",
    title="Products with the definite part of each element are those of filtered 9x9 matrices",
    quantity=_TERM,
    unit="1",
    kind=Kind.IDENTITY,
    formula="sum_e V grad N^T (sum_k max(l_k, 0) q_k q_k^T) grad d, (l_k, q_k) the eigenpairs of dP/dF",
    source="Smith et al. 2019; numpy's eigh in place of their closed form",
    tolerance=_TOLERANCE,
    reason=_ROUNDING,
    over={"mesh": ("box", "slivers"), "precision": PRECISIONS},
    quick=_QUICK,
)
def definite_products(use: Use, *, mesh: str, precision: Precision) -> Measurement:
    """Products of the filtered Hessian with a random vector."""
    disc = body(mesh)
    return _worst_state(disc, use.backend(disc, precision), _finest, _definite_products)


@case(
    "blocks/corrections",
    title="Corrections are -w D^-1 P^T g with dense blocks, and their slopes g . dx",
    quantity="largest difference over |D_i^-1| times the largest single term of the same node's gradient",
    unit="1",
    kind=Kind.CROSS_CODE,
    formula="dx_i = -w D_i^-1 g_i, D_i the diagonal 3x3 block of P^T A P, or its diagonal",
    source="Lu et al. 2025, Eq. 6; numpy.linalg.solve of scikit-fem's blocks",
    tolerance=_TOLERANCE,
    reason=_ROUNDING,
    over={"mesh": ("box", "rabbit"), "precision": PRECISIONS},
    quick={"mesh": ("box",)},
    requires="scikit-fem",
)
def corrections(use: Use, *, mesh: str, precision: Precision) -> Measurement:
    """Corrections of the vertices and of the coarse layers of all hierarchies, with blocks and with diagonals."""
    disc = body(mesh)
    return _worst_state(
        disc, use.backend(disc, precision), lambda *of: (*_finest(*of), *_all_coarse(*of)), _corrections
    )


@case(
    "blocks/along-a-line",
    title="The polynomial of the potential along a line gives scikit-fem's energy at every step",
    quantity="largest difference over the sum of the sizes of all terms of all elements",
    unit="1",
    kind=Kind.CROSS_CODE,
    formula="phi(x + t d) - phi(x) = sum_k c_k t^k, k = 1..6, at t = -1, 1/4, 1, 2",
    source="Psi of Smith et al. 2018 is a polynomial of degree six in F; energies by scikit-fem",
    tolerance={"float64": 1e-13, "float32": 1e-6},
    reason="rounding of each element's terms, which partly cancels over all elements",
    over={"mesh": ("box", "rabbit"), "precision": PRECISIONS},
    quick={"mesh": ("box",)},
    requires="scikit-fem",
    own_mesh=True,
)
def along_a_line(use: Use, *, mesh: str, precision: Precision) -> Measurement:
    """Directions that the nodes of coarse layers make."""
    disc = body(mesh)
    return _worst_state(disc, use.backend(disc, precision), lambda *of: (*_finest(*of), *_all_coarse(*of)[::3]), _along)


@case(
    "blocks/left-out-elements",
    title="Elements that a layer leaves out add nothing to its gradient and blocks but rounding",
    quantity="largest entry of their P^T g and P^T A P, or error of the passes without them, over the largest term",
    unit="1",
    kind=Kind.CROSS_CODE,
    formula="u = sum_k w_k grad N_k = 0, so P^T g_e = 0 and P^T A_e P = 0: passes without them give P^T g and P^T A P",
    source="Lu et al. 2025, section 5.1.1; by scikit-fem, of the left-out elements alone and of all elements",
    tolerance=1e-13,
    reason="four gradients of an element sum to zero up to rounding, and so do the forces and stiffnesses made of them",
    over={"hierarchy": HIERARCHIES, "mesh": ("rabbit", "slivers")},
    quick=_QUICK,
    requires="scikit-fem",
    own_mesh=True,
)
def left_out_elements(use: Use, *, hierarchy: str, mesh: str) -> Measurement:
    """The inside of constant clusters, and elements whose vertices are all constrained."""
    disc = body(mesh)
    backend, found = use.backend(disc), dict[str, Measurement]()
    for layer in layers(disc, hierarchy)[1:]:
        out = np.ones(disc.n_tets, bool)
        out[layer.active] = False
        for state in STATES if out.any() else ():
            name = f"{layer.name}, {state}, {out.sum()} of {disc.n_tets} left out"
            for what, one in _left_out(backend, assembled(disc, state), layer, out).items():
                found[f"{what}, {name}"] = one
    if not found:
        raise Skip("no layer leaves an element out")
    return worst(found)


def _left_out(backend: Backend, whole: Assembled, layer: Layer, out: NDArray[np.bool_]) -> dict[str, Measurement]:
    part = whole.of_elements(out)
    force, stiffness = (float(terms.max()) for terms in (whole.gradient_terms(layer), whole.block_terms(layer)))
    g, H = backend.gradient_and_blocks(layer, whole.x, whole.xhat, whole.inverse_h2)
    return {
        "gradient": vanishes(part.gradient(layer), force),
        "blocks": vanishes(part.blocks(layer), stiffness),
        "gradient without them": compare(g, whole.gradient(layer), force),
        "blocks without them": compare(unpacked(H), whole.blocks(layer), stiffness),
    }


@case(
    "blocks/active-elements",
    title="The elements that a layer visits are exactly those that its nodes deform",
    quantity="elements visited for nothing or left out wrongly",
    unit="1",
    kind=Kind.IDENTITY,
    formula="an element is active where any |u_i| = |sum_k w_ik grad N_k| > 0",
    source="Lu et al. 2025, section 5.1.1; u by sparse products of weights and gradients",
    tolerance=0.0,
    reason="a set of elements",
    over={"mesh": _MESHES},
    quick=_QUICK,
    own_mesh=True,
)
def active_elements(use: Use, *, mesh: str) -> Measurement:
    """All layers of all hierarchies; u = 0 up to rounding of the element's own gradients."""
    disc = body(mesh)
    found = {}
    for hierarchy in HIERARCHIES:
        for layer in layers(disc, hierarchy):
            size = strains(disc, layer).tocsr().max(axis=1).toarray().ravel()
            largest = np.sqrt((disc.B.reshape(-1, 3, 3) ** 2).sum(axis=2).max(axis=1))
            deformed = size > 1e-12 * largest
            is_active = np.zeros(disc.n_tets, bool)
            is_active[layer.active] = True
            visited, wrong = int(deformed.sum()), int((is_active != deformed).sum())
            found[f"{hierarchy}, {layer.name}"] = Measurement(float(is_active.sum()), float(visited), float(wrong))
    return worst(found)


Compare = Callable[[Backend, Assembled, Layer], dict[str, Measurement]]


def _worst_state(
    disc: Discretisation,
    backend: Backend,
    chosen: Callable[[Discretisation, Backend], tuple[Layer, ...]],
    measure: Compare,
) -> Measurement:
    """Worst of all states and layers."""
    found = {}
    for state in STATES:
        for layer in chosen(disc, backend):
            for what, one in measure(backend, assembled(disc, state), layer).items():
                found[", ".join(filter(None, (state, layer.name, what)))] = one
    return worst(found)


def _finest(disc: Discretisation, backend: Backend) -> tuple[Layer, ...]:
    return (backend.vertices,)


def _all_coarse(disc: Discretisation, backend: Backend) -> tuple[Layer, ...]:
    return tuple(layer for hierarchy in HIERARCHIES for layer in layers(disc, hierarchy)[1:])


def _at_nodes(computed: Floats, reference: NDArray[np.floating], terms: NDArray[np.floating]) -> Measurement:
    """Entries of nodes in units of each node's own largest term."""
    unit = terms.reshape(-1, *(1,) * (computed.ndim - 1))
    return compare(computed / unit, reference / unit, 1.0)


def _gradient(backend: Backend, at: Assembled, layer: Layer) -> dict[str, Measurement]:
    reference, terms = at.gradient(layer), at.gradient_terms(layer)
    alone = backend.nodal_gradient(layer, at.x, at.xhat, at.inverse_h2)
    with_blocks, _ = backend.gradient_and_blocks(layer, at.x, at.xhat, at.inverse_h2)
    found = {"alone": alone, "with blocks": with_blocks}
    if layer is backend.vertices:
        inertia = at.inverse_h2 * at.disc.mass[:, None] * (at.x - at.xhat)
        found["forces"] = (backend.gradient(at.x) + inertia)[at.disc.free]
    return {name: _at_nodes(g, reference, terms) for name, g in found.items()}


def _blocks(backend: Backend, at: Assembled, layer: Layer) -> dict[str, Measurement]:
    _, H = backend.gradient_and_blocks(layer, at.x, at.xhat, at.inverse_h2)
    return {"": _at_nodes(unpacked(H), at.blocks(layer), at.block_terms(layer))}


def _hessian_products(backend: Backend, at: Assembled, layer: Layer) -> dict[str, Measurement]:
    found = {}
    for k, d in enumerate(rng(21).standard_normal((_VECTORS, *at.x.shape))):
        product = backend.hessian_product(at.x, d) + at.inverse_h2 * at.disc.mass[:, None] * d
        found[f"vector {k}"] = _at_nodes(product[at.disc.free], at.product(layer, d), at.product_terms(layer, d))
    return found


def _nodal_products(backend: Backend, at: Assembled, layer: Layer) -> dict[str, Measurement]:
    d = _moved(backend, at, layer)
    product = backend.nodal_product(layer, at.x, d, at.inverse_h2)
    return {"": _at_nodes(product, at.product(layer, d), at.product_terms(layer, d))}


def _definite_products(backend: Backend, at: Assembled, layer: Layer) -> dict[str, Measurement]:
    d, free = rng(22).standard_normal(at.x.shape), at.disc.free
    product = backend.hessian_product(at.x, d, definite=True)
    return {"": _at_nodes(product[free], at.definite_product(d)[free], at.product_terms(layer, d))}


def _corrections(backend: Backend, at: Assembled, layer: Layer) -> dict[str, Measurement]:
    g, D, terms = at.gradient(layer), at.blocks(layer), at.gradient_terms(layer)
    found = {}
    for name, blocks in {"blocks": D, "diagonal": D * np.eye(3)}.items():
        dx, slope = backend.correction(layer, at.x, at.xhat, at.inverse_h2, 0.7, scalar=name == "diagonal")
        expected = -0.7 * np.linalg.solve(blocks, g[:, :, None])[:, :, 0]
        reach = terms / np.linalg.svd(blocks, compute_uv=False)[:, -1]
        found[name] = _at_nodes(dx, expected, reach)
        found[f"slope, {name}"] = compare(float(slope), float((g * expected).sum()), float(terms @ reach))
    return found


def _along(backend: Backend, at: Assembled, layer: Layer) -> dict[str, Measurement]:
    d = 0.2 * mean_edge(at.disc.mesh) * _moved(backend, at, layer)
    phi = IncrementalPotential(backend, at.xhat, at.inverse_h2**-0.5)
    coefficients = phi.along(layer, at.x, d)
    times = np.array([-1.0, 0.25, 1.0, 2.0])
    expected = [at.value(at.x + t * d) - at.value(at.x) for t in times]
    terms = max(at.energy_terms(at.x + t * d) for t in times)
    return {"": compare(times[:, None] ** np.arange(1, 7) @ coefficients, expected, terms)}


def _moved(backend: Backend, at: Assembled, layer: Layer) -> Floats:
    """A direction of shape [n, 3] that random moves of a layer's nodes make."""
    d = np.zeros_like(at.x)
    backend.prolong(layer, rng(23).standard_normal((layer.n_nodes, 3)), d)
    return d
