# SPDX-License-Identifier: BSD-3-Clause
"""The cache of compiled functions.

1. The digest changes with the text or name of any file beside a compiled function, and with nothing else.
2. A kernel whose constant is changed in another file is compiled anew: the next process returns the new value.
3. An unchanged kernel is compiled once: the next process only reads the cache.
4. Compiling a kernel does not import SciPy's linear algebra; a kernel that needs a BLAS still finds it.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from meshes.jit import _source_digest

KERNEL = "from meshes.jit import kernel\nfrom package.inner.constants import N\n@kernel\ndef value():\n    return N\n"
CALL = (
    "from package.inner.kernels import value\n"
    "print(value(), sum(value.stats.cache_misses.values()), sum(value.stats.cache_hits.values()))"
)


@pytest.fixture
def package(tmp_path) -> Path:
    inner = tmp_path / "package" / "inner"
    inner.mkdir(parents=True)
    (inner / "kernels.py").write_text(KERNEL)
    (inner / "constants.py").write_text("N = 11\n")
    (tmp_path / "package" / "other.py").write_text("M = 1\n")
    return tmp_path / "package"


def test_digest(package):
    first = _source_digest({package})
    assert len(first) == 16
    (package / "other.py").write_text("M = 2\n")
    (package / "inner" / "notes.txt").write_text("no source\n")
    assert _source_digest({package}) == first
    (package / "inner" / "constants.py").write_text("N = 12\n")
    second = _source_digest({package})
    (package / "inner" / "constants.py").rename(package / "inner" / "numbers.py")
    third = _source_digest({package})
    (package / "inner" / "numbers.py").unlink()
    assert len({first, second, third, _source_digest({package})}) == 4


def call(package: Path) -> list[int]:
    environment = {
        **os.environ,
        "FEMGAL_CACHE_DIR": str(package.parent / "cache"),
        "PYTHONPATH": os.pathsep.join([str(package.parent), *sys.path]),
        "PYTHONDONTWRITEBYTECODE": "1",  # two edits within a second may look the same to Python's own cache
    }
    found = subprocess.run([sys.executable, "-c", CALL], env=environment, capture_output=True, text=True, check=True)
    return [int(word) for word in found.stdout.split()]


def test_changed_constant_is_compiled_anew(package):
    assert call(package) == [11, 1, 0]
    assert call(package) == [11, 0, 1]
    (package / "inner" / "constants.py").write_text("N = 13\n")
    assert call(package) == [13, 1, 0]


def test_blas_is_looked_for_only_where_it_is_needed():
    script = (
        "import sys, numba, numpy as np\n"
        "from meshes.ordering import morton_order\n"
        "morton_order(np.eye(3))\n"
        "print('scipy.linalg' in sys.modules)\n"
        "product = numba.njit(lambda a, b: np.dot(a, b))\n"
        "print(product(np.eye(2), np.ones((2, 2))).sum(), 'scipy.linalg' in sys.modules)\n"
    )
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert result.stdout.split() == ["False", "4.0", "True"]
