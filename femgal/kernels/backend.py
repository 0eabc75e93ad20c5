# SPDX-License-Identifier: BSD-3-Clause
"""What solvers and time stepping ask of a device: element passes, work at nodes, sums over vertices.

Solvers know no other way to the elements. Three backends answer: `femgal.kernels.plain` (the slow, obvious reference),
`femgal.kernels.cpu` (tiles, in float32 or float64) and `femgal.kernels.cuda` (a GPU). Positions, velocities and all
that time stepping adds up stay in float64 whatever the precision of the element passes.

Arrays with a row per vertex, node or tetrahedron belong to the backend: on a GPU they are arrays of the device, and
only the backend's methods work on them. `to_host` brings one home. Small arrays and numbers are the host's; a `Number`
may be a `Deferred`, for which the host waits only when it is looked at.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.hierarchy.layer import Layer
from femgal.kernels.deferred import Number

if TYPE_CHECKING:
    from femgal.gauss_seidel.stars import Stars

Floats = NDArray[np.float64]

# Of the arithmetic in the element passes.
Precision = Literal["float32", "float64"]


@dataclass
class Passes:
    """Element passes by kind, in units of one pass over all tetrahedra of the finest mesh.

    A pass over a coarse layer counts by its (element, node) pairs against those of the finest layer. Work on assembled
    matrices, which makes no pass, counts by what it was measured to take in gradient passes.
    """

    gradient: float = 0.0
    gradient_and_blocks: float = 0.0
    hessian_product: float = 0.0
    energy: float = 0.0
    matrix: float = 0.0

    @property
    def total(self) -> float:
        """Passes of all kinds."""
        return sum(vars(self).values())

    def add(self, others: Passes) -> None:
        """Count other passes too."""
        for kind, number in vars(others).items():
            setattr(self, kind, getattr(self, kind) + number)

    def less(self, others: Passes) -> Passes:
        """What is left when other passes are taken off."""
        return Passes(**{kind: number - getattr(others, kind) for kind, number in vars(self).items()})

    def as_dict(self) -> dict[str, float]:
        """Passes by kind."""
        return dict(vars(self))


class CycleOnDevice(Protocol):
    """What a device makes of a V-cycle of assembled matrices (`femgal.solvers.multigrid.VCycle`)."""

    def refresh(self) -> None:
        """Take over the matrices and smoothers that the host's cycle has now."""

    def solve(self, r: Floats) -> Floats:
        """One cycle for A x = r from zero, shape [k, 3]."""

    def product(self, p: Floats) -> Floats:
        """The finest matrix times p, shape [k, 3]; only where the cycle has levels beside the bottom."""


class Prescribed(Protocol):
    """Prescribed motion of some vertices; the same as `femgal.timestep.state.Motion`."""

    @property
    def vertices(self) -> NDArray[np.int64]:
        """Indices of the vertices, shape [k]."""

    @property
    def is_fixed(self) -> bool:
        """Whether the vertices never move."""

    def positions(self, time: float) -> Floats:
        """Positions [m] at a time [s], shape [k, 3]."""


class Backend(Protocol):
    """Element and node passes over n vertices, m tetrahedra, and layers of k nodes.

    Attributes
    ----------
    disc : The discretised bodies.
    vertices : The finest layer.
    passes : Passes made so far.
    precision : Of the element passes.
    threads : CPU threads that share the work.
    """

    disc: Discretisation
    vertices: Layer
    passes: Passes

    @property
    def precision(self) -> Precision:
        """Of the element passes."""

    @property
    def threads(self) -> int:
        """CPU threads that share the work."""

    @property
    def runs_ahead(self) -> bool:
        """Whether work that has been asked for is done while the host goes on."""

    def to_device(self, values: Floats) -> Floats:
        """The backend's array with the values of a host array, in float64; a host backend's may share its memory."""

    def to_host(self, values: Floats) -> NDArray:
        """The host's array with the values of one of the backend's; may share its memory."""

    def fetch(self, values: Floats) -> Callable[[], NDArray]:
        """What `to_host` gives, as a call that waits for it: the copy is made while the device goes on."""

    def rows(self, x: Floats, vertices: NDArray[np.int64]) -> Floats:
        """The rows of an array at a list of vertices that never changes, shape [k, 3]."""

    def copy(self, x: Floats) -> Floats:
        """A copy that belongs to the caller."""

    def zeros(self, rows: int) -> Floats:
        """Zeros of shape [rows, 3]."""

    def gradient(self, x: Floats) -> Floats:
        """Gradient of the elastic energy at the free vertices [N], shape [n, 3], zero at constrained ones."""

    def hessian_product(self, x: Floats, d: Floats, *, definite: bool = False) -> Floats:
        """Elastic Hessian at x times d at the free vertices [N], shape [n, 3], zero at constrained ones.

        With `definite` the Hessian of every element is replaced by its positive semi-definite part (Smith et al. 2019).
        """

    def nodal_gradient(self, layer: Layer, x: Floats, xhat: Floats, inverse_h2: float) -> Floats:
        """P^T grad phi [N] of phi = |x - xhat|^2_M inverse_h2 / 2 + E, shape [k, 3]."""

    def gradient_and_blocks(self, layer: Layer, x: Floats, xhat: Floats, inverse_h2: float) -> tuple[Floats, Floats]:
        """Gradient and diagonal 3x3 blocks of phi = |x - xhat|^2_M inverse_h2 / 2 + E at the nodes of a layer.

        Returns
        -------
        g : P^T grad phi [N], shape [k, 3].
        H : Diagonal blocks of P^T (d2 phi) P [N/m], shape [k, 6], entries xx xy xz yy yz zz.
        """

    def correction(
        self, layer: Layer, x: Floats, xhat: Floats, inverse_h2: float, w: float = 1.0, *, scalar: bool = False
    ) -> tuple[Floats, Number]:
        """dx = -w H^-1 g at the nodes of a layer [m], shape [k, 3], and its slope g . dx [J].

        What `gradient_and_blocks` and `solve` give, without keeping g and H.
        """

    def nodal_product(self, layer: Layer, x: Floats, d: Floats, inverse_h2: float, *, definite: bool = False) -> Floats:
        """P^T (d2 phi)(x) d [N], shape [k, 3]; `definite` as in `hessian_product`, on the finest layer only."""

    def energies(self, x: Floats) -> tuple[Floats, Floats]:
        """Elastic energy [J] and volume ratio J of each tetrahedron, both shape [m]."""

    def energies_along(self, layer: Layer, x: Floats, d: Floats) -> Floats:
        """Coefficients of t, t^2, ..., t^6 in E(x + t d) [J], shape [6], for a d that the layer's nodes make."""

    def inertia_along(self, x: Floats, xhat: Floats, d: Floats, inverse_h2: float) -> Floats:
        """Coefficients of t and t^2 in |x + t d - xhat|^2_M inverse_h2 / 2 [J], shape [2]."""

    def solve(self, g: Floats, H: Floats, w: float, *, scalar: bool = False) -> Floats:
        """-w H^-1 g block by block [m], shape [k, 3]; with the diagonal of each block only when `scalar`."""

    def compare_blocks(self, g: Floats, old: Floats, H: Floats, *, scalar: bool = False) -> tuple[float, float]:
        """How much old blocks differ from new ones H.

        Returns
        -------
        (dx' - dx) . H (dx' - dx) [J] of the corrections dx' with the old and dx with the new blocks, and the largest
        |H' - H| over all nodes, in units of the mean diagonal entry of H.
        """

    def prolong(self, layer: Layer, dx: Floats, x: Floats) -> None:
        """x += P dx in place."""

    def restrict(self, layer: Layer, f: Floats) -> Floats:
        """P^T f, shape [k, 3]."""

    def add_scaled(self, x: Floats, t: float, d: Floats) -> None:
        """x += t d in place."""

    def difference(self, x: Floats, y: Floats, scale: float = 1.0) -> Floats:
        """scale (x - y), shape [n, 3]."""

    def predict(self, x: Floats, v: Floats, h: float, gravity: Floats, inertia: float = 1.0) -> Floats:
        """x + (h v + h^2 g) / inertia [m], shape [n, 3]: where inertia and gravity take the vertices in h seconds."""

    def kick_drift(self, x: Floats, v: Floats, a: Floats, h: float, decay: float) -> tuple[Floats, Floats]:
        """Positions x + h v' and velocities v' = decay v + h/2 a."""

    def accelerate_kick(self, g: Floats, v: Floats, gravity: Floats, h: float, growth: float) -> None:
        """In place the elastic gradient g becomes the acceleration a [m/s^2], and v becomes growth (v + h/2 a)."""

    def place(self, x: Floats, motion: Prescribed, time: float) -> None:
        """Put vertices where they have to be at a time [s], in place."""

    def place_velocities(self, v: Floats, vertices: NDArray[np.int64], x: Floats, before: Floats, h: float) -> None:
        """Velocities (x - before) / h of the listed vertices, in place."""

    def dot(self, a: Floats, b: Floats) -> float:
        """Sum of a * b over arrays of shape [k, 3]."""

    def largest(self, dx: Floats) -> Number:
        """Largest |component| of an array of shape [k, 3]; NaN when one of them is not finite."""

    def norm(self, a: Floats) -> float:
        """Square root of the sum of a * a over an array of rows."""

    def is_finite(self, x: Floats) -> bool:
        """Whether all entries of an array of rows are finite."""

    def looks_finite(self, x: Floats) -> bool:
        """The same for a look at every substep: False only if they are not; a device does not wait to find out."""

    def total(self, values: Floats) -> float:
        """Sum of a list of numbers."""

    def smallest(self, values: Floats) -> float:
        """Smallest of a list of numbers, not a number where one of them is not."""

    def kinetic_energy(self, v: Floats) -> float:
        """sum m |v|^2 / 2 [J]."""

    def weight_energy(self, x: Floats, gravity: Floats) -> float:
        """Potential energy of gravity [J], zero at the rest positions."""

    def mass_distance(self, x: Floats, y: Floats) -> float:
        """sum m |x - y|^2 [kg m^2]."""

    def divided_by_mass(self, f: Floats, scale: float = 1.0) -> Floats:
        """scale M^-1 f, shape [n, 3]."""

    def add_inertia(self, g: Floats, x: Floats, xhat: Floats, inverse_h2: float) -> None:
        """g += M (x - xhat) inverse_h2 [N] at the free vertices, in place."""

    def unit_mode(self, v: Floats) -> Floats:
        """v at the free vertices, zero at constrained ones, over its norm weighted by mass, shape [n, 3]."""

    def power_step(self, x: Floats, v: Floats) -> tuple[float, float, Floats]:
        """One power iteration with M^-1 K at x.

        Returns
        -------
        theta : Rayleigh quotient of v [1/s^2].
        bound : |w - theta v|_M for v of unit norm [1/s^2].
        w : M^-1 K v, of v of unit norm, shape [n, 3].
        """

    def descend(
        self,
        stars: Stars,
        ranges: Sequence[tuple[int, int]],
        phi: tuple[Floats, float],
        w: float,
        x: Floats,
        dx: Floats,
    ) -> None:
        """x_i -= w H_i^-1 g_i vertex by vertex, in place (`femgal.gauss_seidel.sweep.descend`).

        Parameters
        ----------
        stars, ranges : Of the free vertices; first star and number of stars of each colour.
        phi : xhat [m] and the factor of the mass [1/s^2].
        dx : Becomes what the vertex of each star has moved [m].
        """

    def take_off_fall(self, x: Floats, share: Floats, fall: Floats) -> None:
        """x -= (1 - share) fall, in place; one share per vertex, fall [m] of the host, shape [3]."""

    def share_of_gravity(self, x: Floats, xhat: Floats, gravity: Floats, inverse_h2: float) -> Floats:
        """Which part of gravity is in the accelerations (x - xhat) inverse_h2 + gravity: one per vertex, 0 to 1."""

    def cycle_on_device(self, cycle: Any) -> CycleOnDevice | None:
        """A V-cycle of the host, refreshed, made ready on the device; None where the host itself is to make it."""

    def von_mises(self, x: Floats) -> Floats:
        """Von Mises norm of the Cauchy stress of each tetrahedron [Pa], shape [m]."""
