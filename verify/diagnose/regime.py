# SPDX-License-Identifier: BSD-3-Clause
"""Which kind of solver the scene asks for: explicit steps against substeps, waves against frames."""

from __future__ import annotations

import math

import numpy as np

from femgal.scene.model import Scene
from femgal.simulation import Simulation
from verify.diagnose.finding import Finding, Severity, shown
from verify.diagnose.step import StableStep, substeps
from verify.diagnose.target import Target

# Measured on the pinned bunny: within a few times the work velocity Verlet is orders of magnitude more accurate, from
# ten times on implicit steps pay, and motions whose waves cross the body many times per frame are averaged away.
EXPLICIT_WINS, STIFF = 1.0, 10.0
_FAST_CROSSINGS = 1.0


def regime(target: Target, found: StableStep) -> Finding:
    """Explicit or implicit, from what each costs per frame."""
    if not math.isfinite(found.step):
        return Finding("regime", Severity.OK, "Nothing can move.")
    scene, world = target.scene, target.world
    explicit = substeps(target.frame, found.step)
    n, implicit = _implicit_passes(scene)
    length = float(np.ptp(target.disc.mesh.points, axis=0).max())
    wave = float(np.sqrt(world.E / world.rho).max())
    crossings = wave * target.frame / length
    h = target.frame / n
    numbers = {
        "explicit_passes_per_frame": explicit,
        "implicit_substeps_per_frame": n,
        "implicit_passes_per_frame": implicit,
        "ratio": explicit / implicit,
        "wave_speed_m_s": wave,
        "wave_crossings_per_frame": crossings,
        "substep_over_stable_step": h / found.step,
    }
    what = (
        f"Velocity Verlet needs {explicit:,} element passes per frame, FAS with {n} substeps about {implicit:.0f}; "
        f"each of these is {shown(h / found.step)} stable explicit steps long. Waves ({shown(wave, 3)} m/s) cross the "
        f"body {shown(crossings)} times per frame."
    )
    if explicit <= EXPLICIT_WINS * implicit:
        what += " Soft regime: explicit steps cost no more, and are far more accurate."
        if scene.solver.name == "verlet":
            return Finding("regime", Severity.OK, what, numbers=numbers)
        return Finding("regime", Severity.NOTE, what, 'Set solver.name = "verlet".', numbers)
    if explicit <= STIFF * implicit:
        what += " Middle regime: implicit steps pay for errors of about a per cent, Verlet for less."
        return Finding("regime", Severity.OK, what, numbers=numbers)
    what += " Stiff and light: implicit steps, and steps far too long for the fastest vibrations."
    advice = (
        "Use exact steps with enough substeps, and hold two runs with twice the substeps against each other; "
        + ("vibrations faster than a frame are damped away, not resolved." if crossings > _FAST_CROSSINGS else "")
    ).strip()
    return Finding("regime", Severity.NOTE, what, advice, numbers)


def _implicit_passes(scene: Scene) -> tuple[int, float]:
    """Substeps and element passes per frame of FAS with the scene's settings, or its own where it is not FAS's."""
    data = scene.model_dump()
    if scene.solver.name != "fas":
        data["solver"] = {"threads": scene.solver.threads}
    plan = Simulation.prepare(Scene.model_validate(data)).plan
    assert plan.substeps is not None
    return plan.substeps, plan.substeps * plan.passes_per_substep
