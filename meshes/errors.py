# SPDX-License-Identifier: BSD-3-Clause
"""The one kind of error that a user's input can cause."""

from __future__ import annotations


class InputError(ValueError):
    """Something the user wrote or supplied cannot be used.

    The command line turns it into one message and exit code 2.

    Parameters
    ----------
    what : str
        What is wrong, as a sentence without a full stop.
    where : str
        File, key or argument at fault.
    found, allowed : object
        The value that was met and what would have been accepted; left out of the message when None.
    advice : str
        What to do about it.
    """

    def __init__(
        self,
        what: str,
        *,
        where: str = "",
        found: object = None,
        allowed: object = None,
        advice: str = "",
    ) -> None:
        self.what, self.where, self.found, self.allowed, self.advice = what, where, found, allowed, advice
        super().__init__(self._message())

    def _message(self) -> str:
        lines = [f"{self.where}: {self.what}" if self.where else self.what]
        for label, value in (("found", self.found), ("allowed", self.allowed), ("do", self.advice or None)):
            if value is not None:
                lines.append(f"  {label + ':':9s}{value}")
        return "\n".join(lines)


class MeshError(InputError):
    """A mesh that no solver should see: empty, broken indices, NaN, zero volume, open surface ..."""
