# SPDX-License-Identifier: BSD-3-Clause
"""Every pass of the CUDA backend beside the plain one, on a GPU or in the simulator.

`python -m verify.gpu.passes PRECISION HELD [rare]` prints the differences as JSON: PRECISION of the passes, HELD the
share of the body that is held, with `rare` also the passes that the simulator is slow to compile and V-cycles, which
are single precision on the host and so a list of their own.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np

from femgal.hierarchy.hierarchy import build_constant_hierarchy
from femgal.hierarchy.layer import Layer
from femgal.kernels.backend import Precision
from femgal.kernels.plain.backend import PlainBackend
from femgal.solvers.lattice_vcycle import LatticeVCycle
from femgal.timestep.potential import IncrementalPotential
from verify.problems.bodies import distorted_box, left_end, linear_layer, positions, rng, varied

INVERSE_H2 = 1e4

# Tetrahedra of the box: 480.
SHAPE = (5, 4, 4)


class Pair:
    """The two backends and what both are asked about."""

    def __init__(self, precision: Precision, held: float, shape: tuple[int, int, int] = SHAPE) -> None:
        # Imported here: Numba's CUDA compiler is not there everywhere.
        from femgal.kernels.cuda.backend import CudaBackend

        MESH = distorted_box(shape)
        disc = varied(MESH, left_end(MESH, held) if held else ())
        layers = build_constant_hierarchy(disc, 8).layers
        self.layers: dict[str, Layer] = {one.name: one for one in layers} | {"made up": linear_layer(disc)}
        self.plain = PlainBackend(disc, 1, layers[0])
        self.cuda = CudaBackend(disc, 1, layers[0], precision)
        self.x, self.d = positions(MESH, "random"), rng(3).standard_normal(MESH.points.shape)
        self.xhat = self.x + 0.01 * rng(4).standard_normal(MESH.points.shape)
        self.own = [self.cuda.to_device(array) for array in (self.x, self.d, self.xhat)]

    def difference(self, one: Any, two: Any) -> float:
        """Largest difference over the largest value."""
        one = one if isinstance(one, float | np.ndarray) else self.cuda.to_host(one)
        return float(np.abs(np.asarray(one) - two).max() / np.abs(two).max())

    def elements(self) -> Iterator[tuple[str, float]]:
        """Passes over elements, and the inertia along a line."""
        plain, cuda, x, (own_x, own_d, own_hat) = self.plain, self.cuda, self.x, self.own
        yield "gradient", self.difference(cuda.gradient(own_x), plain.gradient(x))
        yield "product", self.difference(cuda.hessian_product(own_x, own_d), plain.hessian_product(x, self.d))
        for name, one, two in zip(("energy", "J"), cuda.energies(own_x), plain.energies(x), strict=True):
            yield name, self.difference(one, two)
        one, two = cuda.inertia_along(own_x, own_hat, own_d, 7.0), plain.inertia_along(x, self.xhat, self.d, 7.0)
        yield "inertia along", self.difference(one, two)

    def rare(self) -> Iterator[tuple[str, float]]:
        """What takes the simulator long to compile."""
        plain, cuda, x, (own_x, own_d, _) = self.plain, self.cuda, self.x, self.own
        definite = plain.hessian_product(x, self.d, definite=True)
        yield "definite product", self.difference(cuda.hessian_product(own_x, own_d, definite=True), definite)
        yield "von Mises", self.difference(cuda.von_mises(own_x), plain.von_mises(x))

    def cycles(self) -> Iterator[tuple[str, float]]:
        """V-cycles with levels above a dense bottom, and above one that is smoothed."""
        r = self.plain.restrict(self.plain.vertices, self.d)
        for name, most in (("dense bottom", 100), ("smoothed bottom", 3)):
            results = []
            for backend in (self.plain, self.cuda):
                x, own_r = backend.to_device(self.x), backend.to_device(r)
                cycle = LatticeVCycle(backend, most=most)
                cycle.refresh(IncrementalPotential(backend, x, INVERSE_H2**-0.5), x)
                results.append((cycle.apply(own_r), cycle.product(own_r)))
            (z, p), (own_z, own_p) = results
            yield f"cycle, {name}", self.difference(own_z, z)
            yield f"product, {name}", self.difference(own_p, p)

    def layer(self, layer: Layer) -> Iterator[tuple[str, float]]:
        """Passes of one layer."""
        plain, cuda, d, (own_x, own_d, own_hat) = self.plain, self.cuda, self.d, self.own
        at, own = (layer, self.x, self.xhat, INVERSE_H2), (layer, own_x, own_hat, INVERSE_H2)
        yield "nodal gradient", self.difference(cuda.nodal_gradient(*own), plain.nodal_gradient(*at))
        pairs = zip(cuda.gradient_and_blocks(*own), plain.gradient_and_blocks(*at), strict=True)
        yield from ((f"terms {k}", self.difference(*pair)) for k, pair in enumerate(pairs))
        for scalar in (False, True):
            dx, slope = cuda.correction(*own, 0.7, scalar=scalar)
            expected, its = plain.correction(*at, 0.7, scalar=scalar)
            yield f"correction {scalar}", self.difference(dx, expected)
            yield f"slope {scalar}", self.difference(float(slope), its)
        product = cuda.nodal_product(layer, own_x, own_d, INVERSE_H2), plain.nodal_product(layer, self.x, d, INVERSE_H2)
        yield "product", self.difference(*product)
        yield "restriction", self.difference(cuda.restrict(layer, own_d), plain.restrict(layer, d))
        own_t, t = cuda.zeros(len(d)), np.zeros_like(d)
        cuda.prolong(layer, dx, own_t)
        plain.prolong(layer, expected, t)
        yield "prolongation", self.difference(own_t, t)
        yield "along", self.difference(cuda.energies_along(layer, own_x, own_t), plain.energies_along(layer, self.x, t))

    def vectors(self) -> Iterator[tuple[str, float]]:
        """Work on vectors and numbers."""
        plain, cuda, x, d = self.plain, self.cuda, self.x, self.d
        own_x, own_d, own_hat = self.own
        some = np.arange(0, len(x), 7)
        yield "rows", self.difference(cuda.rows(own_x, some), plain.rows(x, some))
        yield "fetch", self.difference(cuda.fetch(own_d)(), d)
        yield "dot", self.difference(cuda.dot(own_x, own_d), plain.dot(x, d))
        yield "largest", self.difference(float(cuda.largest(own_d)), plain.largest(d))
        yield "kinetic energy", self.difference(cuda.kinetic_energy(own_d), plain.kinetic_energy(d))
        g = np.array([1.0, 2.0, -9.0])
        yield "weight energy", self.difference(cuda.weight_energy(own_x, g), plain.weight_energy(x, g))
        predicted = cuda.predict(own_x, own_d, 0.1, g, 1.5), plain.predict(x, d, 0.1, g, 1.5)
        yield "prediction", self.difference(*predicted)
        for k, pair in enumerate(
            zip(cuda.power_step(own_x, cuda.unit_mode(own_d)), plain.power_step(x, plain.unit_mode(d)), strict=True)
        ):
            yield f"power step {k}", self.difference(*pair)
        own_v, v, own_a, a = cuda.copy(own_d), d.copy(), cuda.gradient(own_x), plain.gradient(x)
        cuda.add_inertia(own_a, own_x, own_hat, 7.0)
        plain.add_inertia(a, x, self.xhat, 7.0)
        yield "inertia", self.difference(own_a, a)
        cuda.accelerate_kick(own_a, own_v, g, 0.1, 0.9)
        plain.accelerate_kick(a, v, g, 0.1, 0.9)
        yield "acceleration", self.difference(own_a, a)
        yield "kick", self.difference(own_v, v)
        kicked = cuda.kick_drift(own_x, own_d, own_hat, 0.1, 0.9), plain.kick_drift(x, d, self.xhat, 0.1, 0.9)
        yield from ((f"drift {k}", self.difference(*pair)) for k, pair in enumerate(zip(*kicked, strict=True)))
        layer = self.plain.vertices
        terms, own = plain.gradient_and_blocks(layer, x, x, 7.0), cuda.gradient_and_blocks(layer, own_x, own_x, 7.0)
        old, own_old = 1.1 * terms[1], cuda.to_device(1.1 * terms[1])
        compared = zip(
            cuda.compare_blocks(own[0], own_old, own[1]), plain.compare_blocks(terms[0], old, terms[1]), strict=True
        )
        yield from ((f"old blocks {k}", self.difference(*pair)) for k, pair in enumerate(compared))

    def repeats(self) -> bool:
        """Whether a pass gives the same bits again, though memory has been used in between."""
        layer, (x, d, xhat) = self.layers["made up"], self.own
        first = self.cuda.to_host(self.cuda.gradient_and_blocks(layer, x, xhat, INVERSE_H2)[1])
        self.cuda.gradient(d)
        second = self.cuda.to_host(self.cuda.gradient_and_blocks(layer, x, xhat, INVERSE_H2)[1])
        return bool((first == second).all())


def differences(
    precision: Precision, held: float, *, rare: bool, shape: tuple[int, int, int] = SHAPE
) -> dict[str, Any]:
    """Largest difference over the largest value of every pass, and whether passes give the same bits again."""
    pair = Pair(precision, held, shape)
    found = dict(pair.elements()) | dict(pair.vectors())
    for name, layer in pair.layers.items():
        found |= {f"{name}: {what}": size for what, size in pair.layer(layer)}
    if rare:
        found |= dict(pair.rare())
    spoilt = pair.x.copy()
    spoilt[17, 1] = np.nan
    finite = [pair.cuda.is_finite(pair.cuda.to_device(array)) for array in (pair.x, spoilt)]
    cycles = dict(pair.cycles()) if rare else {}
    return {"differences": found, "cycles": cycles, "finite": finite, "repeats": pair.repeats()}


if __name__ == "__main__":
    print(json.dumps(differences(sys.argv[1], float(sys.argv[2]), rare="rare" in sys.argv)))  # type: ignore[arg-type]
