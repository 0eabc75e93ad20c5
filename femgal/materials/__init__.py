# SPDX-License-Identifier: BSD-3-Clause
"""Energy, stress and Hessian action as functions of scalars, shared by every backend."""
