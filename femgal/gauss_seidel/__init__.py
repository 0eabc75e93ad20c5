# SPDX-License-Identifier: BSD-3-Clause
"""Coloured Gauss-Seidel sweeps over the free vertices, on the energy itself or on an assembled matrix."""
