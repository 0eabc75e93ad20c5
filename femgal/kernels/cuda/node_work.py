# SPDX-License-Identifier: BSD-3-Clause
"""The part of the CUDA backend that needs no element; its methods are those of `femgal.kernels.backend.Backend`.

Every number that a method returns as a float is fetched at once and costs one wait for the device; a `Deferred` costs
one when somebody looks at it.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from femgal.discretisation import Discretisation
from femgal.hierarchy.layer import Layer, finest_layer
from femgal.kernels.backend import CycleOnDevice, Passes, Prescribed
from femgal.kernels.cuda import descent, nodes
from femgal.kernels.cuda.homeward import Homeward
from femgal.kernels.cuda.memory import Pool
from femgal.kernels.cuda.recording import Recording
from femgal.kernels.cuda.stream import THREADS, Stream, Upload
from femgal.kernels.deferred import Deferred, Number

if TYPE_CHECKING:
    from femgal.gauss_seidel.stars import Stars

# A device array; to solvers it is what an array of the host is to them on the CPU.
Floats = Any


class NodeWork:
    """State vectors in float64 on the device, and the work on them.

    Parameters
    ----------
    disc : The discretised bodies.
    threads : CPU threads for what is made on the host; None takes the processors that this process may use.
    finest : The finest layer, when it has been built already.
    """

    def __init__(self, disc: Discretisation, threads: int | None = None, finest: Layer | None = None) -> None:
        self.disc = disc
        self.vertices = finest or finest_layer(disc)
        self.passes = Passes()
        self.threads = threads or len(os.sched_getaffinity(0))
        self.stream, self.pool = Stream(), Pool()
        self._homeward = Homeward(self.stream)
        self._X, self._mass = self.put(disc.mesh.points), self.put(disc.mass)
        self._free = self.put(np.asarray(disc.free, np.int32))
        # Host arrays that do not change, by identity: gravity, lists of vertices.
        self._constants: dict[int, tuple[NDArray[Any], Any]] = {}
        self._places: dict[int, tuple[Prescribed, Any]] = {}

    def record(
        self, step: Callable[[], tuple[Any, list[Any]]], arrays: list[Any], time: float
    ) -> tuple[Any, Recording | None]:
        """Take a step from a state with these arrays; with its result a recording, None where it cannot be repeated.

        That is a step during which the host has looked at a number of the device, or sent it one: it may have decided
        something.

        Parameters
        ----------
        step : Returns its result and the arrays of the state that it led to.
        arrays : Nobody else may hold them.
        time : At which the step begins [s].
        """
        before, exchanges = replace(self.passes), self.stream.exchanges
        (result, outputs), launches, uploads = self.stream.record(step, time)
        if self.stream.exchanges != exchanges:
            return result, None
        return result, Recording(self.stream, launches, uploads, arrays, outputs, self.passes.less(before))

    def put(self, values: NDArray[Any]) -> Any:
        """A copy on the device, of the same type."""
        values = np.ascontiguousarray(values)
        return self.stream.upload(values, self.pool.take(values.shape, values.dtype))

    def to_device(self, values: Floats) -> Floats:
        """A copy on the device in float64; a device array as it is."""
        return self.put(np.asarray(values, np.float64)) if isinstance(values, np.ndarray) else values

    def to_host(self, values: Floats) -> NDArray[Any]:
        """A copy on the host; a host array as it is."""
        return values if isinstance(values, np.ndarray) else self.stream.download(values)

    @property
    def runs_ahead(self) -> bool:
        """Launches do not wait for each other."""
        return True

    def fetch(self, values: Floats) -> Callable[[], NDArray[Any]]:
        """What `to_host` gives, as a call that waits for it; the copy is made beside what is launched later."""
        if isinstance(values, np.ndarray):
            return lambda: values
        # A step in which the host asks for an array is not repeated: nothing would ask for it again.
        self.stream.exchanges += 1
        return self._homeward.send(values)

    def rows(self, x: Floats, vertices: NDArray[np.int64]) -> Floats:
        """The rows of an array at a list of vertices that never changes, shape [k, 3]."""
        out = self.pool.take((len(vertices), 3))
        self.stream.over_rows(nodes.gather_rows, len(vertices), self.constant(vertices, np.int32), x, out)
        return out

    def copy(self, x: Floats) -> Floats:
        """A copy that belongs to the caller."""
        out = self.pool.take(x.shape)
        self.stream.over_rows(nodes.copy_rows, len(x), x, out)
        return out

    def zeros(self, rows: int) -> Floats:
        """Zeros of shape [rows, 3]."""
        out = self.pool.take((rows, 3))
        self.stream.over_rows(nodes.fill_rows, rows, 0.0, out)
        return out

    def solve(self, g: Floats, H: Floats, w: float, *, scalar: bool = False) -> Floats:
        """-w H^-1 g block by block [m]; with the diagonal of each block only when `scalar`."""
        dx = self.pool.take(g.shape)
        self.stream.over_rows(nodes.solve, len(g), w, scalar, g, H, dx)
        return dx

    def compare_blocks(self, g: Floats, old: Floats, H: Floats, *, scalar: bool = False) -> tuple[float, float]:
        """(dx' - dx) . H (dx' - dx) [J] of the corrections that old and new blocks make, and their largest change."""
        if len(g) == 0:
            return 0.0, 0.0
        stale, change = self.pool.take((len(g),)), self.pool.take((len(g),))
        self.stream.over_rows(nodes.compare_blocks, len(g), scalar, g, old, H, stale, change)
        return self.total(stale), self._extremes(change)[1]

    def prolong(self, layer: Layer, dx: Floats, x: Floats) -> None:
        """x += P dx in place."""
        parent, weight = self._prolongation(layer)
        self.stream.over_rows(nodes.prolong, len(x), parent, weight, dx, x)

    def _prolongation(self, layer: Layer) -> tuple[Any, Any]:
        raise NotImplementedError

    def inertia_along(self, x: Floats, xhat: Floats, d: Floats, inverse_h2: float) -> NDArray[np.float64]:
        """Coefficients of t and t^2 in |x + t d - xhat|^2_M inverse_h2 / 2 [J], shape [2]."""
        slope = self._partial(nodes.mass_dot, len(x), self._mass, d, x, xhat)
        square = self._partial(nodes.mass_norm, len(x), self._mass, d)
        return inverse_h2 * np.array([self._sum(slope), 0.5 * self._sum(square)])

    def descend(
        self,
        stars: Stars,
        ranges: Sequence[tuple[int, int]],
        phi: tuple[Floats, float],
        w: float,
        x: Floats,
        dx: Floats,
    ) -> None:
        """x_i -= w H_i^-1 g_i vertex by vertex, in place; one launch per colour."""
        (xhat, inverse_h2), arrays = phi, [self.constant(array, array.dtype) for array in stars.arrays]
        for first, count in ranges:
            head, tail = (first, count, *arrays), (self._mass, inverse_h2, xhat, w, x, dx)
            self.stream.over_rows(descent.descend, count, *head, *tail)

    def take_off_fall(self, x: Floats, share: Floats, fall: NDArray[np.float64]) -> None:
        """x -= (1 - share) fall, in place; one share per vertex."""
        self.stream.over_rows(descent.take_off_fall, len(x), share, *(float(c) for c in fall), x)

    def share_of_gravity(self, x: Floats, xhat: Floats, gravity: NDArray[np.float64], inverse_h2: float) -> Floats:
        """Which part of gravity is in the accelerations (x - xhat) inverse_h2 + gravity: one per vertex, 0 to 1."""
        share = self.pool.take((len(x), 1))
        arguments = (x, xhat, self.constant(gravity), inverse_h2, share)
        self.stream.over_rows(descent.share_of_gravity, len(x), *arguments)
        return share

    def cycle_on_device(self, cycle: Any) -> CycleOnDevice:
        """A V-cycle of the host, refreshed, made ready on the device."""
        # It works with this class, so it is imported when there is one.
        from femgal.kernels.cuda.vcycle import DeviceCycle

        return DeviceCycle(self, cycle)

    def add_scaled(self, x: Floats, t: float, d: Floats) -> None:
        """x += t d in place."""
        self.stream.over_rows(nodes.add_scaled, len(x), x, t, d)

    def difference(self, x: Floats, y: Floats, scale: float = 1.0) -> Floats:
        """scale (x - y), shape [n, 3]."""
        out = self.pool.take(x.shape)
        self.stream.over_rows(nodes.difference, len(x), scale, x, y, out)
        return out

    def predict(self, x: Floats, v: Floats, h: float, gravity: NDArray[np.float64], inertia: float = 1.0) -> Floats:
        """x + (h v + h^2 g) / inertia [m], shape [n, 3]."""
        xhat = self.pool.take(x.shape)
        self.stream.over_rows(nodes.predict, len(x), x, v, h, self.constant(gravity), inertia, xhat)
        return xhat

    def kick_drift(self, x: Floats, v: Floats, a: Floats, h: float, decay: float) -> tuple[Floats, Floats]:
        """Velocity and positions after a half kick and a drift, `x, v`."""
        x_out, v_out = self.pool.take(x.shape), self.pool.take(x.shape)
        self.stream.over_rows(nodes.kick_drift, len(x), x, v, a, h, decay, x_out, v_out)
        return x_out, v_out

    def accelerate_kick(self, g: Floats, v: Floats, gravity: NDArray[np.float64], h: float, growth: float) -> None:
        """In place the elastic gradient g becomes the acceleration a [m/s^2], and v becomes growth (v + h/2 a)."""
        arguments = (self._mass, self._free, self.constant(gravity), h, growth, g, v)
        self.stream.over_rows(nodes.accelerate_kick, len(g), *arguments)

    def place(self, x: Floats, motion: Prescribed, time: float) -> None:
        """Put vertices where they have to be at a time [s], in place."""
        where, known = self.constant(motion.vertices, np.int32), self._places.get(id(motion))
        if known is None or not motion.is_fixed:
            target = self.pool.take((len(motion.vertices), 3))
            self.stream.upload_later(Upload(motion, time, target))
            # The motion is kept, so that no other one can take its identity.
            known = self._places[id(motion)] = (motion, target)
        self.stream.over_rows(nodes.place_rows, len(motion.vertices), where, known[1], x)

    def place_velocities(self, v: Floats, vertices: NDArray[np.int64], x: Floats, before: Floats, h: float) -> None:
        """Velocities (x - before) / h of the listed vertices, in place."""
        where = self.constant(vertices, np.int32)
        self.stream.over_rows(nodes.place_differences, len(vertices), where, x, before, 1.0 / h, v)

    def dot(self, a: Floats, b: Floats) -> float:
        """Sum of a * b over arrays of shape [k, 3]."""
        return self._sum(self._partial(nodes.dot, len(a), a, b))

    def norm(self, a: Floats) -> float:
        """Square root of the sum of a * a."""
        return math.sqrt(self.dot(a, a))

    def mass_distance(self, x: Floats, y: Floats) -> float:
        """sum m |x - y|^2 [kg m^2]."""
        d = self.difference(x, y)
        return self._sum(self._partial(nodes.mass_norm, len(d), self._mass, d))

    def divided_by_mass(self, f: Floats, scale: float = 1.0) -> Floats:
        """scale M^-1 f, shape [n, 3]."""
        out = self.pool.take(f.shape)
        self.stream.over_rows(nodes.scale_by_mass, len(f), self._mass, scale, f, out)
        return out

    def unit_mode(self, v: Floats) -> Floats:
        """v at the free vertices, zero at constrained ones, over its norm weighted by mass, shape [n, 3]."""
        out = self.pool.take(v.shape)
        scale = 1.0 / math.sqrt(self._sum(self._partial(nodes.free_mass_norm, len(v), self._mass, self._free, v)))
        self.stream.over_rows(nodes.free_rows, len(v), scale, self._free, v, out)
        return out

    def power_step(self, x: Floats, v: Floats) -> tuple[float, float, Floats]:
        """Rayleigh quotient of v in M^-1 K at x, its residual, and M^-1 K v, all of v of unit norm."""
        v = self.unit_mode(v)
        Kv = self.hessian_product(x, v)
        w = self.divided_by_mass(Kv)
        theta = self.dot(v, Kv)
        left = self.copy(w)
        self.add_scaled(left, -theta, v)
        return theta, math.sqrt(self._sum(self._partial(nodes.mass_norm, len(v), self._mass, left))), w

    def add_inertia(self, g: Floats, x: Floats, xhat: Floats, inverse_h2: float) -> None:
        """g += M (x - xhat) inverse_h2 [N] at the free vertices, in place."""
        self.stream.over_rows(nodes.add_inertia, len(g), self._mass, self._free, x, xhat, inverse_h2, g)

    def hessian_product(self, x: Floats, d: Floats, *, definite: bool = False) -> Floats:
        """Elastic Hessian at x, or its definite part, times d at the free vertices [N], zero at constrained ones."""
        raise NotImplementedError

    def largest(self, dx: Floats) -> Number:
        """Largest |component| of an array of shape [k, 3]; NaN when one of them is not finite; deferred."""
        if len(dx) == 0:
            return 0.0

        def read() -> float:
            least, most = self._extremes(dx.reshape(3 * len(dx)))
            return max(-least, most)

        return Deferred(read)

    def is_finite(self, x: Floats) -> bool:
        """Whether all entries of an array of rows are finite."""
        return len(x) == 0 or math.isfinite(float(self.largest(x)))

    def looks_finite(self, x: Floats) -> bool:
        """True: the frame's end looks, and nothing waits before."""
        return True

    def total(self, values: Floats) -> float:
        """Sum of a list of numbers."""
        return self._sum(self._partial(nodes.total_of, len(values), values))

    def smallest(self, values: Floats) -> float:
        """Smallest of a list of numbers, not a number where one of them is not."""
        return self._extremes(values)[0]

    def kinetic_energy(self, v: Floats) -> float:
        """sum m |v|^2 / 2 [J]."""
        return 0.5 * self._sum(self._partial(nodes.mass_norm, len(v), self._mass, v))

    def weight_energy(self, x: Floats, gravity: NDArray[np.float64]) -> float:
        """Potential energy of gravity [J], zero at the rest positions."""
        return -self._sum(self._partial(nodes.weight_energy, len(x), self._mass, x, self._X, self.constant(gravity)))

    def constant(self, values: NDArray[Any], dtype: Any = np.float64) -> Any:
        """The device's copy of a host array that never changes, made once."""
        known = self._constants.get(id(values))
        if known is None:
            # The host array is kept, so that no other one can take its identity.
            known = self._constants[id(values)] = (values, self.put(np.asarray(values, dtype)))
        return known[1]

    def _partial(self, kernel: Any, rows: int, *arguments: Any) -> Any:
        """What a summing kernel leaves for each chunk of rows."""
        chunks = -(-rows // nodes.SUM_CHUNK)
        out = self.pool.take((chunks,))
        self.stream.over_blocks(kernel, chunks, THREADS, 8 * THREADS, *arguments, out)
        return out

    def _sum(self, partial: Any) -> float:
        return float(self.stream.download(partial).sum())

    def _extremes(self, values: Any) -> tuple[float, float]:
        chunks = -(-len(values) // nodes.SUM_CHUNK)
        out = self.pool.take((2 * chunks,))
        self.stream.over_blocks(nodes.extremes, chunks, THREADS, 16 * THREADS, values, out)
        found = self.stream.download(out).reshape(-1, 2)
        return float(found[:, 0].min()), float(found[:, 1].max())
