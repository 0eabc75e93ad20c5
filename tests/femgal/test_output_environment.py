# SPDX-License-Identifier: BSD-3-Clause
"""The description of versions and machine.

1. It names the versions that are really running, and a CPU.
2. Making it imports none of the packages it describes.
"""

from __future__ import annotations

import platform
import subprocess
import sys

import numpy as np

from femgal.output.environment import describe_environment


def test_versions():
    found = describe_environment()
    assert found["numpy"] == np.__version__
    assert found["python"] == platform.python_version()
    assert found["cpu"]
    assert found["cpu_cores"] >= 1
    assert {"femgal", "numba", "h5py", "scipy", "platform"} <= set(found)


def test_imports_nothing():
    code = (
        "import sys; from femgal.output.environment import describe_environment; describe_environment();"
        "print([name for name in ('numpy', 'numba', 'h5py', 'scipy', 'meshio') if name in sys.modules])"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"
