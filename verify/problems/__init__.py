# SPDX-License-Identifier: BSD-3-Clause
"""What cases compute on: bodies, states that hurt, scenes, waves, and how large single terms are there."""
