# SPDX-License-Identifier: BSD-3-Clause
"""Everything that is looked at, in the order in which an expert would tell it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from meshes.quality import quality
from verify.diagnose import locking, material, memory, parts, regime, rounding, shape, step
from verify.diagnose.finding import Finding, Severity
from verify.diagnose.target import Target
from verify.diagnose.thickness import thickness

Announce = Callable[[str], None]


@dataclass(frozen=True)
class Diagnosis:
    """All findings about the bodies of a scene.

    Parameters
    ----------
    name : Of the mesh or the scene.
    findings : One for everything that was looked at, the good ones too.
    """

    name: str
    findings: tuple[Finding, ...]

    @property
    def worst(self) -> Severity:
        """Severity of the worst finding."""
        return max((one.severity for one in self.findings), key=lambda severity: severity.rank)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        counts = Counter(one.severity.value for one in self.findings)
        return {
            "name": self.name,
            "counts": {severity.value: counts[severity.value] for severity in Severity},
            "findings": [one.as_dict() for one in self.findings],
        }


def diagnose(target: Target, announce: Announce = lambda text: None) -> Diagnosis:
    """Look at mesh, material and scene.

    Parameters
    ----------
    announce : Called with what is looked at next.
    """
    return Diagnosis(target.scene.name, tuple(_findings(target, announce)))


def _findings(target: Target, announce: Announce) -> Iterator[Finding]:
    announce("looking at the mesh")
    yield from _told(target)
    for look in (shape.size, shape.slivers, shape.edges, parts.parts, parts.seams, parts.hinges, parts.stuck):
        yield look(target)
    yield material.parameters(target)
    yield material.poisson(target)
    announce("measuring the stable step")
    found = step.stable_step(target)
    yield step.explicit_step(target, found)
    yield regime.regime(target, found)
    announce("measuring the thickness")
    rays = thickness(target.disc)
    yield locking.bending(target, rays)
    yield locking.volumetric(target, rays)
    announce("comparing single with double precision")
    yield rounding.precision(target)
    yield memory.memory(target)


def _told(target: Target) -> Iterator[Finding]:
    """What the readers have repaired, and what they say about the scene; what is judged here is left out."""
    known: Sequence[str] = quality(target.disc.mesh).warnings
    for origin in target.world.origins:
        for text in origin["messages"]:
            if text not in known:
                yield Finding("file", Severity.NOTE, f"{origin['name']}: {text}.")
    for text in target.world.warnings:
        if not any(text.endswith(said) for said in known) and ".mesh: " not in text and ".nu = " not in text:
            yield Finding("scene", Severity.WARNING, text + ".")
