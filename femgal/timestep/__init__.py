# SPDX-License-Identifier: BSD-3-Clause
"""Time stepping: velocity Verlet, backward Euler."""
