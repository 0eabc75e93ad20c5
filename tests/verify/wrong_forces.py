# SPDX-License-Identifier: BSD-3-Clause
"""Passes whose forces are five per cent too large while their energies are right: no gradient of anything they know."""

from __future__ import annotations

from verify.suite.use import Use

FACTOR = 1.05


class StrongBackend:
    """The passes of a backend, with the wrong factor in the forces."""

    def __init__(self, backend):
        self._backend = backend

    def __getattr__(self, name):
        return getattr(self._backend, name)

    def gradient(self, x):
        return FACTOR * self._backend.gradient(x)


class StrongUse(Use):
    """Makes such passes."""

    def backend(self, disc, precision="float64"):
        return StrongBackend(super().backend(disc, precision))
