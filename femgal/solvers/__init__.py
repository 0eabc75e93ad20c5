# SPDX-License-Identifier: BSD-3-Clause
"""Minimisers of the incremental potential; one file per solver, all init / step / finished."""
