# SPDX-License-Identifier: BSD-3-Clause
"""The commands as a whole.

1. Every ``femgal WORD ...`` that a help text or README.md quotes is a command that exists, with the options it shows.
2. Listing the catalogue of meshes compiles nothing: it does not import Numba.
3. Dense linear algebra has one thread, unless the user says otherwise: that is settled before NumPy is imported.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from femgal.cli import main
from femgal.commands.bench_grid import grid

README = Path(__file__).resolve().parents[2] / "README.md"
# After a backtick, a path or at the start of a line; prose such as "what femgal is" does not count.
QUOTED = re.compile(r"(?:^[ ]*|`|/bin/)femgal ((?:[a-z]+ ?)+)([^`\n&|]*)", re.M)


def commands(group: click.Group, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    """Every command below a group with its words."""
    context = click.Context(group)
    for name in group.list_commands(context):
        found = group.get_command(context, name)
        assert found is not None
        yield (*path, name), found
        if isinstance(found, click.Group):
            yield from commands(found, (*path, name))


def texts() -> dict[str, str]:
    """README.md and the help texts, with their options, of all commands."""
    found = {"README.md": README.read_text(encoding="utf-8"), "femgal": main.help or ""}
    for words, command in commands(main):
        helps = [option.help or "" for option in command.params if isinstance(option, click.Option)]
        found[" ".join(words)] = "\n".join([command.help or "", *helps])
    return found


def quoted() -> list[tuple[str, str, str]]:
    """Where, the words after ``femgal``, and what follows them."""
    return [(where, *match) for where, text in texts().items() for match in QUOTED.findall(text)]


def test_the_search_finds_quotes():
    places = [where for where, _, _ in quoted()]
    assert places.count("README.md") >= 5
    assert places.count("scenes") >= 2
    assert places.count("femgal") >= 1
    assert QUOTED.findall("run `femgal solve SCENE --fast`") == [("solve ", "SCENE --fast")]


@pytest.mark.parametrize(("where", "words", "rest"), quoted())
def test_quoted_commands_exist(where, words, rest):
    known = dict(commands(main))
    first, *more = words.split()
    path = (first, *more[:1]) if isinstance(known.get((first,)), click.Group) else (first,)
    # What is no sub-command of bench is a scene for its grid.
    command = grid if first == "bench" and path not in known else known.get(path)
    assert command is not None, f"{where} names `femgal {words}{rest}`"
    options = {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}
    shown = set(re.findall(r"(?<!\S)--[a-z][a-z-]*", rest))
    assert shown <= options, f"{where} names `femgal {words}{rest}`"


@pytest.mark.parametrize("arguments", [("mesh", "info"), ("mesh", "info", "--json")])
def test_listing_meshes_does_not_import_numba(arguments):
    code = (
        f"import sys; sys.argv = ['femgal', *{arguments!r}]\n"
        "from femgal.cli import main\n"
        "try:\n    main()\nexcept SystemExit as stop:\n    assert stop.code == 0\n"
        "print('MODULES', *sys.modules)"
    )
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    listed, _, modules = output.rpartition("MODULES")
    assert "rabbit" in listed
    assert "meshes.catalogue" in modules.split()
    assert "numba" not in modules.split()


@pytest.mark.parametrize(("given", "found"), [(None, "1"), ("2", "2")])
def test_dense_linear_algebra_has_one_thread(given, found):
    code = "import os, sys, femgal.cli as c; assert 'numpy' not in sys.modules; c.main.get_command(None, 'run'); "
    code += "print(os.environ['OPENBLAS_NUM_THREADS'])"
    environment = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    environment |= {} if given is None else {"OPENBLAS_NUM_THREADS": given}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == found
