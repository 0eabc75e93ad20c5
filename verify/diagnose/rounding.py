# SPDX-License-Identifier: BSD-3-Clause
"""What single precision does to forces and positions on this mesh.

The forces of a state are computed in float32 and in float64. Their difference at a vertex, over sum_e E V |grad N| of
its elements, is the strain that would cause such a force: noise that can be held against the strains of the scene.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from femgal.kernels.cpu.backend import CpuBackend
from femgal.scene.plan import DEFAULT_SUBSTEPS
from verify.diagnose.finding import Finding, Severity, percent, shown
from verify.diagnose.material import weight_strain
from verify.diagnose.target import Target

Floats = NDArray[np.float64]

# Noise over the strain of the scene: not worth a word, worth one, visible.
UNSEEN, NOTED, SEEN = 1e-3, 1e-2, 1e-1
# Strains outside of these are no measure of a scene.
_STRAINS = (1e-6, 0.1)
_TURN = 1.0


@dataclass(frozen=True)
class Noise:
    """Rounding of the forces of one state, as strain: root mean square over the free vertices, and largest."""

    rms: float
    largest: float


def typical_strain(target: Target) -> float:
    """Strain that the scene causes: by weight, by impact v / c, or by its start, whichever is most."""
    world, mesh = target.world, target.disc.mesh
    wave = np.sqrt(world.E / world.rho).min()
    impact = float(np.linalg.norm(world.v0, axis=1).max()) / float(wave)
    D = (world.x0 - mesh.points)[mesh.cells]
    G = np.einsum("eka,ekb->eab", D[:, 1:] - D[:, :1], target.disc.B.reshape(-1, 3, 3))
    start = float(np.sqrt(np.median((0.25 * (G + G.transpose(0, 2, 1)) ** 2).sum(axis=(1, 2)))))
    return float(np.clip(max(weight_strain(target), impact, start), *_STRAINS))


def force_noise(target: Target, strain: float) -> dict[str, Noise]:
    """Noise of the forces at rest, smoothly strained, turned by one radian, and both."""
    disc = target.disc
    single = CpuBackend(disc, target.scene.solver.threads, precision="float32")
    weight = _force_per_strain(target)[disc.free]
    X = disc.mesh.points
    bent = _strained(X, strain)
    noise = {}
    for name, x in {"rest": X, "strained": bent, "turned": _turned(X), "turned and strained": _turned(bent)}.items():
        difference = np.linalg.norm(single.gradient(x) - target.backend.gradient(x), axis=1)[disc.free] / weight
        noise[name] = Noise(float(np.sqrt((difference**2).mean())), float(difference.max()))
    return noise


def precision(target: Target) -> Finding:
    """Whether single precision is good enough for the scene."""
    if not target.disc.free.any():
        return Finding("float32", Severity.OK, "Nothing can move.")
    strain = typical_strain(target)
    noise = force_noise(target, strain)
    worst = float(np.max([one.rms for one in noise.values()]))
    share = worst / strain
    substeps = target.scene.solver.substeps or DEFAULT_SUBSTEPS
    numbers = {
        "noise_as_strain": {name: {"rms": one.rms, "largest": one.largest} for name, one in noise.items()},
        "typical_strain": strain,
        "noise_over_typical_strain": share,
        "substeps_per_frame": substeps,
    }
    listed = ", ".join(f"{name} {one.rms:.1e}" for name, one in noise.items())
    what = (
        f"Rounding of float32 forces as strain (RMS; in units of E as stress): {listed}; at the worst vertex "
        f"{max(one.largest for one in noise.values()):.1e}. The scene strains by about {strain:.1e}: "
        f"{percent(share)} of that."
    )
    said, more = _positions(target, substeps)
    severity, advice = _judgement(share, target.scene.solver.precision)
    return Finding("float32", severity, what + said, advice, numbers | more)


def _judgement(share: float, used: str) -> tuple[Severity, str]:
    if share < UNSEEN:
        return Severity.OK, ""
    advice = 'Keep solver.precision = "float64".' if used == "float64" else 'Set solver.precision = "float64".'
    if share < NOTED:
        return Severity.NOTE, "float32 is fine for pictures. " + advice
    if used == "float64":
        return Severity.NOTE, f"float32 would be {'visibly ' if share >= SEEN else ''}wrong here. " + advice
    return Severity.WARNING if share < SEEN else Severity.PROBLEM, advice


def _positions(target: Target, substeps: int) -> tuple[str, dict[str, float]]:
    """What a solver that keeps positions in float32 loses: h^2 g against half a unit in their last place."""
    g = float(np.linalg.norm(target.scene.gravity))
    if g == 0.0:
        return "", {}
    half_ulp = 0.5 * float(np.spacing(np.float32(np.abs(target.world.x0).max())))
    increment = (target.frame / substeps) ** 2 * g
    safe = int(target.frame * np.sqrt(0.01 * g / half_ulp))
    said = (
        " femgal keeps positions in float64; a solver that keeps them in float32 adds "
        f"h^2 g = {shown(increment / half_ulp)} half units in the last place per substep at {substeps} substeps: up to "
        f"{_per_cent(half_ulp / increment)} of gravity is lost (1 % at {max(safe, 1):,} substeps)."
    )
    return said, {"increment_in_half_ulps": increment / half_ulp, "substeps_for_one_per_cent": safe}


def _per_cent(share: float) -> str:
    return "all" if share >= 1.0 else percent(share)


def _force_per_strain(target: Target) -> Floats:
    """sum_e E V |grad N_i| of each vertex [N], shape [n]."""
    disc = target.disc
    B = disc.B.reshape(-1, 3, 3)
    gradient = np.concatenate([-B.sum(axis=1, keepdims=True), B], axis=1)
    total = np.zeros(disc.n_vertices)
    np.add.at(total, disc.mesh.cells, (target.world.E * disc.V)[:, None] * np.linalg.norm(gradient, axis=2))
    return total


def _strained(X: Floats, strain: float) -> Floats:
    """Sheared back and forth along each axis, with strains up to about the one given."""
    low, size = X.min(axis=0), float(np.ptp(X, axis=0).max())
    return X + strain * size / np.pi * np.sin(np.pi * (np.roll(X, 1, axis=1) - np.roll(low, 1)) / size)


def _turned(x: Floats) -> Floats:
    """Turned by one radian about the axis (1, 2, 3) through the middle (Rodrigues)."""
    axis = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
    K = np.cross(np.eye(3), axis)
    R = np.eye(3) - np.sin(_TURN) * K + (1.0 - np.cos(_TURN)) * K @ K
    middle = x.mean(axis=0)
    return middle + (x - middle) @ R.T
