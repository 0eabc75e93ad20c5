# SPDX-License-Identifier: BSD-3-Clause
"""Coarse layers, each connected directly to the finest mesh."""

# Vertices per node from one linear layer to the next: each lattice is twice as wide (Lu et al. 2025, section 5.1.2).
LINEAR_RATIO = 8
