# SPDX-License-Identifier: BSD-3-Clause
"""How fast the solvers are here: timing, memory bandwidth, and benchmarks that answer one named question each."""
