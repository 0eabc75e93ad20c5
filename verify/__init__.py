# SPDX-License-Identifier: BSD-3-Clause
"""Proves the solvers: references, verification cases, work-precision and stability studies."""
