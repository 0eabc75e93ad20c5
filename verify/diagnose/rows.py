# SPDX-License-Identifier: BSD-3-Clause
"""Rows of the suite that make sense on a user's own mesh and material."""

from __future__ import annotations

from verify.diagnose.target import Target
from verify.problems.bodies import OWN, use_own_body
from verify.suite.case import Row
from verify.suite.run import choose


def own_rows(target: Target, pattern: str | None = None, *, quick: bool = True) -> list[Row]:
    """Rows of the cases that are true on any mesh, to be run on the target's; as `verify.suite.run.choose`.

    Raises
    ------
    InputError
        No row fits the pattern.
    """
    use_own_body(target.disc)
    chosen = choose(pattern, quick=quick, axes={"mesh": (OWN,)})
    return [row for row in chosen if row.case.own_mesh]
