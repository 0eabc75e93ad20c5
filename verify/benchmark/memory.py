# SPDX-License-Identifier: BSD-3-Clause
"""How much memory this process may still take."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from meshes.errors import InputError

# Limit, use, and the use that is given back on demand, of a control group: version 2, then version 1.
_GROUPS = (
    ("memory.max", "memory.current", "memory.stat", "inactive_file"),
    ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes", "memory/memory.stat", "total_inactive_file"),
)


def available_memory(proc: Path = Path("/proc"), groups: Path = Path("/sys/fs/cgroup")) -> int | None:
    """Bytes that can be taken without swapping, within the limit of the control group; None where nobody says.

    Parameters
    ----------
    proc, groups : Where the kernel keeps its accounts.
    """
    known = [_system(proc), *(_group(groups, *names) for names in _GROUPS)]
    return min((left for left in known if left is not None), default=None)


def _system(proc: Path) -> int | None:
    with suppress(OSError, ValueError, KeyError):
        return _table(proc / "meminfo")["MemAvailable"] * 1024
    return None


def _group(groups: Path, limit: str, use: str, stat: str, reclaimable: str) -> int | None:
    # No limit reads "max", which is not a number, or a number beyond any memory.
    with suppress(OSError, ValueError):
        held = int((groups / use).read_text())
        with suppress(OSError, ValueError, KeyError):
            held -= _table(groups / stat)[reclaimable]
        return max(0, int((groups / limit).read_text()) - held)
    return None


def _table(path: Path) -> dict[str, int]:
    """Numbers by name of a file of lines like "MemAvailable: 12 kB"."""
    words = (line.split() for line in path.read_text().splitlines())
    return {line[0].rstrip(":"): int(line[1]) for line in words if len(line) >= 2}


def require_memory(needed: float, what: str, *, where: str, advice: str) -> None:
    """Refuse what would not fit.

    Parameters
    ----------
    needed : Bytes.
    what : What needs them, as the subject of a sentence.
    where, advice : As in `InputError`.

    Raises
    ------
    InputError
        More is needed than is available.
    """
    left = available_memory()
    if left is not None and needed > left:
        raise InputError(
            f"{what} would not fit into memory",
            where=where,
            found=f"about {needed / 1e6:.0f} MB",
            allowed=f"{left / 1e6:.0f} MB are available",
            advice=advice,
        )
