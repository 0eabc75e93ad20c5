# SPDX-License-Identifier: BSD-3-Clause
"""A run that cannot go on: what happened, where, and what to try."""

from __future__ import annotations

from collections.abc import Mapping


class SolverFailure(RuntimeError):
    """The motion ran away; the frames before are good.

    Parameters
    ----------
    what : What was observed.
    frame, substep : Where; substep None when it was seen at the end of the frame.
    layer : Layer with the largest last correction, None for methods without layers.
    energies : The last finite energies [J] by name.
    advice : What to try.
    """

    def __init__(
        self,
        what: str,
        *,
        frame: int,
        substep: int | None,
        layer: str | None,
        energies: Mapping[str, float | None],
        advice: str,
    ) -> None:
        self.what, self.frame, self.substep, self.layer = what, frame, substep, layer
        self.energies, self.advice = dict(energies), advice
        super().__init__(self._message())

    def as_dict(self) -> dict[str, object]:
        """The same for run.json."""
        return {
            "what": self.what,
            "frame": self.frame,
            "substep": self.substep,
            "layer": self.layer,
            "last_energies": self.energies,
            "advice": self.advice,
        }

    def _message(self) -> str:
        where = f"frame {self.frame}" + (f", substep {self.substep}" if self.substep is not None else "")
        lines = [f"{where}: {self.what}"]
        if self.layer is not None:
            lines.append(f"  layer:   {self.layer} made the largest correction")
        numbers = ", ".join(f"{name} {value:.4g} J" for name, value in self.energies.items() if value is not None)
        lines.append(f"  energy:  {numbers}")
        lines.append(f"  do:      {self.advice}")
        return "\n".join(lines)
