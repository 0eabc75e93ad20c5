# SPDX-License-Identifier: BSD-3-Clause
"""Solves scenes of elastic bodies with matrix-free Galerkin multigrid."""

__version__ = "0.1.0"
