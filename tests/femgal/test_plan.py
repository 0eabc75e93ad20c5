# SPDX-License-Identifier: BSD-3-Clause
"""A scene pays only for what it uses.

1. Stages that a scene has no use for are listed as skipped, with the reason; those it needs run.
2. A skipped stage compiles nothing: its kernels have no compiled signature after a whole run.
3. A skipped stage is never called: a run goes through with its functions replaced by ones that raise, and the same
   replacement stops the run of a scene that needs the stage (so the test can fail).
4. Interior elements of coarse layers are counted as skipped, and the passes per substep follow from the pairs.
5. A coarse layer that the mesh is too small for is not built even when asked for.
6. The passes that the plan names are those that the run log counts, for every solver and kind of step.
7. With the linear transfer the plan speaks of lattices, names no cluster, and its passes are those that are made.
8. Fields that a scene cannot have are refused with what is allowed.
8. The cycle that the plan shows is the one that a substep makes, and the extrapolation says what it is bound by.
"""

from __future__ import annotations

import subprocess
import sys

import pytest

from femgal.scene.load import parse_scene
from femgal.simulation import Simulation
from femgal.solvers.fas import FAS
from meshes.errors import InputError

BEAM = """
name = "small"
frames = 1
gravity = [0.0, 0.0, 0.0]
{top}
[[bodies]]
mesh = "cube"
vertices = 343
E = 1e5
nu = 0.3
rho = 1000.0
velocity = [0.0, 0.0, 1.0]
{constraint}
[solver]
name = "{solver}"
substeps = 4
ratio = 8
[output]
fields = [{fields}]
"""
HELD = "[[constraints]]\nwhere = {halfspace = {point = [0, 0, 0.01], normal = [0, 0, -1]}}\n"
PULLED = HELD + "path = {times = [0.0, 1.0], offsets = [[0, 0, 0], [0, 0, 0.1]]}\n"


def scene(top="", constraint="", solver="fas", fields='"displacement"', steps="exact", blocks="auto"):
    text = BEAM.format(top=top, constraint=constraint, solver=solver, fields=fields)
    return parse_scene(text, "small.toml", overrides={"solver.steps": steps, "solver.blocks": blocks})


def skipped(plan):
    return {stage.name for stage in plan.stages if not stage.runs}


def test_free_body_skips_what_it_does_not_need():
    plan = Simulation.prepare(scene()).plan
    assert {"damping", "fixed vertices", "moving vertices", "field von_mises", "stopping test"} <= skipped(plan)
    assert all(stage.note for stage in plan.stages)


def test_each_need_brings_its_stage():
    everything = scene("damping = 0.5", PULLED, fields='"displacement", "von_mises", "region"')
    plan = Simulation.prepare(everything).plan
    for name in ("damping", "moving vertices", "field von_mises", "field region", "residual"):
        assert plan.runs(name), name
    assert "fixed vertices" in skipped(plan)
    assert Simulation.prepare(scene("", HELD)).plan.runs("fixed vertices")


@pytest.mark.parametrize("solver", ["jacobi", "verlet"])
def test_only_multigrid_builds_a_hierarchy(solver):
    simulation = Simulation.prepare(scene(solver=solver))
    assert simulation.hierarchy is None
    assert "hierarchy" in skipped(simulation.plan)
    assert simulation.plan.runs("residual") == (solver != "verlet")


CHILD = """
import sys
from femgal.runner import run
from femgal.scene.load import parse_scene
assert run(parse_scene(sys.stdin.read(), "small.toml")).status == "finished"
from femgal.kernels.cpu import passes, slots
from femgal.kernels.plain import elements
from femgal.hierarchy import clusters
for kernel in (elements.von_mises_stresses, passes.vertex_products, passes.pair_products, slots.sum_and_solve,
               passes.vertex_terms, passes.pair_terms, passes.pair_forces, clusters._spread, passes.vertex_forces):
    print(kernel.__name__, len(kernel.signatures))
"""


def compiled(text) -> dict[str, int]:
    result = subprocess.run([sys.executable, "-c", CHILD], input=text, capture_output=True, text=True, check=True)
    return {name: int(count) for name, count in (line.split() for line in result.stdout.splitlines())}


def test_skipped_stages_compile_nothing():
    text = BEAM.format(top="", constraint="", solver="verlet", fields='"displacement"')
    counts = compiled(text)
    assert counts["vertex_forces"] == 1
    assert {name for name, n in counts.items() if n == 1} == {"vertex_forces"}


def test_needed_stages_are_compiled():
    text = BEAM.format(top="", constraint="", solver="fas", fields='"displacement", "von_mises"')
    counts = compiled(text.replace("ratio = 8", 'ratio = 8\nsteps = "spectral"\nblocks = "fresh"'))
    assert {name for name, n in counts.items() if n == 0} == {"pair_forces"}


@pytest.mark.parametrize(
    ("target", "needs"),
    [
        ("femgal.kernels.cpu.backend.CpuBackend.von_mises", {"fields": '"displacement", "von_mises"'}),
        ("femgal.scene.motion.Motion.positions", {"constraint": HELD}),
        ("femgal.simulation.build_constant_hierarchy", {"solver": "fas"}),
        ("femgal.timestep.potential.IncrementalPotential.gradient", {"solver": "fas"}),
    ],
)
def test_skipped_stages_are_never_called(monkeypatch, target, needs):
    def forbidden(*args, **kwargs):
        raise AssertionError("a skipped stage was called")

    monkeypatch.setattr(target, forbidden)

    def run(**options):
        return list(Simulation.prepare(scene(**options)).frames())

    assert len(run(solver="verlet")) == 2
    with pytest.raises(AssertionError, match="skipped stage"):
        run(**needs)


def test_interior_elements_and_passes_add_up():
    simulation = Simulation.prepare(scene(steps="spectral", blocks="fresh"))
    plan, layers = simulation.plan, simulation.hierarchy.layers
    assert len(layers) >= 2
    for number, layer in enumerate(layers[1:], start=1):
        row = next(stage for stage in plan.stages if stage.name == f"interior of layer {number}")
        assert row.elements == simulation.disc.n_tets - len(layer.active)
    pairs = sum(layer.n_pairs for layer in layers) / layers[0].n_pairs
    assert plan.passes_per_substep == pytest.approx(pairs, rel=1e-12)
    frame = list(simulation.frames())[1]
    assert frame.row["passes_by_kind"]["gradient_and_blocks"] == pytest.approx(4 * pairs, rel=1e-12)


@pytest.mark.parametrize(
    ("solver", "lines"),
    [
        ("fas", 'steps = "spectral"'),
        ("fas", 'steps = "exact"'),
        ("fas", 'steps = "exact"\niterations = 3'),
        ("fas", "tolerance = 1e-16\niterations = 2"),
        ("fas", 'steps = "backtracking"\ncycle = "V"\niterations = 2'),
        ("fas", 'steps = "spectral"\ncycle = "W"\npost = 2'),
        ("fas", 'cycle = "F"\nlayers = 0'),
        ("fas", 'steps = "exact"\niterations = 3\nchebyshev = "auto"'),
        ("jacobi", 'steps = "spectral"\niterations = 3\nchebyshev = 0.8'),
        ("jacobi", 'steps = "spectral"\niterations = 3\nchebyshev = "auto"'),
        ("jacobi", 'steps = "exact"'),
        ("scalar-jacobi", "iterations = 2"),
        ("verlet", ""),
    ],
)
@pytest.mark.parametrize("constraint", ["", HELD, PULLED])
def test_planned_passes_are_those_that_are_made(solver, lines, constraint):
    text = BEAM.format(top="", constraint=constraint, solver=solver, fields="").replace(
        "ratio = 8", f'ratio = 8\nblocks = "fresh"\n{lines}'
    )
    if solver == "verlet":
        text = text.replace("substeps = 4\n", "")
    simulation = Simulation.prepare(parse_scene(text, "small.toml"))
    row = list(simulation.frames())[1].row
    planned = row["substeps"] * simulation.plan.passes_per_substep + simulation.plan.passes_per_frame
    if "tolerance" in lines and not constraint:
        # A body in free flight meets any tolerance at once: the plan says "at most".
        assert row["passes"] < planned
    elif row["retakes"]:
        # The plan cannot know which frames have to be taken again.
        assert solver == "verlet"
        assert row["passes"] > planned
    else:
        assert row["passes"] == pytest.approx(planned, rel=1e-12)


@pytest.mark.parametrize("steps", ["spectral", "exact"])
def test_kept_blocks_cost_no_more_than_planned(steps):
    text = BEAM.format(top="", constraint=HELD, solver="fas", fields="")
    made = {}
    for blocks in ("fresh", "auto"):
        lines = f'ratio = 8\nsteps = "{steps}"\nblocks = "{blocks}"'
        simulation = Simulation.prepare(parse_scene(text.replace("ratio = 8", lines), "small.toml"))
        row = list(simulation.frames())[1].row
        made[blocks] = row["passes"]
        assert row["passes"] <= 4 * simulation.plan.passes_per_substep + simulation.plan.passes_per_frame + 1e-9
    assert made["fresh"] < made["auto"] <= made["fresh"] + 0.5 * 4 + 1e-9


@pytest.mark.parametrize(
    ("lines", "layers"),
    [
        ("", "coarse-to-fine(1), layers 2 1 0"),
        ('cycle = "V"', "V(1, 1), layers 0 1 2 1 0"),
        ('cycle = "W"\npre = 0\npost = 2', "W(0, 2), layers 2 2 1 1 2 2 1 1 0 0"),
        ('cycle = "F"\nlayers = 0', "F(1, 1), layers 0"),
    ],
)
def test_the_cycle_is_shown_and_made(monkeypatch, lines, layers):
    text = BEAM.format(top="", constraint=HELD, solver="fas", fields="").replace("ratio = 8", f"ratio = 8\n{lines}")
    simulation = Simulation.prepare(parse_scene(text, "small.toml"))
    assert next(stage for stage in simulation.plan.stages if stage.name == "cycle").note == layers
    made = []
    smooth_layer = FAS.smooth_layer

    def noted(self, potential, x, number):
        made.append(number)
        return smooth_layer(self, potential, x, number)

    monkeypatch.setattr(FAS, "smooth_layer", noted)
    simulation.stepper.step(simulation.start(), 1e-3 / 60.0)
    assert [f"{number}" for number in made] == layers.split("layers ")[1].split()


def test_chebyshev_says_what_it_does():
    def note(lines):
        text = BEAM.format(top="", constraint=HELD, solver="jacobi", fields="").replace("ratio = 8", lines)
        plan = Simulation.prepare(parse_scene(text, "small.toml")).plan
        return next(stage for stage in plan.stages if stage.name == "Chebyshev").note

    assert note("") == "no extrapolation of the iterates"
    assert note('iterations = 2\nchebyshev = "auto"') == "extrapolated as far as the energy falls"
    assert note("iterations = 2\nchebyshev = 0.9").endswith(", at most as for rho = 0.9")
    assert note('iterations = 2\nsteps = "spectral"\nchebyshev = "auto"') == "extrapolated as far as the energy falls"
    assert note('iterations = 9\nsteps = "spectral"\nchebyshev = 0.9') == "rho = 0.9"
    assert "above 0.707" in note('iterations = 2\nsteps = "spectral"\nchebyshev = 0.9')


@pytest.mark.parametrize("constraint", ["", HELD])
def test_linear_transfer(constraint):
    text = BEAM.format(top="", constraint=constraint, solver="fas", fields='"cluster_1"')
    simulation = Simulation.prepare(parse_scene(text.replace("ratio = 8", 'transfer = "linear"'), "small.toml"))
    notes = {stage.name: stage.note for stage in simulation.plan.stages}
    assert notes["hierarchy"] == "linear transfer, ratio 8, 3 layers"
    assert notes["layer 1"].startswith("lattice of 0.")
    assert notes["layer 3"].startswith("lattice twice as wide: ")
    held_elements = 0 if not constraint else int((~simulation.disc.free[simulation.disc.mesh.cells].any(axis=1)).sum())
    assert notes["interior of layer 1"] == f"{held_elements} elements without a free vertex contribute exactly zero"
    assert not any("clusters" in note for note in notes.values())
    row = list(simulation.frames())[1].row
    planned = row["substeps"] * simulation.plan.passes_per_substep + simulation.plan.passes_per_frame
    assert row["passes"] == pytest.approx(planned, rel=1e-12)


def test_layers_beyond_the_mesh_are_left_out():
    simulation = Simulation.prepare(parse_scene(BEAM.format(top="", constraint="", solver="fas", fields="") + "", "s"))
    asked = parse_scene(
        BEAM.format(top="", constraint="", solver="fas", fields="").replace("ratio = 8", "ratio = 8\nlayers = 9"), "s"
    )
    assert len(Simulation.prepare(asked).hierarchy.layers) == len(simulation.hierarchy.layers) == 3
    assert "layer 3" in skipped(simulation.plan)


@pytest.mark.parametrize(("solver", "field"), [("verlet", "residual"), ("fas", "cluster_9"), ("jacobi", "cluster_1")])
def test_impossible_fields_are_refused(solver, field):
    with pytest.raises(InputError, match=r"output\.fields") as caught:
        Simulation.prepare(scene(solver=solver, fields=f'"{field}"'))
    assert field in str(caught.value)
    assert "allowed" in str(caught.value)
