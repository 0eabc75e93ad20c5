# SPDX-License-Identifier: BSD-3-Clause
"""The CUDA backend against the CPU's, and how fast it is: for a machine with a GPU, or at toy size in the simulator."""
