# SPDX-License-Identifier: BSD-3-Clause
"""The backend on a GPU: kernels through Numba-CUDA. Nothing else in femgal imports `numba.cuda`."""
