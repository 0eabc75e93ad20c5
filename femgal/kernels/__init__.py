# SPDX-License-Identifier: BSD-3-Clause
"""Element passes and block solves; one sub-package per backend, the same names in each."""
