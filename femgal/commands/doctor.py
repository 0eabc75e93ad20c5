# SPDX-License-Identifier: BSD-3-Clause
"""`femgal doctor`: what runs would use on this machine, and what keeps a GPU from being used."""

from __future__ import annotations

import click


@click.command()
@click.option("--kernels", is_flag=True, help="Compile every CUDA kernel and print its registers; needs no GPU.")
def command(kernels: bool) -> None:
    """Print devices, driver, packages, threads, and what a run would use.

    \b
    femgal doctor
    femgal doctor --kernels    compiles all CUDA kernels for Hopper, some
                               40 s; needs ptxas (nvidia-cuda-nvcc)
    """  # noqa: D301 - click reads the backspace
    for name, text in [*_machine(), *_cuda()]:
        click.echo(f"{name + ':':18s}{text}")
    if kernels:
        click.echo("")
        for line in kernel_table():
            click.echo(line)


def _machine() -> list[tuple[str, str]]:
    from femgal.kernels.cpu.threads import Workers
    from femgal.output.environment import describe_environment
    from meshes.cache import cache_root

    environment = describe_environment()
    packages = ", ".join(f"{name} {environment[name]}" for name in ("femgal", "numpy", "scipy", "numba", "h5py"))
    return [
        ("python", f"{environment['python']}, {environment['platform']}"),
        ("packages", packages),
        ("cpu", f"{environment['cpu']}, {environment['cpu_cores']} cores"),
        ("threads", f"{Workers().threads} (solver.threads, or --threads)"),
        ("caches", str(cache_root())),
    ]


def _cuda() -> list[tuple[str, str]]:
    from femgal.kernels.cuda.device import find_devices, require_device
    from meshes.errors import InputError

    found = find_devices()
    packages = ", ".join(f"{name} {version or 'missing'}" for name, version in found.packages.items())
    rows = [
        ("cuda packages", packages),
        ("cuda driver", "not asked: simulator" if found.simulated else found.driver_text),
    ]
    rows += [(f"cuda device {number}", str(device)) for number, device in enumerate(found.devices)]
    try:
        device = require_device(found)
        usable = "the simulator, one thread of Python per CUDA thread" if device is None else device.name
        rows.append(("--device cuda", f"would use {usable}; graphs: {_graphs()}"))
    except InputError as error:
        rows.append(
            (
                "--device cuda",
                "\n".join(line if k == 0 else f"{'':18s}{line}" for k, line in enumerate(str(error).splitlines())),
            )
        )
    return [*rows, ("--device cpu", "the default; solves every scene")]


def _graphs() -> str:
    from femgal.kernels.cuda.graphs import why_no_graphs

    why = why_no_graphs()
    return f"none, launches are repeated one by one ({why})" if why else "a repeated substep is one launch"


def kernel_table() -> list[str]:
    """Registers, local memory and double-precision instructions of every kernel in both precisions."""
    from femgal.kernels.cuda.offline import compile_all

    rows: list[tuple[str, ...]] = [("kernel", "precision", "registers", "stack", "spills", "instructions on doubles")]
    for one in compile_all():
        doubles = ", ".join(f"{count} {name}" for name, count in sorted(one.doubles.items())) or "none"
        rows.append((one.name, one.precision, *(str(n) for n in (one.registers, one.stack, one.spills)), doubles))
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
