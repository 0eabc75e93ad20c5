# SPDX-License-Identifier: BSD-3-Clause
"""Bugs in implicit formulas, Newton's method, preconditioners, assembly and sweeps over vertices."""

from __future__ import annotations

from verify.planted.bug import Bug

_BDF2 = "femgal/timestep/bdf2.py"
_TR_BDF2 = "femgal/timestep/tr_bdf2.py"
_NEWTON = "femgal/solvers/newton.py"

BUGS_OF_SOLVERS = (
    Bug(
        "BDF2 blind to the length of the step before",
        _BDF2,
        "r * r / (1.0 + 2.0 * r))",
        "r / (1.0 + 2.0 * r))",
        "stepping/formula[fas-bdf2 stepping/varying-steps[fas-bdf2",
    ),
    Bug(
        "h in place of h_e in BDF2",
        _BDF2,
        "return Past(y, w, h * (1.0 + r) / (1.0 + 2.0 * r))",
        "return Past(y, w, h)",
        "stepping/vibration[fas-bdf2 stepping/formula[fas-bdf2",
    ),
    Bug(
        "velocity of BDF2 from the last state alone",
        "femgal/timestep/implicit.py",
        "v = self.backend.difference(result.x, past.y, 1.0 / past.h_e)",
        "v = self.backend.difference(result.x, state.x, 1.0 / past.h_e)",
        "stepping/vibration[fas-bdf2 stepping/formula[fas-bdf2",
    ),
    Bug(
        "another gamma in TR-BDF2",
        _TR_BDF2,
        "GAMMA = 2.0 - math.sqrt(2.0)",
        "GAMMA = 0.5",
        "stepping/vibration[newton-multigrid stepping/order[newton-multigrid",
    ),
    Bug(
        "h in place of h_e in the acceleration of TR-BDF2",
        _TR_BDF2,
        "w, past.h_e)\n\n    def _accelerated",
        "w, h)\n\n    def _accelerated",
        "stepping/formula[newton-multigrid stepping/vibration[newton-multigrid",
    ),
    Bug(
        "line search skipped",
        _NEWTON,
        "        t = first_minimum(coefficients)\n",
        "        t = 1.0\n",
        "newton/falls newton/indefinite",
    ),
    Bug(
        "negative curvature unseen",
        "femgal/solvers/pcg.py",
        "if not curvature > 0.0:",
        "if curvature == 0.0:",
        "newton/falls newton/indefinite",
    ),
    Bug(
        "preconditioner made elsewhere after a restart",
        "femgal/solvers/upkeep.py",
        "self._make(potential, memory[PLACE], made_for)",
        "self._make(potential, x.copy() if self._place is None else self._place, made_for)",
        "dynamics/restart[newton-multigrid",
    ),
    Bug(
        "reduction ends a solve that has an absolute tolerance",
        _NEWTON,
        "        if self.budget.tolerance is not None:\n            # Where",
        "        if self.budget.tolerance is not None and state.start == 0.0:\n            # Where",
        "newton/minimiser stepping/one-step[newton-multigrid",
    ),
    Bug(
        "momentum of free bodies not restored by Newton's method",
        _NEWTON,
        "        if self.free_parts is not None:\n",
        "        if self.free_parts is not None and potential.h < 0.0:\n",
        "system/free-momentum[newton-multigrid",
    ),
    Bug(
        "finest layer added twice",
        "femgal/solvers/preconditioner.py",
        "zip(self.layers[1:], self._H[1:], strict=True)",
        "zip(self.layers, self._H, strict=True)",
        "preconditioners/formula[layers",
    ),
    Bug(
        "cycle that does not come back up",
        "femgal/solvers/layer_cycle.py",
        "order = [*down, *reversed(down[:-1])]",
        "order = list(down)",
        "preconditioners/symmetric[cycle preconditioners/formula[cycle",
    ),
    Bug(
        "coarse corrections of additive Schwarz left out",
        "femgal/solvers/mas.py",
        "self._workers.run(add_coarse, len(z), level",
        "self._workers.run(add_coarse, 0, level",
        "preconditioners/domains preconditioners/iterations[mas",
    ),
    Bug(
        "matrix of the start never made anew",
        "femgal/solvers/linearised.py",
        "if state.iteration % self.sweeps == 0:",
        "if state.iteration == 0:",
        "stepping/one-step[vbd-explicit stepping/one-step[jacobi-explicit",
    ),
    Bug(
        "sign of a twist in the assembled definite part",
        "femgal/assembly/element_blocks.py",
        "q = (half * (flip[0] - twist[0]),",
        "q = (half * (twist[0] - flip[0]),",
        "assembly/definite[box",
    ),
    Bug(
        "block below the diagonal not transposed",
        "femgal/assembly/hessian.py",
        "values[k + 1] + blocks[f + 3 * W],",
        "values[k + 1] + blocks[f + W + 0],",
        "assembly/hessian[box",
    ),
    Bug(
        "neighbours of one colour",
        "femgal/gauss_seidel/colours.py",
        "        while met_by[c] == v:",
        "        if met_by[c] == v:",
        "descent/vertex-minimum",
    ),
    Bug(
        "vertex descent without mu in the pressure",
        "femgal/gauss_seidel/stars.py",
        "(Vlam[e] + Vmu[e]) / (6.0 * V[e])",
        "Vlam[e] / (6.0 * V[e])",
        "descent/vertex-minimum stepping/one-step[vbd,",
    ),
)
