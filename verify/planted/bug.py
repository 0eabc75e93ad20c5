# SPDX-License-Identifier: BSD-3-Clause
"""What a planted bug is."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Bug:
    """One edit of one source file.

    Parameters
    ----------
    name : What is wrong then, in a few words.
    file : Where, relative to the repository.
    old, new : The text that stands there once, and what takes its place.
    cases : Rows that should notice, as for ``femgal verify -k``.
    """

    name: str
    file: str
    old: str
    new: str
    cases: str
