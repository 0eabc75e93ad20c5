# SPDX-License-Identifier: BSD-3-Clause
"""`femgal mesh`: make, look at, convert and download meshes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from meshes.make import Made
    from meshes.types import TriMesh

Rows = list[tuple[str, str]]

_JSON = click.option("--json", "as_json", is_flag=True, help="Print one JSON object and nothing else.")
_FORCE = click.option("--force", is_flag=True, help="Overwrite an existing file.")


@click.group()
def command() -> None:
    """Make, look at, convert and download meshes.

    A mesh is named by a path, by a file in the folders of FEMGAL_MESH_PATH, or by rabbit, sphere, cube or beam.
    """


@command.command()
@click.argument("name")
@click.option("--vertices", type=int, help="Wanted number of vertices, met within 5%; 5000 by default.")
@click.option("--out", type=click.Path(path_type=Path), help="File to write; its suffix chooses the format.")
@_FORCE
@_JSON
def make(name: str, vertices: int | None, out: Path | None, force: bool, as_json: bool) -> None:
    """Fill a closed surface with tetrahedra, or generate a shape, and report the quality."""
    from meshes.io.source import writable
    from meshes.io.tets import check_format, write_tets
    from meshes.make import make_tets
    from meshes.quality import quality

    if out is not None:
        check_format(writable(out, force=force))
    made = make_tets(name, vertices)
    messages = list(made.messages)
    if out is not None:
        messages += write_tets(out, made.mesh)
    measured = quality(made.mesh)
    # A file's warnings are among the messages already.
    messages += [text for text in measured.warnings if text not in messages]
    report = _report(made)
    content = _origin(made) | {"quality": measured.as_dict(), "tetrahedralisation": report, "messages": messages}
    content["out"] = None if out is None else str(out)
    rows = [*_origin_rows(made), *measured.rows(), *_report_rows(report)]
    _show(content, rows, messages, as_json)
    if out is not None and not as_json:
        click.echo(f"wrote {out}")


@command.command()
@click.argument("name", required=False)
@_JSON
def info(name: str | None, as_json: bool) -> None:
    """Describe a file or a mesh of the catalogue; without NAME, list the catalogue."""
    if name is None:
        _list(as_json)
        return
    from meshes.catalogue import resolve
    from meshes.make import load
    from meshes.types import TriMesh

    loaded = load(resolve(name))
    if isinstance(loaded, TriMesh):
        _show_surface(loaded, as_json)
        return
    from meshes.quality import quality

    measured = quality(loaded.mesh)
    messages = list(dict.fromkeys([*loaded.messages, *measured.warnings]))
    content = _origin(loaded) | {"quality": measured.as_dict(), "messages": messages}
    _show(content, [*_origin_rows(loaded), *measured.rows()], messages, as_json)


@command.command()
@click.argument("source", metavar="IN")
@click.argument("target", metavar="OUT", type=click.Path(path_type=Path))
@_FORCE
def convert(source: str, target: Path, force: bool) -> None:
    """Check and repair a mesh file and write it in another format (both tetrahedra, or both surfaces)."""
    from meshes.catalogue import resolve
    from meshes.io.source import writable
    from meshes.io.surfaces import write_surface
    from meshes.io.tets import write_tets
    from meshes.make import load
    from meshes.types import TriMesh

    writable(target, force=force)
    loaded = load(resolve(source))
    if isinstance(loaded, TriMesh):
        write_surface(target, loaded)
        messages = []
    else:
        messages = [*loaded.messages, *write_tets(target, loaded.mesh)]
    for text in messages:
        click.echo(text, err=True)
    click.echo(f"wrote {target}")


@command.command()
@click.argument("name")
@click.option("--accept-terms", is_flag=True, help="You have read the credit and terms that are shown without it.")
def download(name: str, accept_terms: bool) -> None:
    """Fetch a mesh of the registry into the user's cache."""
    from meshes.remote import download as fetch
    from meshes.remote import registry

    path = fetch(name, accept_terms=accept_terms)
    entry = registry()[name]
    click.echo(f"{path}\ncredit: {entry.credit}\nterms: {entry.terms}")


def _origin(made: Made) -> dict[str, Any]:
    from dataclasses import asdict

    return asdict(made.mesh.origin) | {"content_hash": made.mesh.content_hash}


def _origin_rows(made: Made) -> Rows:
    import numpy as np

    origin = made.mesh.origin
    rows = [("name", origin.name), ("source", origin.source)]
    rows += [("sha256", origin.sha256)] if origin.sha256 else []
    rows += [("terms", origin.terms)] if origin.terms else []
    regions = np.unique(made.mesh.regions)
    return rows + ([("regions", ", ".join(map(str, regions[:12])))] if len(regions) > 1 else [])


def _report(made: Made) -> dict[str, Any] | None:
    distance = made.distance()
    return None if made.report is None or distance is None else made.report | {"distance": distance.as_dict()}


def _report_rows(report: dict[str, Any] | None) -> Rows:
    if report is None:
        return []
    distance = report["distance"]
    return [
        ("lattice spacing [m]", f"{report['spacing']:.5g}"),
        ("volume lost", f"{100 * report['lost_share']:.2f}%"),
        (
            "distance to the surface mean / max [diagonals]",
            f"{distance['relative_mean']:.2e} / {distance['relative_maximum']:.2e}",
        ),
    ]


def _show_surface(surface: TriMesh, as_json: bool) -> None:
    from dataclasses import asdict

    from meshes.surface import manifold_report

    report = manifold_report(surface.cells).as_dict()
    size = (surface.points.max(axis=0) - surface.points.min(axis=0)).tolist()
    volume = surface.enclosed_volume if report["closed"] else None
    content = asdict(surface.origin) | {"surface": report, "size": size, "enclosed_volume": volume}
    rows = [("name", surface.origin.name), ("source", surface.origin.source), ("sha256", surface.origin.sha256)]
    rows += [("size [m]", " x ".join(f"{x:.5g}" for x in size))]
    rows += [] if volume is None else [("enclosed volume [m^3]", f"{volume:.6g}")]
    rows += [(key.replace("_", " "), str(value)) for key, value in report.items()]
    closed = [] if report["closed"] else ["an open surface cannot be filled with tetrahedra"]
    _show(content, rows, closed, as_json)


def _list(as_json: bool) -> None:
    from dataclasses import asdict

    from meshes.catalogue import known

    entries = known()
    if as_json:
        _print_json({"meshes": [asdict(entry) for entry in entries]})
        return
    _print([(entry.name, entry.kind, entry.description, entry.source) for entry in entries])


def _show(content: dict[str, Any], rows: Rows, messages: list[str], as_json: bool) -> None:
    if as_json:
        _print_json(content)
        return
    _print(rows)
    for text in messages:
        click.echo(text, err=True)


def _print(rows: Sequence[tuple[str, ...]]) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(show_header=False)
    for k in range(len(rows[0])):
        table.add_column(overflow="fold", style="dim" if k == 0 else None)
    for row in rows:
        table.add_row(*map(Text, row))  # Text: "[m]" is a unit here, not markup
    Console().print(table)


def _print_json(content: dict[str, Any]) -> None:
    import json

    click.echo(json.dumps(content, indent=2))
