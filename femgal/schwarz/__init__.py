# SPDX-License-Identifier: BSD-3-Clause
"""Additive Schwarz: domains of some 32 nodes on every level, their dense matrices inverted."""
