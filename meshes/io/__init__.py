# SPDX-License-Identifier: BSD-3-Clause
"""Mesh files: :mod:`meshes.io.tets` and :mod:`meshes.io.surfaces` read and write, the rest are the formats."""
