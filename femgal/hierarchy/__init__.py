# SPDX-License-Identifier: BSD-3-Clause
"""Coarse layers, each connected directly to the finest mesh."""
