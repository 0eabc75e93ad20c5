# SPDX-License-Identifier: BSD-3-Clause
"""Proves the solvers: references, verification cases, work-precision and stability studies.

``from verify import check_solver`` runs the cases about solvers with a function of one's own
(`verify.integrators.plug_in`).
"""

from __future__ import annotations

from typing import Any


def __getattr__(name: str) -> Any:
    # Only who plugs in a solver pays for the imports that it needs.
    if name == "check_solver":
        from verify.integrators.plug_in import check_solver

        return check_solver
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
