# SPDX-License-Identifier: BSD-3-Clause
"""One step of any solver as a plain function, femgal's own and a user's, so that the same cases judge all."""
