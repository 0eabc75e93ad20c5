# SPDX-License-Identifier: BSD-3-Clause
"""The material on its own: assumed or given, Poisson's ratios that are risky, and weight against stiffness."""

from __future__ import annotations

import numpy as np

from verify.diagnose.finding import Finding, Severity, percent
from verify.diagnose.target import Target

# Strain under its own weight at which a body is no longer itself.
SAGS, COLLAPSES = 0.1, 0.5


def weight_strain(target: Target) -> float:
    """rho g L / E: strain at the bottom of a column as tall as the bodies are long."""
    length = float(np.ptp(target.disc.mesh.points, axis=0).max())
    g = float(np.linalg.norm(target.scene.gravity))
    return float((target.world.rho * g * length / target.world.E).max())


def parameters(target: Target) -> Finding:
    """E, nu and rho, where they come from, and what the body's own weight does to it."""
    world, strain = target.world, weight_strain(target)
    ranges = {"E_Pa": world.E, "nu": world.nu, "rho_kg_m3": world.rho}
    what = f"E = {_range(world.E)} Pa, nu = {_range(world.nu)}, rho = {_range(world.rho)} kg/m^3"
    what = ("Assumed: " if target.assumed else "") + what
    what += f"; its own weight strains it by about {percent(strain)}."
    numbers = {name: [values.min(), values.max()] for name, values in ranges.items()} | {"weight_strain": strain}
    if strain >= SAGS:
        advice = "E is in pascals and rho in kg/m^3: check the units, or expect a heap."
        severity = Severity.WARNING if strain >= COLLAPSES else Severity.NOTE
        return Finding("material", severity, what, advice, numbers)
    if target.assumed:
        advice = "No material was given: what follows holds for this one. Give --scene, or --set bodies.0.E=..."
        return Finding("material", Severity.NOTE, what, advice, numbers)
    return Finding("material", Severity.OK, what, numbers=numbers)


def poisson(target: Target) -> Finding:
    """Poisson's ratios of zero and below."""
    nu = target.world.nu
    share = float((nu <= 0.0).mean())
    numbers = {"smallest_nu": nu.min(), "share_not_positive": share}
    if share == 0.0:
        return Finding("sign of nu", Severity.OK, f"nu > 0 everywhere (smallest {nu.min():.3g}).", numbers=numbers)
    what = (
        f"nu <= 0 in {percent(share)} of the tetrahedra (smallest {nu.min():.3g}): a body crushed to a point can "
        "have less energy than at rest, and elements that collapse may stay collapsed."
    )
    return Finding("sign of nu", Severity.WARNING, what, "Use nu > 0 where large compression is possible.", numbers)


def _range(values: np.ndarray) -> str:
    low, high = float(values.min()), float(values.max())
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
