# SPDX-License-Identifier: BSD-3-Clause
"""The lowest mode that a scene excites: vibrations about the rest state, by how much of what drives it each takes.

Bodies hung by a tip have modes of several seconds that hardly move. What counts is the share of a mode in the drive d,
a velocity, an acceleration or a displacement: (phi . M d)^2 / (d . M d). Lanczos' method on K^-1 M that starts with d
gives frequencies and shares together (Golub and Meurant 1994: its first components are the weights of Gauss' rule).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from femgal.discretisation import Discretisation, discretise
from femgal.scene.build import World
from femgal.scene.model import Scene
from meshes.connectivity import component_labels

Floats = NDArray[np.float64]

# The lowest mode is the one up to which this share of a drive has gone. Bodies hung by an ear put less than a tenth
# into modes of several seconds, and 0.3 to 0.75 into the next one.
LEAST_SHARE = 0.2

_STEPS = 40

# Share of a drive that has to be left when rigid motions are taken out of parts that nothing holds.
_LEAST_DRIVE = 1e-6

# Raises the frequencies of rigid motions above zero, by next to nothing in terms of the largest ones.
_SHIFT = 1e-10


def lowest_excited_frequency(world: World, scene: Scene) -> float | None:
    """Frequency [1/s] of the lowest mode at rest that start velocity, gravity or start shape excite; None for none."""
    held = np.concatenate([np.empty(0, np.int64), *(motion.vertices for motion in world.motions)])
    modes = _Modes(discretise(world.mesh, world.E, world.nu, world.rho, held))
    found = [modes.lowest(drive) for drive in _drives(world, scene)]
    return min((f for f in found if f is not None), default=None)


def _drives(world: World, scene: Scene) -> Iterator[Floats]:
    """Velocities, accelerations and displacements that the motion starts from, shape [n, 3] each."""
    yield world.v0
    yield np.tile(np.asarray(scene.gravity, np.float64), (len(world.mesh.points), 1))
    yield world.x0 - world.mesh.points


def rest_stiffness(disc: Discretisation) -> sp.csr_matrix:
    """Stiffness at rest of all n vertices [N/m], shape [3 n, 3 n].

    At F = I the Hessian of stable neo-Hookean elasticity is dP = mu dF + (lam - mu) tr(dF) I + mu dF^T.
    """
    B = disc.B.reshape(-1, 3, 3)
    g = np.concatenate([-B.sum(axis=1, keepdims=True), B], axis=1)
    mu, lam = (a[:, None, None, None, None] for a in (disc.Vmu, disc.Vlam))
    K = mu * np.einsum("eak,ebk,ij->eaibj", g, g, np.eye(3), optimize=True)
    K += (lam - mu) * np.einsum("eai,ebj->eaibj", g, g) + mu * np.einsum("eaj,ebi->eaibj", g, g)
    dof = (3 * disc.mesh.cells[:, :, None].astype(np.int64) + np.arange(3)).reshape(-1, 12)
    where = (np.repeat(dof, 12, axis=1).ravel(), np.tile(dof, (1, 12)).ravel())
    return sp.csr_matrix((K.ravel(), where), shape=(3 * disc.n_vertices,) * 2)


class _Modes:
    """Vibrations of a body about its rest state, on its free components."""

    def __init__(self, disc: Discretisation) -> None:
        self._free = np.repeat(disc.free, 3)
        self._mass = np.repeat(disc.mass, 3)[self._free]
        K = rest_stiffness(disc)[self._free][:, self._free]
        self._shift = _SHIFT * float(K.diagonal().sum() / self._mass.sum())
        matrix = (K + self._shift * sp.diags(self._mass)).tocsc()
        # Symmetric and positive definite: no pivots are needed, which keeps the factors sparse.
        options = {"SymmetricMode": True}
        self._factors = spla.splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
        self._rigid = self._orthonormal(_rigid_motions(disc))

    def lowest(self, drive: Floats) -> float | None:
        """Frequency [1/s] of the lowest mode with a share of the drive, shape [n, 3]; None for a rigid motion."""
        d = drive.ravel()[self._free]
        q = self._without(self._rigid, d)
        size = self._norm(q)
        if not size > _LEAST_DRIVE * self._norm(d):
            return None
        values, shares = self._lanczos(q / size)
        # The largest value belongs to the lowest frequency.
        value = float(values[::-1][int(np.argmax(np.cumsum(shares[::-1]) >= LEAST_SHARE))])
        return math.sqrt(max(1.0 / value - self._shift, 0.0)) / (2.0 * math.pi)

    def _lanczos(self, q: Floats) -> tuple[Floats, Floats]:
        """1 / omega^2 [s^2], ascending, and the share of each in q."""
        basis, alpha, beta = [q], [], []
        for _ in range(min(_STEPS, len(q) - len(self._rigid))):
            u = self._factors.solve(self._mass * basis[-1])
            alpha.append(float(u @ (self._mass * basis[-1])))
            # Twice is enough to keep the basis orthonormal in spite of rounding.
            for _ in range(2):
                u = self._without([*self._rigid, *basis], u)
            beta.append(self._norm(u))
            if beta[-1] <= 1e-12 * alpha[0]:
                break
            basis.append(u / beta[-1])
        off = np.asarray(beta[: len(alpha) - 1])
        values, vectors = np.linalg.eigh(np.diag(alpha) + np.diag(off, 1) + np.diag(off, -1))
        return values, vectors[0] ** 2

    def _orthonormal(self, motions: list[Floats]) -> list[Floats]:
        """The same space, orthonormal by mass (Gram and Schmidt)."""
        found: list[Floats] = []
        for motion in motions:
            rest = self._without(found, motion[self._free])
            found.append(rest / self._norm(rest))
        return found

    def _without(self, modes: list[Floats], u: Floats) -> Floats:
        for mode in modes:
            u = u - float(mode @ (self._mass * u)) * mode
        return u

    def _norm(self, u: Floats) -> float:
        return math.sqrt(float(u @ (self._mass * u)))


def _rigid_motions(disc: Discretisation) -> list[Floats]:
    """Translations and rotations of every part that nothing holds, each of shape [3 n]."""
    part, found = component_labels(disc.mesh.cells), []
    for root in np.unique(part[disc.free]):
        mine = part == root
        if not disc.free[mine].all():
            continue
        arm = np.where(mine[:, None], disc.mesh.points - disc.mesh.points[mine].mean(axis=0), 0.0)
        axes = np.eye(3)
        found += [(mine[:, None] * axis).ravel() for axis in axes] + [np.cross(axis, arm).ravel() for axis in axes]
    return found
