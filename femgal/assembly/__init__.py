# SPDX-License-Identifier: BSD-3-Clause
"""Assembled Hessians: symmetric matrices of 3x3 blocks, their products and their Galerkin coarsening."""
