# SPDX-License-Identifier: BSD-3-Clause
"""Slow and obvious references: assembled by scikit-fem, solved directly, never used to solve a scene."""
