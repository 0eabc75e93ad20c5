# SPDX-License-Identifier: BSD-3-Clause
"""Opening HDF5 files.

1. A good file opens, and is closed again also after an exception.
2. Whatever goes wrong while the body reads a torn file becomes an InputError that names file, kind and cure.
3. Errors of the body that are InputErrors already pass as they are.
4. Soft and external links, external storage and sizes beyond what the file can hold are refused, wherever on the way.
"""

from __future__ import annotations

import numpy as np
import pytest

from femgal.output.hdf5 import local_object, open_for_reading
from meshes.errors import InputError

h5py = pytest.importorskip("h5py")


@pytest.fixture
def path(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["x"] = np.arange(3.0)
    return tmp_path / "a.h5"


def read(path, question):
    with open_for_reading(path, "checkpoint", "buy another disk") as file:
        read.file = file
        return question(file)


def test_good_file(path):
    assert read(path, lambda file: file["x"][1]) == 1.0
    assert not read.file


@pytest.mark.parametrize("question", [lambda f: f["y"], lambda f: f["x"][9], lambda f: f.attrs["z"], lambda f: f.foo])
def test_torn_file(path, question):
    with pytest.raises(InputError) as caught:
        read(path, question)
    message = str(caught.value)
    assert "a.h5" in message
    assert "checkpoint cannot be read" in message
    assert "buy another disk" in message
    assert not read.file


def test_ways_out_of_the_file(path, tmp_path):
    (tmp_path / "secret").write_bytes(b"password")
    with h5py.File(path, "r+") as file:
        file["group/inner"] = np.ones(2)
        file["soft"] = h5py.SoftLink("/x")
        file["external"] = h5py.ExternalLink(str(path), "/group")
        file.create_dataset("storage", (8,), "u1", external=[(str(tmp_path / "secret"), 0, 8)])
        file.create_dataset("huge", (10**12,), "f8", chunks=(1000,))
    assert read(path, lambda file: local_object(file, "group/inner")[1]) == 1.0
    for name in ("soft", "external", "external/inner", "storage", "huge", "none", "x/y"):
        with pytest.raises(InputError, match="not usable") as caught:
            read(path, lambda file, name=name: local_object(file, name))
        assert f"a.h5: /{name}" in str(caught.value)


def test_input_errors_pass(path):
    def refuse(file):
        raise InputError("too old")

    with pytest.raises(InputError, match=r"^too old$"):
        read(path, refuse)
