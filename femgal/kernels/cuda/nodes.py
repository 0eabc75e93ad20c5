# SPDX-License-Identifier: BSD-3-Clause
"""Work at nodes and vertices that needs no element; the counterpart of `femgal.kernels.cpu.nodes` and of `motion`.

All in float64. Sums go over chunks of SUM_CHUNK rows, one block of threads each, and the chunks are added up in order.
"""

from __future__ import annotations

from math import sqrt

from femgal.kernels.cpu.nodes import scaled_by_block, scaled_by_diagonal
from femgal.kernels.cuda.jit import Floats, IntRows, Ints, Rows, cuda, float64, inlined, kernel
from femgal.kernels.cuda.shared import add_threads
from femgal.materials.tensor import Vector

# Rows per partial sum.
SUM_CHUNK = 4096


@inlined
def block_of(H: Rows, i: int) -> Vector:
    """Six entries of a symmetric block."""
    return (H[i, 0], H[i, 1], H[i, 2], H[i, 3], H[i, 4], H[i, 5])


@inlined
def block_correction(w: float, g: Vector, H: Vector, scalar_blocks: bool) -> Vector:
    """-w H^-1 g, or with the diagonal of H only."""
    return scaled_by_diagonal(w, g, H) if scalar_blocks else scaled_by_block(w, g, H)


@kernel
def solve(w: float, scalar_blocks: bool, g: Rows, H: Rows, dx: Rows) -> None:
    """dx[i] = -w H[i]^-1 g[i], or with the diagonal of H[i] only."""
    for i in range(cuda.grid(1), dx.shape[0], cuda.gridsize(1)):
        s = block_correction(w, (g[i, 0], g[i, 1], g[i, 2]), block_of(H, i), scalar_blocks)
        dx[i, 0], dx[i, 1], dx[i, 2] = s[0], s[1], s[2]


@kernel
def compare_blocks(scalar_blocks: bool, g: Rows, old: Rows, H: Rows, stale: Floats, change: Floats) -> None:
    """Of each node (dx' - dx) . H (dx' - dx), and |H' - H|_F over the mean diagonal entry of H."""
    for i in range(cuda.grid(1), g.shape[0], cuda.gridsize(1)):
        f, h, k = (g[i, 0], g[i, 1], g[i, 2]), block_of(H, i), block_of(old, i)
        a, b = block_correction(1.0, f, h, scalar_blocks), block_correction(1.0, f, k, scalar_blocks)
        d0, d1, d2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        total = h[0] * d0 * d0 + h[3] * d1 * d1 + h[5] * d2 * d2
        stale[i] = total + 2.0 * (h[1] * d0 * d1 + h[2] * d0 * d2 + h[4] * d1 * d2)
        square = (h[0] - k[0]) ** 2 + (h[3] - k[3]) ** 2 + (h[5] - k[5]) ** 2
        square += 2.0 * ((h[1] - k[1]) ** 2 + (h[2] - k[2]) ** 2 + (h[4] - k[4]) ** 2)
        change[i] = 3.0 * sqrt(square) / (h[0] + h[3] + h[5])


@kernel
def prolong(parent: IntRows, weight: Rows, dx: Rows, x: Rows) -> None:
    """x += P dx."""
    for v in range(cuda.grid(1), x.shape[0], cuda.gridsize(1)):
        for s in range(parent.shape[1]):
            i, w = parent[v, s], weight[v, s]
            if i >= 0:
                x[v, 0] += w * dx[i, 0]
                x[v, 1] += w * dx[i, 1]
                x[v, 2] += w * dx[i, 2]


@kernel
def add_scaled(x: Rows, t: float, d: Rows) -> None:
    """x += t d."""
    for v in range(cuda.grid(1), x.shape[0], cuda.gridsize(1)):
        for a in range(x.shape[1]):
            x[v, a] += t * d[v, a]


@kernel
def difference(scale: float, x: Rows, y: Rows, out: Rows) -> None:
    """out = scale (x - y)."""
    for v in range(cuda.grid(1), x.shape[0], cuda.gridsize(1)):
        for a in range(x.shape[1]):
            out[v, a] = scale * (x[v, a] - y[v, a])


@kernel
def copy_rows(x: Rows, out: Rows) -> None:
    """out = x."""
    for v in range(cuda.grid(1), x.shape[0], cuda.gridsize(1)):
        for a in range(x.shape[1]):
            out[v, a] = x[v, a]


@kernel
def fill_rows(value: float, out: Rows) -> None:
    """out = value everywhere."""
    for v in range(cuda.grid(1), out.shape[0], cuda.gridsize(1)):
        for a in range(out.shape[1]):
            out[v, a] = value


@kernel
def gather_rows(vertices: Ints, x: Rows, out: Rows) -> None:
    """out[k] = x[vertices[k]]."""
    for k in range(cuda.grid(1), out.shape[0], cuda.gridsize(1)):
        v = vertices[k]
        out[k, 0], out[k, 1], out[k, 2] = x[v, 0], x[v, 1], x[v, 2]


@kernel
def place_rows(vertex: Ints, position: Rows, x: Rows) -> None:
    """x[vertex[k]] = position[k]."""
    for k in range(cuda.grid(1), vertex.shape[0], cuda.gridsize(1)):
        for a in range(3):
            x[vertex[k], a] = position[k, a]


@kernel
def place_differences(vertex: Ints, x: Rows, before: Rows, scale: float, v: Rows) -> None:
    """v = scale (x - before) at the listed vertices."""
    for k in range(cuda.grid(1), vertex.shape[0], cuda.gridsize(1)):
        for a in range(3):
            v[vertex[k], a] = scale * (x[vertex[k], a] - before[vertex[k], a])


@kernel
def scale_by_mass(mass: Floats, scale: float, g: Rows, out: Rows) -> None:
    """out = scale g / m."""
    for v in range(cuda.grid(1), g.shape[0], cuda.gridsize(1)):
        for a in range(3):
            out[v, a] = scale * g[v, a] / mass[v]


@kernel
def predict(x: Rows, v: Rows, h: float, gravity: Floats, inertia: float, xhat: Rows) -> None:
    """xhat = x + (h v + h^2 g) / inertia."""
    for i in range(cuda.grid(1), x.shape[0], cuda.gridsize(1)):
        for a in range(3):
            xhat[i, a] = x[i, a] + (h * v[i, a] + h * h * gravity[a]) / inertia


@kernel
def kick_drift(x: Rows, v: Rows, acceleration: Rows, h: float, decay: float, x_out: Rows, v_out: Rows) -> None:
    """v_out = decay v + h/2 a and x_out = x + h v_out."""
    half = 0.5 * h
    for i in range(cuda.grid(1), x.shape[0], cuda.gridsize(1)):
        for a in range(3):
            kicked = decay * v[i, a] + half * acceleration[i, a]
            v_out[i, a] = kicked
            x_out[i, a] = x[i, a] + h * kicked


@kernel
def accelerate_kick(mass: Floats, free: Ints, gravity: Floats, h: float, growth: float, g: Rows, v: Rows) -> None:
    """In place g becomes a = gravity - g / mass, zero where a vertex is not free, and v becomes growth (v + h/2 a)."""
    half = 0.5 * h
    for i in range(cuda.grid(1), v.shape[0], cuda.gridsize(1)):
        moves = float(free[i])
        scale = moves / mass[i]
        for c in range(3):
            a = moves * gravity[c] - scale * g[i, c]
            g[i, c] = a
            v[i, c] = growth * (v[i, c] + half * a)


@kernel
def add_inertia(mass: Floats, free: Ints, x: Rows, xhat: Rows, inverse_h2: float, g: Rows) -> None:
    """g += M (x - xhat) inverse_h2 at the free vertices."""
    for i in range(cuda.grid(1), x.shape[0], cuda.gridsize(1)):
        scale = free[i] * inverse_h2 * mass[i]
        for c in range(3):
            g[i, c] += scale * (x[i, c] - xhat[i, c])


@inlined
def leave_sum(scratch: Floats, total: float, out: Floats) -> None:
    """out[block] = sum of `total` over the threads of the block."""
    t = cuda.threadIdx.x
    scratch[t] = total
    add_threads(scratch, 1)
    if t == 0:
        out[cuda.blockIdx.x] = scratch[0]


@kernel
def dot(a: Rows, b: Rows, out: Floats) -> None:
    """out[c] = sum of a * b over chunk c."""
    scratch, total = cuda.shared.array(0, float64), 0.0
    last = min(a.shape[0], (cuda.blockIdx.x + 1) * SUM_CHUNK)
    for i in range(cuda.blockIdx.x * SUM_CHUNK + cuda.threadIdx.x, last, cuda.blockDim.x):
        for q in range(a.shape[1]):
            total += a[i, q] * b[i, q]
    leave_sum(scratch, total, out)


@kernel
def mass_dot(mass: Floats, a: Rows, b: Rows, c: Rows, out: Floats) -> None:
    """out[k] = sum of m a (b - c) over chunk k."""
    scratch, total = cuda.shared.array(0, float64), 0.0
    last = min(a.shape[0], (cuda.blockIdx.x + 1) * SUM_CHUNK)
    for i in range(cuda.blockIdx.x * SUM_CHUNK + cuda.threadIdx.x, last, cuda.blockDim.x):
        for q in range(3):
            total += mass[i] * a[i, q] * (b[i, q] - c[i, q])
    leave_sum(scratch, total, out)


@kernel
def mass_norm(mass: Floats, a: Rows, out: Floats) -> None:
    """out[k] = sum of m a^2 over chunk k."""
    scratch, total = cuda.shared.array(0, float64), 0.0
    last = min(a.shape[0], (cuda.blockIdx.x + 1) * SUM_CHUNK)
    for i in range(cuda.blockIdx.x * SUM_CHUNK + cuda.threadIdx.x, last, cuda.blockDim.x):
        for q in range(3):
            total += mass[i] * a[i, q] * a[i, q]
    leave_sum(scratch, total, out)


@kernel
def free_mass_norm(mass: Floats, free: Ints, a: Rows, out: Floats) -> None:
    """out[k] = sum of m a^2 over the free vertices of chunk k."""
    scratch, total = cuda.shared.array(0, float64), 0.0
    last = min(a.shape[0], (cuda.blockIdx.x + 1) * SUM_CHUNK)
    for i in range(cuda.blockIdx.x * SUM_CHUNK + cuda.threadIdx.x, last, cuda.blockDim.x):
        for q in range(3):
            total += free[i] * mass[i] * a[i, q] * a[i, q]
    leave_sum(scratch, total, out)


@kernel
def free_rows(scale: float, free: Ints, a: Rows, out: Rows) -> None:
    """out = scale a at the free vertices, zero at the others."""
    for v in range(cuda.grid(1), a.shape[0], cuda.gridsize(1)):
        for q in range(3):
            out[v, q] = scale * a[v, q] if free[v] != 0 else 0.0


@kernel
def weight_energy(mass: Floats, x: Rows, X: Rows, gravity: Floats, out: Floats) -> None:
    """out[k] = sum of m g . (x - X) over chunk k."""
    scratch, total = cuda.shared.array(0, float64), 0.0
    last = min(x.shape[0], (cuda.blockIdx.x + 1) * SUM_CHUNK)
    for i in range(cuda.blockIdx.x * SUM_CHUNK + cuda.threadIdx.x, last, cuda.blockDim.x):
        for q in range(3):
            total += mass[i] * gravity[q] * (x[i, q] - X[i, q])
    leave_sum(scratch, total, out)


@kernel
def total_of(values: Floats, out: Floats) -> None:
    """out[c] = sum of chunk c of a list of numbers."""
    scratch, total = cuda.shared.array(0, float64), 0.0
    last = min(values.shape[0], (cuda.blockIdx.x + 1) * SUM_CHUNK)
    for i in range(cuda.blockIdx.x * SUM_CHUNK + cuda.threadIdx.x, last, cuda.blockDim.x):
        total += values[i]
    leave_sum(scratch, total, out)


@kernel
def row_sums(values: Floats, length: int, out: Floats) -> None:
    """out[q] = sum of values[q length] to values[(q + 1) length - 1]."""
    scratch, total = cuda.shared.array(0, float64), 0.0
    q = cuda.blockIdx.x
    for i in range(q * length + cuda.threadIdx.x, (q + 1) * length, cuda.blockDim.x):
        total += values[i]
    leave_sum(scratch, total, out)


@kernel
def extremes(values: Floats, out: Floats) -> None:
    """out[2 c] and out[2 c + 1] = smallest and largest number of chunk c, not a number where one of them is not."""
    scratch = cuda.shared.array(0, float64)
    t, n, c = cuda.threadIdx.x, cuda.blockDim.x, cuda.blockIdx.x
    first, last = c * SUM_CHUNK, min(values.shape[0], (c + 1) * SUM_CHUNK)
    least = most = values[first]
    spoilt = 0.0
    for i in range(first + t, last, n):
        least, most = min(least, values[i]), max(most, values[i])
        # Zero unless the number is not finite, and then not a number.
        spoilt += values[i] - values[i]
    scratch[t], scratch[n + t] = least + spoilt, most + spoilt
    half = n // 2
    while half > 0:
        cuda.syncthreads()
        if t < half:
            a, b = scratch[t], scratch[t + half]
            scratch[t] = min(a, b) + (a - a) + (b - b)
            a, b = scratch[n + t], scratch[n + t + half]
            scratch[n + t] = max(a, b) + (a - a) + (b - b)
        half //= 2
    cuda.syncthreads()
    if t == 0:
        out[2 * c], out[2 * c + 1] = scratch[0], scratch[n]
