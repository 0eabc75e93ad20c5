# SPDX-License-Identifier: BSD-3-Clause
"""The passes of a backend as calls to time, each with its size and the bytes it has to move."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from femgal.kernels.backend import Backend
from femgal.kernels.cpu.backend import CpuBackend
from femgal.kernels.plain.backend import PlainBackend
from femgal.solvers.fas import FAS
from femgal.solvers.smoother import StepRule
from femgal.timestep.backward_euler import BackwardEuler
from verify.benchmark import traffic
from verify.benchmark.body import GRAVITY, BenchmarkBody, H
from verify.benchmark.timing import Call

# The production passes in both precisions, and the float64 reference that they are tested against.
VARIANTS = ("float32", "float64", "plain")

GRADIENT, BLOCKS = "gradient", "gradient + blocks"
CORRECTION = f"{BLOCKS} + solve"
# Spectral steps are estimated before the first substep; from then on they cost what any given steps cost.
SUBSTEPS: dict[str, StepRule] = {"FAS substep, spectral steps": (0.5, 0.5), "FAS substep, exact steps": "exact"}
_INVERSE_H2 = 1.0 / H**2


@dataclass(frozen=True)
class Pass:
    """One call to time.

    Parameters
    ----------
    name : Unique among the passes of a backend.
    tets : Tetrahedra that it visits; of the whole mesh for work at nodes.
    bytes_per_tet : What it has to move at least (`verify.benchmark.traffic`); None where there is no model.
    call : Makes the pass.
    """

    name: str
    tets: int
    bytes_per_tet: float | None
    call: Call


def make_backend(variant: str, body: BenchmarkBody, threads: int) -> Backend:
    """Backend of a variant."""
    finest = body.hierarchy.layers[0]
    if variant == "plain":
        return PlainBackend(body.disc, threads, finest)
    return CpuBackend(body.disc, threads, finest, precision="float32" if variant == "float32" else "float64")


def all_passes(backend: Backend, body: BenchmarkBody) -> list[Pass]:
    """Every pass of a backend, then the work at nodes and whole substeps."""
    return [*_element_passes(backend, body), *_node_passes(backend, body), *_substeps(backend, body)]


def _element_passes(backend: Backend, body: BenchmarkBody) -> Iterator[Pass]:
    x, xhat, d = body.x, body.xhat, body.xhat - body.x
    precision, m, finest = backend.precision, body.disc.n_tets, body.hierarchy.layers[0]
    vector = traffic.vector_bytes(precision)
    yield Pass(GRADIENT, m, vector, partial(backend.gradient, x))
    blocks = traffic.block_bytes(precision)
    yield Pass(BLOCKS, m, blocks, partial(backend.gradient_and_blocks, finest, x, xhat, _INVERSE_H2))
    yield Pass(CORRECTION, m, blocks, partial(backend.correction, finest, x, xhat, _INVERSE_H2))
    for number, layer in enumerate(body.hierarchy.layers[1:], start=1):
        yield Pass(
            f"{BLOCKS}, layer {number}",
            len(layer.active),
            traffic.element_bytes(precision),
            partial(backend.gradient_and_blocks, layer, x, xhat, _INVERSE_H2),
        )
    yield Pass("Hessian product", m, vector, partial(backend.hessian_product, x, d))
    yield Pass("energy", m, traffic.energy_bytes(precision), partial(backend.energies, x))
    yield Pass(
        "energy along a line", m, traffic.element_bytes(precision), partial(backend.energies_along, finest, x, d)
    )


def _node_passes(backend: Backend, body: BenchmarkBody) -> Iterator[Pass]:
    n, m, finest = body.disc.n_vertices, body.disc.n_tets, body.hierarchy.layers[0]
    g = np.random.default_rng(20_260_205).standard_normal((finest.n_nodes, 3))
    # Regular blocks, and corrections so small that x stays where it is however often they are added.
    H_nodes = np.tile([3.0, 0.5, -0.5, 2.0, 0.25, 4.0], (finest.n_nodes, 1))
    dx, x = 1e-12 * g, body.x.copy()
    yield Pass("node work: solve", m, traffic.solve_bytes(finest.n_nodes) / m, partial(backend.solve, g, H_nodes, 0.5))
    prolongation = traffic.prolongation_bytes(finest.n_nodes, n) / m
    yield Pass("node work: prolong", m, prolongation, partial(backend.prolong, finest, dx, x))


def _substeps(backend: Backend, body: BenchmarkBody) -> Iterator[Pass]:
    for name, rule in SUBSTEPS.items():
        solver = FAS(backend, body.hierarchy.layers, rule)
        stepper = BackwardEuler(backend, solver, 50, GRAVITY, motions=body.motions)
        state, _ = stepper.begin_frame(stepper.init(body.x, body.v), 50 * H)
        yield Pass(name, body.disc.n_tets, None, partial(stepper.step, state, H))
