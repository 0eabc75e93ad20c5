# SPDX-License-Identifier: BSD-3-Clause
"""Checkpoints.

1. Arrays come back bit for bit with dtype and shape: NaN payloads, signed zeros, subnormals, empty, scalar, strided,
   big-endian, boolean; meta comes back equal.
2. The earlier checkpoint stays whole when writing the new one fails at any moment, kill -9 included.
3. Refused, by file name and with advice: missing, truncated, flipped bits, another version, another fingerprint,
   links and data outside the file, sizes that are not stored.
4. Arrays that hold no numbers and meta without a fingerprint are programming errors.
"""

from __future__ import annotations

import subprocess
import sys
import time

import numpy as np
import pytest

from femgal.output.checkpoint import load_checkpoint, save_checkpoint
from meshes.errors import InputError

h5py = pytest.importorskip("h5py")
META = {"fingerprint": "a1b2", "frame": 7, "time": 0.1 + 0.2, "guard": {"best": float("inf")}, "names": ["ä"]}


def bits(array):
    return array.dtype, array.shape, array.tobytes()


def test_bit_for_bit(tmp_path):
    rng = np.random.default_rng(5550123)
    random_bits = rng.integers(0, 2**64, (50, 3), dtype=np.uint64).view(np.float64)
    arrays = {
        "x": random_bits,
        "special": np.array([0.0, -0.0, 5e-324, np.inf, np.nan]),
        "solver/w": rng.random((4, 5)).T[::2],
        "solver/levels/ids": np.arange(6, dtype=np.int32).reshape(1, 6),
        "fixed": np.array([True, False]),
        "empty": np.empty((0, 3)),
        "scalar": np.array(3.5),
        "big": np.arange(3, dtype=">f8"),
        "half": np.arange(3, dtype=np.float16),
    }
    save_checkpoint(tmp_path, arrays, META)
    loaded, meta = load_checkpoint(tmp_path, fingerprint="a1b2")
    assert meta == META
    assert set(loaded) == set(arrays)
    for name, array in arrays.items():
        assert bits(loaded[name]) == bits(array), name
    assert [path.name for path in tmp_path.iterdir()] == ["checkpoint.h5"]


def test_failing_write_keeps_the_earlier(tmp_path, monkeypatch):
    save_checkpoint(tmp_path, {"x": np.ones(3)}, META)

    def full(*arguments, **keywords):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(h5py.Group, "create_dataset", full)
        with pytest.raises(OSError, match="No space"):
            save_checkpoint(tmp_path, {"x": np.zeros(3)}, META)
    assert np.array_equal(load_checkpoint(tmp_path)[0]["x"], np.ones(3))
    assert [path.name for path in tmp_path.iterdir()] == ["checkpoint.h5"]


CHILD = """
import sys
from pathlib import Path
import numpy as np
from femgal.output.checkpoint import save_checkpoint
number = 0
while True:
    save_checkpoint(Path(sys.argv[1]), {"x": np.full(300_000, float(number))}, {"fingerprint": "f", "number": number})
    number += 1
    print(number, flush=True)
"""


def test_survives_kill(tmp_path):
    for moment in np.random.default_rng(8675309).uniform(0.0, 0.05, 5):
        with subprocess.Popen([sys.executable, "-c", CHILD, str(tmp_path)], stdout=subprocess.PIPE, text=True) as child:
            assert child.stdout.readline() == "1\n"
            time.sleep(moment)
            child.kill()
        arrays, meta = load_checkpoint(tmp_path, fingerprint="f")
        assert np.array_equal(arrays["x"], np.full(300_000, float(meta["number"])))


def refused(folder, match, **keywords):
    with pytest.raises(InputError, match=match) as caught:
        load_checkpoint(folder, **keywords)
    message = str(caught.value)
    assert "checkpoint.h5" in message
    assert "--out" in message or "do not trust this file" in message
    return message


def test_fingerprint(tmp_path):
    save_checkpoint(tmp_path, {"x": np.ones(3)}, META)
    message = refused(tmp_path, "fingerprint does not fit", fingerprint="c3d4")
    assert "a1b2" in message
    assert "c3d4" in message


def test_missing(tmp_path):
    refused(tmp_path, "no checkpoint here")


def test_truncated(tmp_path):
    path = tmp_path / "checkpoint.h5"
    save_checkpoint(tmp_path, {"x": np.arange(5000.0)}, META)
    whole = path.read_bytes()
    for length in (0, 7, 600, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        refused(tmp_path, "checkpoint")


def test_every_flipped_byte_is_noticed_or_harmless(tmp_path):
    path = tmp_path / "checkpoint.h5"
    arrays = {"x": np.arange(40.0), "solver/w": np.arange(6)}
    save_checkpoint(tmp_path, arrays, META)
    whole = path.read_bytes()
    noticed = 0
    for place in np.random.default_rng(3141593).permutation(len(whole))[:400]:
        torn = bytearray(whole)
        torn[place] ^= 0x40
        path.write_bytes(torn)
        try:
            loaded, meta = load_checkpoint(tmp_path, fingerprint="a1b2")
        except InputError:
            noticed += 1
            continue
        assert meta == META
        for name, array in loaded.items():
            assert bits(array) == bits(arrays[name])
    assert noticed > 20
    path.write_bytes(whole.replace(np.float64(17.0).tobytes(), np.float64(17.5).tobytes()))
    refused(tmp_path, "checksum of arrays/x")


def test_version(tmp_path):
    save_checkpoint(tmp_path, {"x": np.ones(3)}, META)
    with h5py.File(tmp_path / "checkpoint.h5", "r+") as file:
        file.attrs["femgal_checkpoint"] = 99
    assert "99" in refused(tmp_path, "version does not fit")


def external_link(file, path):
    file["arrays/x"] = h5py.ExternalLink(str(path.parent / "other.h5"), "/x")


def external_storage(file, path):
    file.create_dataset("arrays/x", (8,), "u1", external=[(str(path.parent / "secret"), 0, 8)])


def never_stored(file, path):
    file.create_dataset("arrays/x", (10**6,), "f8")


def huge(file, path):
    file.create_dataset("arrays/x", (10**12,), "f8", chunks=(1000,))


@pytest.mark.parametrize("attack", [external_link, external_storage, never_stored, huge])
def test_data_outside_the_file(tmp_path, attack):
    (tmp_path / "secret").write_bytes(b"password")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = np.ones(3)
    save_checkpoint(tmp_path, {"y": np.ones(3)}, META)
    with h5py.File(tmp_path / "checkpoint.h5", "r+") as file:
        attack(file, tmp_path / "checkpoint.h5")
    outside = ("external_link", "external_storage", "huge")
    refused(tmp_path, "not usable" if attack.__name__ in outside else "stored bytes of arrays/x")


def test_programming_errors(tmp_path):
    with pytest.raises(ValueError, match="fingerprint"):
        save_checkpoint(tmp_path, {}, {"frame": 1})
    with pytest.raises(ValueError, match="'names'"):
        save_checkpoint(tmp_path, {"names": np.array(["a"])}, META)
    assert list(tmp_path.iterdir()) == []
