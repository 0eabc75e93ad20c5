# SPDX-License-Identifier: BSD-3-Clause
"""Solvers that stand for other people's methods: what production is measured against, never used to solve a scene."""
