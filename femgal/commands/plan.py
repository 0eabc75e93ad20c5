# SPDX-License-Identifier: BSD-3-Clause
"""`femgal plan`: what a run would do, and what it would skip."""

from __future__ import annotations

import sys
from typing import Any

import click

from femgal.commands.options import scene_from_options, scene_options


@click.command()
@scene_options
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def command(as_json: bool, **options: Any) -> None:
    """Print the plan of a scene: its stages, what each costs, and what is skipped and why."""
    scene = scene_from_options(**options)
    from femgal.simulation import Simulation

    simulation = Simulation.prepare(scene)
    if as_json:
        _print_json(simulation)
    else:
        _print_tables(simulation)


def _print_json(simulation: Any) -> None:
    import json
    from dataclasses import asdict

    plan = simulation.plan
    content = asdict(plan)
    content |= {"passes_per_substep": plan.passes_per_substep, "passes_per_frame": plan.passes_per_frame}
    content["choice"] = simulation.choice.as_dict() if simulation.choice else None
    content["mass_scaling"] = simulation.mass_scaling.as_dict() if simulation.mass_scaling else None
    content["warnings"] = list(simulation.world.warnings)
    click.echo(json.dumps(content, indent=2))


def _substeps(simulation: Any) -> str:
    plan, accuracy = simulation.plan, simulation.scene.solver.accuracy
    given = str(plan.substeps) if plan.substeps else "as many as stability asks for"
    return given if accuracy is None else f"{given} to begin with, then as the error asks for"


def _print_tables(simulation: Any) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Column, Table

    # A table is read by people: in a pipe or a log it keeps a width that needs no wrapping.
    console = Console() if sys.stdout.isatty() else Console(width=140)
    scene, plan = simulation.scene, simulation.plan
    console.print(f"{scene.name}: {simulation.disc.n_vertices} vertices, {simulation.disc.n_tets} tetrahedra")
    # Narrow terminals show what each stage costs and why, without the counts behind it.
    counts = ("unknowns", "tets") if console.width >= 110 else ()
    numbers = [Column(name, justify="right", no_wrap=True) for name in (*counts, "passes")]
    table = Table(
        "when",
        Column("stage", no_wrap=True),
        Column("", no_wrap=True),
        *numbers,
        Column("note", overflow="fold"),
        box=box.SIMPLE_HEAD,
        pad_edge=False,
    )
    for row in plan.rows():
        cells = row if counts else (*row[:3], *row[5:])
        table.add_row(*cells, style="dim" if row[2] == "skipped" else None)
    console.print(table)
    if simulation.hierarchy:
        console.print(str(simulation.hierarchy), highlight=False, soft_wrap=True)
    if simulation.choice:
        console.print(f"chosen: {simulation.choice}", soft_wrap=True)
    solves = f", {plan.solves} solves each" if plan.solves > 1 else ""
    console.print(f"substeps per frame: {_substeps(simulation)}{solves}")
    console.print(f"element passes per substep: {plan.passes_per_substep:.3f}; per frame: {plan.passes_per_frame:.3f}")
    for warning in simulation.world.warnings:
        console.print(f"warning: {warning}", style="yellow", soft_wrap=True)
