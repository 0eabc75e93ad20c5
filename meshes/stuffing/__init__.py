# SPDX-License-Identifier: BSD-3-Clause
"""Isosurface stuffing: tetrahedra of guaranteed shape from any closed surface (Labelle and Shewchuk 2007)."""
