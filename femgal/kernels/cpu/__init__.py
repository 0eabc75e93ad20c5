# SPDX-License-Identifier: BSD-3-Clause
"""Numba kernels for the CPU."""
