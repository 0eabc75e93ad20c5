# SPDX-License-Identifier: BSD-3-Clause
"""The bugs: what somebody could get wrong in each part of the solver, and the rows that must notice."""

from __future__ import annotations

from verify.planted.bug import Bug
from verify.planted.bugs_of_solvers import BUGS_OF_SOLVERS

_MATERIAL = "femgal/materials/stable_neo_hookean.py"
_FORM = "femgal/materials/displacement_form.py"
_TENSOR = "femgal/materials/tensor.py"
_TILE = "femgal/kernels/cpu/tile_arithmetic.py"
_SLOTS = "femgal/kernels/cpu/slots.py"
_NODES = "femgal/kernels/cpu/nodes.py"
_REST = "femgal/kernels/cpu/rest.py"
_LAYER = "femgal/hierarchy/layer.py"
_MOTION = "femgal/kernels/cpu/motion.py"

_FORCES = "P, _ = stress_and_cofactor(_displacement_gradient(points, l, B, A), "

BUGS = (
    Bug(
        "lam_Lame in place of lam",
        _MATERIAL,
        "return mu_lame, lam_lame + mu_lame",
        "return mu_lame, lam_lame",
        "material/youngs-modulus[float64",
    ),
    Bug(
        "mu without 1 + nu",
        _MATERIAL,
        "mu_lame = E / (2.0 * (1.0 + nu))",
        "mu_lame = E / 2.0",
        "material/youngs-modulus[float64",
    ),
    Bug("sign of c in the stress", _FORM, "    s = lam * j\n", "    s = -lam * j\n", "material/uniform-forces[float64"),
    Bug(
        "cofactor transposed",
        _FORM,
        "        D[1] - G[3],\n        D[2] - G[6],\n        D[3] - G[1],\n",
        "        D[3] - G[1],\n        D[2] - G[6],\n        D[1] - G[3],\n",
        "invariance/forces[float64 invariance/sum-of-moments[float64",
    ),
    Bug(
        "sign of a cofactor",
        _TENSOR,
        "        F[5] * F[6] - F[3] * F[8],\n",
        "        F[3] * F[8] - F[5] * F[6],\n",
        "invariance/forces[float64 blocks/vertex-gradients[box,float64",
    ),
    Bug(
        "determinant of two products",
        _TENSOR,
        "return F[0] * C[0] + F[1] * C[1] + F[2] * C[2]",
        "return F[0] * C[0] + F[1] * C[1]",
        "blocks/vertex-gradients[box,float64",
    ),
    Bug(
        "half of mu I_C lost",
        _FORM,
        "mu * (like(mu, 0.5) * contract(G, G)",
        "mu * (contract(G, G)",
        "material/uniform-energy[float64",
    ),
    Bug(
        "half of lam (J - 1)^2 lost",
        _FORM,
        "+ like(mu, 0.5) * lam * j * j, j",
        "+ lam * j * j, j",
        "material/uniform-energy[float64",
    ),
    Bug(
        "block without the third of |u|^2",
        _FORM,
        "d = mu * (u[0] * u[0] + u[1] * u[1] + u[2] * u[2])",
        "d = mu * (u[0] * u[0] + u[1] * u[1])",
        "blocks/vertex-blocks[box,float64",
    ),
    Bug(
        "block without lam",
        _FORM,
        "y = (lam * z[0], lam * z[1], lam * z[2])",
        "y = (z[0], z[1], z[2])",
        "blocks/vertex-blocks[box,float64",
    ),
    Bug(
        "z from P in place of C",
        _FORM,
        "g, z = apply(P, u), apply(C, u)",
        "g, z = apply(P, u), apply(P, u)",
        "blocks/coarse-blocks[clusters-8,box,float64",
    ),
    Bug(
        "sign of mu in the second derivative of J",
        _FORM,
        "P, lam * j - mu, cofactor_increment",
        "P, lam * j + mu, cofactor_increment",
        "blocks/hessian-products[box,float64",
    ),
    Bug(
        "sign in the derivative of the cofactor",
        _TENSOR,
        "F[4] * G[8] + G[4] * F[8] - F[5] * G[7] - G[5] * F[7],",
        "F[4] * G[8] + G[4] * F[8] - F[5] * G[7] + G[5] * F[7],",
        "derivatives/exact-product[float64 derivatives/symmetry[float64",
    ),
    Bug(
        "third coefficient of the line without mu",
        _FORM,
        "lam * (j1 * j2 + j0 * j3) - mu * j3,",
        "lam * (j1 * j2 + j0 * j3),",
        "blocks/along-a-line[box,float64 derivatives/energy-along[float64",
    ),
    Bug(
        "twists as flips in the definite Hessian",
        _MATERIAL,
        "_above_zero((mu + x, mu + y, mu + z))",
        "_above_zero((mu - x, mu - y, mu - z))",
        "eigenvalues/definite-part[float64",
    ),
    Bug("1/6 of the volume dropped", _REST, "V[e] = det / 6.0", "V[e] = det", "blocks/vertex-gradients[box,float64"),
    Bug(
        "a fifth of the mass per vertex",
        _REST,
        "0.25 * density[e]",
        "0.2 * density[e]",
        "stepping/frequency[verlet dynamics/free-fall[verlet",
    ),
    Bug(
        "F transposed",
        _TILE,
        "return multiply(edges, B)",
        "return multiply(B, edges)",
        "material/uniform-forces[float64 invariance/forces[float64",
    ),
    Bug(
        "first corner misses a force",
        _TILE,
        "f0 = (-(f1[0] + f2[0] + f3[0]),",
        "f0 = (-(f1[0] + f2[0]),",
        "invariance/sum-of-forces[float64",
    ),
    Bug(
        "affine motion of a block not given back in float32",
        _TILE,
        "return add(A, G) if tile.itemsize == 4 else G",
        "return G",
        "invariance/turned-noise[float32 material/uniform-forces[float32",
    ),
    Bug(
        "first slot of a node skipped",
        _SLOTS,
        "    for j in range(slot_ptr[i], slot_ptr[i + 1]):\n        k = TERMS * slot[j]",
        "    for j in range(slot_ptr[i] + 1, slot_ptr[i + 1]):\n        k = TERMS * slot[j]",
        "blocks/vertex-blocks[box,float64",
    ),
    Bug(
        "no mass in the blocks",
        _SLOTS,
        "        a += weight[j] * s\n",
        "        a += 0.0 * weight[j] * s\n",
        "blocks/vertex-blocks[box,float64 blocks/coarse-blocks[clusters-8,box,float64",
    ),
    Bug(
        "w in place of w^2 in the mass of a block",
        _SLOTS,
        "        a += weight[j] * s\n",
        "        a += s\n",
        "blocks/coarse-blocks[lattice,box,float64",
    ),
    Bug(
        "h in place of h^2",
        "femgal/timestep/potential.py",
        "return self.inertia / self.h**2",
        "return self.inertia / self.h",
        "exact/wave-backward-euler[longitudinal,fas,float64",
    ),
    Bug(
        "restriction without weight",
        _NODES,
        "        s0 += weight[j] * f[v, 0]\n",
        "        s0 += f[v, 0]\n",
        "transfer/transpose",
    ),
    Bug(
        "prolongation without weight",
        _NODES,
        "x[v, 0] += weight[v, k] * dx[i, 0]",
        "x[v, 0] += dx[i, 0]",
        "transfer/assembled transfer/translation",
    ),
    Bug(
        "fixed vertices moved",
        _NODES,
        "            if i >= 0:\n",
        "            if i >= -1:\n",
        "transfer/fixed-vertices",
    ),
    Bug(
        "sign in the 3x3 inverse",
        _NODES,
        "c * e - b * f, b * e - c * d",
        "c * e + b * f, b * e - c * d",
        "blocks/corrections[box,float64",
    ),
    Bug(
        "coarsest layer left out",
        "femgal/solvers/cycle.py",
        "return self._visit(kind, 0, n_layers - 1)",
        "return self._visit(kind, 0, max(0, n_layers - 2))",
        "cycles/product-of-corrections[fas cycles/product-of-corrections[v-",
    ),
    Bug(
        "boundary elements of two clusters skipped",
        _LAYER,
        "is_active[e] = n > 0",
        "is_active[e] = n > 2",
        "blocks/left-out-elements blocks/active-elements",
    ),
    Bug(
        "u of a node from one vertex only",
        _LAYER,
        "u[p, 0] += w * g0",
        "u[p, 0] = w * g0",
        "blocks/coarse-gradients[box,float64",
    ),
    Bug(
        "grad N_0 from a row in place of a column",
        _LAYER,
        "g0 = -(B[e, 0] + B[e, 3] + B[e, 6])",
        "g0 = -(B[e, 0] + B[e, 1] + B[e, 2])",
        "blocks/coarse-gradients[box,float64",
    ),
    Bug(
        "lattice weights in the wrong order",
        "femgal/hierarchy/lattice.py",
        "if f[axis[a]] < f[axis[b]]:",
        "if f[axis[a]] > f[axis[b]]:",
        "transfer/linear-fields transfer/lattice-weights",
    ),
    Bug("gravity times h", _NODES, "h * h * gravity[a]", "h * gravity[a]", "dynamics/free-fall[fas"),
    Bug(
        "velocity from the prediction",
        "femgal/timestep/implicit.py",
        "self.backend.difference(result.x, past.y, 1.0 / past.h_e)",
        "self.backend.difference(potential.xhat, past.y, 1.0 / past.h_e)",
        "exact/wave-backward-euler[longitudinal,fas,float64",
    ),
    Bug(
        "a whole kick in place of a half",
        _MOTION,
        "    half = 0.5 * h\n    for i in range(start, stop):\n        kicked",
        "    half = h\n    for i in range(start, stop):\n        kicked",
        "exact/wave-verlet[longitudinal,float64 dynamics/free-fall[verlet",
    ),
    Bug(
        "no second half of the kick",
        _MOTION,
        "v[i, c] = growth * (v[i, c] + half * a)",
        "v[i, c] = growth * v[i, c]",
        "dynamics/free-fall[verlet",
    ),
    Bug(
        "momentum of free bodies not restored",
        "femgal/solvers/smoother.py",
        "        if self.free_parts is not None:\n",
        "        if self.free_parts is not None and potential.h < 0.0:\n",
        "system/free-momentum",
    ),
    Bug(
        "step lengths twice as long",
        "femgal/solvers/smoother.py",
        "return np.minimum(2.0 / (1.0 + lambdas), STABLE_SHARE * (1.0 - potential.least_response) / lambdas)",
        "return np.minimum(4.0 / (1.0 + lambdas), 2.0 * STABLE_SHARE * (1.0 - potential.least_response) / lambdas)",
        "smoothers/largest smoothers/stable-steps",
    ),
    Bug(
        "spectrum without the block inverse",
        "femgal/solvers/spectrum.py",
        "backend.solve(backend.to_device(r), H, -1.0, scalar=scalar)",
        "backend.solve(backend.to_device(r), H, -1.0, scalar=True)",
        "smoothers/largest smoothers/stable-steps",
    ),
    Bug(
        "a checkpoint forgets the memory",
        "femgal/runner.py",
        "for name, array in self.state.memory.items()}",
        "for name, array in ()}",
        "system/resume",
    ),
    Bug(
        "forces 5 % too large",
        _TILE,
        _FORCES + "mu, lam)",
        _FORCES + "mu * 1.05, lam * 1.05)",
        "manufactured/h1-order[uniform manufactured/error[h1,uniform exact/hanging-bar",
    ),
    Bug(
        "lam 5 % too small in the forces",
        _TILE,
        _FORCES + "mu, lam)",
        _FORCES + "mu, lam * 0.95)",
        "bending/same-elements[cook,float64 bending/same-elements[cantilever,float64",
    ),
    Bug(
        "one lane of a block too soft",
        _TILE,
        _FORCES + "mu, lam)",
        _FORCES + "mu * (1.0 if l else 0.99), lam)",
        "patch/interior-forces[float64,sheared,box patch/newton[sheared,box",
    ),
    *BUGS_OF_SOLVERS,
)
