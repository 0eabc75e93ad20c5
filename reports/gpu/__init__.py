# SPDX-License-Identifier: BSD-3-Clause
"""Figures of the CUDA backend on a GPU."""
