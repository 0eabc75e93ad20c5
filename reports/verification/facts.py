# SPDX-License-Identifier: BSD-3-Clause
"""On what a run was made, as pairs of a name and a text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_VERSIONS = ("femgal", "python", "numpy", "scipy", "numba", "scikit-fem", "pyamg", "h5py", "meshio")


def facts(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Command, date, versions, processor, devices, threads, precisions and seed."""
    header = record["header"]
    versions = ", ".join(f"{name} {header[name]}" for name in _VERSIONS if header.get(name))
    found = [
        ("command", header["command"]),
        ("date", header["date"].replace("T", " ").replace("+00:00", " UTC")),
        ("versions", versions),
        ("platform", header.get("platform")),
        ("CPU", _cpu(header)),
        ("device of this run", header["device"]),
        *((f"device {name}", state) for name, state in header["devices"].items()),
        ("GPU", header.get("gpu")),
        ("threads", _threads(header)),
        ("precision", ", ".join(precisions(record)) or "float64"),
        ("seed", str(header["seed"])),
    ]
    return [(name, str(text)) for name, text in found if text]


def precisions(record: Mapping[str, Any]) -> list[str]:
    """Precisions that rows name, in order of appearance."""
    named = (row["values"].get("precision") for row in record["rows"])
    return list(dict.fromkeys(filter(None, named)))


def _cpu(header: Mapping[str, Any]) -> str:
    cores = header.get("processors") or header.get("cpu_cores")
    return f"{header.get('cpu') or 'unknown'}" + (f", {cores} processors" if cores else "")


def _threads(header: Mapping[str, Any]) -> str:
    if header["threads"] is not None:
        return str(header["threads"])
    cores = header.get("processors")
    return f"all ({cores})" if cores else "all"
