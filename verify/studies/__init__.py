# SPDX-License-Identifier: BSD-3-Clause
"""The studies of Lu et al. 2025, repeated: grids as data, their measures and ours, and a judgement of each claim."""
