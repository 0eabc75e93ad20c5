# SPDX-License-Identifier: BSD-3-Clause
"""Somebody else's result for a scene, held against femgal's converged reference."""
